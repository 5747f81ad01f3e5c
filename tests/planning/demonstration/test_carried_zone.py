"""A zone that is carried is itself on its own structure and the same face on another; plates have sides."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import CloudSettings, settings_for
from upplied.errors import SettingsError
from upplied.planning.demonstration.about import zone_of
from upplied.planning.demonstration.carried_zone import carried_zone
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.records import Bools, Cloud, Structure
from upplied.samples.fleet import member
from upplied.scene import scene_of

SETTINGS = settings_for("recommended")


def samples(structure: Structure) -> Cloud:
    return surface_samples(structure, scene_of(structure), CloudSettings(surface_samples=1500))


def named(where: str, structure: Structure, cloud: Cloud) -> Bools:
    found = zone_of(where, structure, cloud, skin_parts(structure, scene_of(structure), cloud).label)
    assert found is not None
    return found


def overlap(one: Bools, other: Bools) -> float:
    return float((one & other).sum() / (one | other).sum())


def face(structure: Structure, axis: int, sign: int) -> str:
    """A box about one face of a cuboid that is parallel to the axes."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    corners = np.array([low - 0.01, high + 0.01])
    corners[0 if sign > 0 else 1, axis] = (high if sign > 0 else low)[axis] - 0.01 * sign
    return "box " + " ".join(map(str, corners.ravel()))


@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (1, -1), (2, 1)])
def test_the_face_of_a_cube_is_the_same_face_of_a_cuboid(axis, sign):
    cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
    for target in (cube, cuboid):
        cloud = samples(target)
        wanted = cloud.normals[:, axis] * sign > 0.9
        found = carried_zone(face(cube, axis, sign), cube, target, cloud, SETTINGS)
        assert overlap(found.patches, wanted) > 0.9 and found.lost_pct < 2


@pytest.mark.slow
def test_an_engine_is_carried_to_the_engine_on_the_same_side():
    small, large = member("a320-v1").structure, member("b747-v1").structure
    cloud = samples(large)
    found = carried_zone("engine_left", small, large, cloud, SETTINGS)
    points = cloud.points[found.patches]
    assert len(points) > 5 and (points[:, 1] > 5).all()  # on the left, and on none of the other side
    assert (points[:, 2] < large.landmarks["fin"][2]).all() and 0.5 < found.probability <= 1
    own = samples(small)
    again = carried_zone("engine_left", small, small, own, SETTINGS)
    assert overlap(again.patches, named("engine_left", small, own)) > 0.9


def test_a_ball_keeps_to_one_side_of_a_thin_plate():
    corners = np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], float)
    plate = np.concatenate([corners, corners + np.array([0, 0, 0.02])])
    triangles = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]])
    thin = Structure("plate", "plate", plate, triangles, sha256="plate")
    places = [(x, y, z) for z in (0.0, 0.02) for x in np.linspace(-1.9, 1.9, 20) for y in (-1.0, 0.0, 1.0)]
    points = np.array(places)
    normals = np.where(points[:, 2:] > 0.01, [[0, 0, 1.0]], [[0, 0, -1.0]])
    cloud = Cloud(points, normals)
    skin = np.zeros(len(cloud), np.int64)
    above = zone_of("ball 0 0 0.03 1.2", thin, cloud, skin)
    assert above is not None and above.any() and (points[above, 2] > 0.01).all()
    assert (np.linalg.norm(points[above] - [0, 0, 0.03], axis=1) <= 1.2).all()
    for bad in ("ball 0 0 0", "ball 0 0 0 x", "ball 0 0 0 nan", "ball 90 0 0 1"):
        with pytest.raises(SettingsError, match=r"cannot be read as a ball|names no surface"):
            zone_of(bad, thin, cloud, skin)
