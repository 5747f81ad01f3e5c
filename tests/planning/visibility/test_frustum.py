"""What lies in frustum, range and incidence, by its definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import VisibilitySettings
from upplied.geometry.poses import look_at, matrices
from upplied.planning.visibility.line_of_sight import facing_normals, in_view, limits_of
from upplied.records import Bools, Camera, Cloud, Floats

TRUE = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)


def sphere_cloud(number: int, seed: int = 0) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(normals * rng.uniform(4, 6, (number, 1)), normals)


def test_limits_are_sines_and_cosines_of_half_the_angles() -> None:
    cloud = sphere_cloud(4)
    limits = limits_of(Camera(60.0, 40.0, 1.5, 30.0), TRUE, cloud)
    thirty, twenty = np.radians([30.0, 20.0])
    known = [
        np.sin(thirty),
        np.cos(thirty),
        np.sin(twenty),
        np.cos(twenty),
        0,
        1.5,
        30,
        np.cos(np.radians(75)),
    ]
    assert limits == pytest.approx(known)
    assert (
        limits_of(Camera(180.0, 90.0), TRUE, cloud)[4] == 1 and limits_of(Camera(179.0), TRUE, cloud)[4] == 0
    )
    assert limits_of(Camera(), TRUE, Cloud(cloud.points))[7] == -1
    assert limits_of(Camera(), VisibilitySettings(), cloud)[7] == -1
    # At a right angle nothing is seen edge-on all the same.
    assert limits_of(Camera(), VisibilitySettings(occlusion=True, max_incidence_deg=90.0), cloud)[7] == 1e-6
    whole = limits_of(Camera(360.0, 180.0), TRUE, cloud)
    assert whole[:4] == pytest.approx([0, -1, 1, 0])


def brute(cloud: Cloud, at: Floats, quat: Floats, camera: Camera) -> list[bool]:
    """One point after another, by angles."""
    inside = []
    assert cloud.normals is not None
    for point, normal in zip(cloud.points, cloud.normals, strict=True):
        x, y, z = Rotation.from_quat(quat).inv().apply(point - at)
        distance = np.sqrt(x * x + y * y + z * z)
        along = np.hypot(x, y) if camera.hfov_deg >= 180 else x
        angles = np.degrees([np.arctan2(abs(y), x), np.arctan2(abs(z), along)])
        tilt = np.degrees(np.arccos((at - point) @ normal / distance))
        within = angles[0] <= camera.hfov_deg / 2 and angles[1] <= camera.vfov_deg / 2
        inside.append(bool(within and camera.min_range_m <= distance <= camera.max_range_m and tilt <= 75))
    return inside


def asked_of(at: Floats, quats: Floats, cloud: Cloud, camera: Camera) -> Bools:
    limits = limits_of(camera, TRUE, cloud)
    normals = facing_normals(cloud, limits)
    seen = np.zeros((len(at), len(cloud)), bool)
    rows = np.tile(limits, (len(at), 1))
    facing = (np.ascontiguousarray(of.T) for of in (cloud.points, normals))
    anywhere = np.zeros(len(at)), np.zeros(len(cloud))
    in_view(at, matrices(quats), rows, anywhere[0], *facing, anywhere[1], anywhere[1], seen)
    return seen


@pytest.mark.parametrize("camera", [Camera(50, 30, 6.0, 16.0), Camera(200, 60, 8.0, 14.0)])
def test_in_view_is_what_angles_say(camera: Camera) -> None:
    cloud, rng = sphere_cloud(200, 3), np.random.default_rng(4)
    at = rng.normal(0, 9, (40, 3))
    quats = look_at(at, rng.normal(0, 3, (40, 3)))
    expected = np.array([brute(cloud, *pose, camera) for pose in zip(at, quats, strict=True)])
    assert np.array_equal(asked_of(at, quats, cloud, camera), expected) and 0.02 < expected.mean() < 0.5


def test_the_range_itself_and_points_beyond_it() -> None:
    x = np.array([1.999, 2.0, 2.001, 49.999, 50.0, 50.001])
    cloud = Cloud(x[:, None] * [1.0, 0, 0], np.tile([-1.0, 0, 0], (6, 1)))
    camera, ahead = Camera(min_range_m=2.0, max_range_m=50.0), np.array([[0.0, 0, 0, 1]])
    seen = asked_of(np.zeros((1, 3)), ahead, cloud, camera)
    assert seen[0].tolist() == [False, True, True, True, True, False]


def test_normals_count_where_the_incidence_does() -> None:
    cloud = sphere_cloud(4)
    assert np.array_equal(facing_normals(cloud, limits_of(Camera(), TRUE, cloud)), cloud.outward)
    assert not facing_normals(cloud, limits_of(Camera(), VisibilitySettings(), cloud)).any()
    assert not facing_normals(Cloud(cloud.points), limits_of(Camera(), TRUE, cloud)).any()
