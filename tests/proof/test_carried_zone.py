"""A zone that is carried is itself on its own structure and the same face on another; plates have sides."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import slow_after

from upplied.config import CloudSettings, settings_for
from upplied.errors import SettingsError
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence import certainty as probabilities
from upplied.planning.correspondence.fit import Fit
from upplied.planning.demonstration.inspection import zone_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.proof import required_zones as carrying
from upplied.proof.required_zones import _carried, _probability, carried_zone
from upplied.records import Bools, Cloud, Correspondences, Frame, Registration, Structure
from upplied.samples.fleet import member

SETTINGS = settings_for("recommended")


def samples(structure: Structure) -> Cloud:
    return surface_samples(structure, scene_of(structure), CloudSettings(surface_samples=1500))


def named(where: str, structure: Structure, cloud: Cloud) -> Bools:
    zone = zone_of(where, structure, cloud, skin_parts(structure, scene_of(structure), cloud).label)
    assert zone is not None
    return zone


def overlap(one: Bools, other: Bools) -> float:
    return float((one & other).sum() / (one | other).sum())


def face(structure: Structure, axis: int, sign: int) -> str:
    """A box about one face of a cuboid that is parallel to the axes."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    corners = np.array([low - 0.01, high + 0.01])
    corners[0 if sign > 0 else 1, axis] = (high if sign > 0 else low)[axis] - 0.01 * sign
    return "box " + " ".join(map(str, corners.ravel()))


@pytest.mark.ci
@pytest.mark.parametrize(("axis", "sign"), slow_after(1, [(0, 1), (1, -1), (2, 1)]))
def test_the_face_of_a_cube_is_the_same_face_of_a_cuboid(axis, sign):
    cube, cuboid = member("cube-v1").structure, member("cuboid-v1").structure
    for target in (cube, cuboid):
        cloud = samples(target)
        expected = cloud.normals[:, axis] * sign > 0.9
        zone = carried_zone(face(cube, axis, sign), cube, target, cloud, SETTINGS)
        assert overlap(zone.patches, expected) > 0.9 and zone.lost_pct < 2


@pytest.mark.slow
def test_an_engine_is_carried_to_the_engine_on_the_same_side():
    small, large = member("a320-v1").structure, member("b747-v1").structure
    cloud = samples(large)
    zone = carried_zone("engine_left", small, large, cloud, SETTINGS)
    points = cloud.points[zone.patches]
    assert len(points) > 5 and (points[:, 1] > 5).all()  # on the left, and on none of the other side
    assert (points[:, 2] < large.landmarks["fin"][2]).all() and 0.5 < zone.probability <= 1
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


def fit(source: Cloud, target: Cloud, index: np.ndarray, points: np.ndarray, carried: bool = True) -> Fit:
    same = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, acceptance=0.5, scanned=0.4)
    classes = np.arange(4), np.arange(4)
    match = Correspondences(index, np.zeros(len(index)), points, "", *classes)
    return Fit(source, target, same, match, 1, np.zeros(len(target), np.int64) if carried else None)


LINE = np.column_stack([np.arange(20.0), np.zeros((20, 2))])
ROW = Cloud(LINE, np.tile([0.0, 0, 1], (20, 1)), np.ones(20), np.repeat([0, 1, 2, 3], 5))


def test_most_of_the_five_nearest_carried_samples_decide_within_three_spacings():
    zone = np.isin(np.arange(20), [5, 6, 7, 9, 17])
    index, points = np.arange(20), LINE.copy()
    index[8], points[10] = -1, np.nan
    target = Cloud(np.vstack([LINE, [[7, 0, 2.99], [7, 0, 3.01]]]), None, np.ones(22))
    actual = _carried(fit(ROW, target, index, points), zone)
    known = [at for at in range(20) if at not in (8, 10)]
    for at, place in enumerate(target.points):
        near = sorted(known, key=lambda of: np.linalg.norm(points[of] - place))
        expected = sum(zone[of] for of in near[:5]) >= 3
        assert actual[at] == (expected and np.linalg.norm(points[near[0]] - place) <= 3.0), at
    assert actual[[6, 7, 20]].all() and not actual[[17, 21]].any()
    assert not _carried(fit(ROW, target, np.full(20, -1), points), zone).any()
    assert not _carried(fit(ROW, target, index, points), np.arange(20) == 8).any()
    few = np.where(np.arange(20) < 2, np.arange(20), -1)
    assert _carried(fit(ROW, target, few, points), np.arange(20) < 2)[0]  # of two, two are asked


def test_the_least_certain_part_of_a_zone_speaks_for_it(monkeypatch):
    calls = []

    def evidence(source, part, registered, answers, acceptance, sure, carried):
        calls.append((part, answers, acceptance, sure))
        return part

    monkeypatch.setattr(probabilities, "evidence_of_counterpart", evidence)
    monkeypatch.setattr(
        probabilities, "probability", lambda parts, *_: {0: 0.9, 1: 0.5, 2: 0.1, 3: 0.7}[parts[0]]
    )
    here = fit(ROW, ROW, np.arange(20), LINE)
    assert _probability(here, np.arange(20) < 10) == 0.5
    assert calls == [([0], [0], 0.4, True), ([1], [1], 0.4, True)]
    assert np.isnan(_probability(fit(ROW, ROW, np.arange(20), LINE, carried=False), np.arange(20) < 10))
    many = Cloud(np.tile(LINE, (2, 1)), None, None, np.concatenate([np.zeros(19, int), [2], np.full(20, 3)]))
    assert _probability(fit(many, ROW, np.arange(40), many.points), np.arange(40) < 40) == 0.7  # 2 is a crumb


def test_of_a_zone_over_many_parts_the_largest_is_asked_about(monkeypatch):
    monkeypatch.setattr(probabilities, "evidence_of_counterpart", lambda source, part, *_: part)
    monkeypatch.setattr(probabilities, "probability", lambda parts, *_: 0.3 if parts == [18] else 0.0)
    each = Cloud(LINE, None, None, np.concatenate([np.arange(18), [18, 18]]))
    there = fit(each, ROW, np.arange(20), LINE)
    match = replace(there.correspondences, source_class=np.arange(19), target_class=np.arange(19))
    monkeypatch.setattr(carrying, "_PART", 0.11)
    assert _probability(replace(there, correspondences=match), np.ones(20, bool)) == 0.3


def test_a_part_that_nothing_answers_has_no_certainty():
    without = fit(ROW, ROW, np.arange(20), LINE)
    match = replace(without.correspondences, target_class=np.full(4, -1))
    assert _probability(replace(without, correspondences=match), np.arange(20) < 5) == 0.0


def test_what_of_a_zone_is_lost_is_told_and_patches_are_asked_by_place_and_side(monkeypatch):
    index = np.where(np.arange(20) == 3, -1, np.arange(20))
    own = replace(fit(ROW, ROW, index, LINE), carried=None)
    pair = SimpleNamespace(surface=own, source="source", source_scene="scene")
    turned = Frame(np.radians(90.0), np.array([2.0, 0, 0]))
    monkeypatch.setattr(carrying, "frames_for", lambda *_: (Frame(), turned))
    monkeypatch.setattr(carrying, "structure_in", lambda frame, structure: structure)
    monkeypatch.setattr(carrying, "study_pair", lambda *_: pair)
    monkeypatch.setattr(carrying, "skin_parts", lambda *_: SimpleNamespace(label="skin"))
    monkeypatch.setattr(carrying, "zone_of", lambda where, *_: np.arange(20) < 4 if where == "here" else None)
    places = np.array([[0.1, 0, 0], [2, 0, 0], [15, 0, 0]])
    surface = Cloud(turned.to_declared(places), np.tile([0.0, 0, 1], (3, 1)))
    carried = carried_zone("here", "source", "target", surface, SETTINGS)
    assert carried.lost_pct == 25.0 and np.isnan(carried.probability)
    assert carried.patches.tolist() == [True, True, False]
