"""Bunches of points, their spheres and cones, and the rays that are cast, each by its definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import VisibilitySettings
from upplied.planning.visibility.frustum import bunches_of, gather_rays, in_view, limits_of, mark_free
from upplied.poses import look_at, matrices
from upplied.records import Camera, Cloud, Floats

TRUE = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)
BUNCH = 24


def sphere_cloud(number: int, seed: int = 0) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(normals * rng.uniform(4, 6, (number, 1)), normals)


def place_on_curve(point: Floats, low: Floats, extent: float) -> int:
    """Bits of the three cells in turn, as texts."""
    cells = [min(int((value - base) * 1023 / extent), 1023) for value, base in zip(point, low, strict=True)]
    bits = [f"{cell:010b}" for cell in cells]
    return int("".join(z + y + x for x, y, z in zip(*bits, strict=True)), 2)


def test_bunches_follow_a_z_order_curve_face_by_face() -> None:
    cloud, origin = sphere_cloud(300), np.array([1.0, 2.0, 3.0])
    found = bunches_of(cloud, origin, limits_of(Camera(), TRUE, cloud), 40)
    points, normals = cloud.points - origin, cloud.normals
    assert normals is not None
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    face = np.abs(normals).argmax(axis=1)
    side = [2 * axis + int(normal[axis] > 0) for axis, normal in zip(face, normals, strict=True)]
    curve = [place_on_curve(point, low, extent) for point in points]
    assert found.order.tolist() == sorted(range(300), key=lambda at: (side[at], curve[at], at))
    assert np.array_equal(found.points.T, points[found.order])
    assert np.array_equal(found.normals.T, normals[found.order])
    assert found.start.tolist() == [*range(0, 300, BUNCH), 300]


def test_few_poses_or_points_are_left_in_one_bunch() -> None:
    cloud = sphere_cloud(4 * BUNCH)
    limits = limits_of(Camera(), TRUE, cloud)
    assert len(bunches_of(cloud, np.zeros(3), limits, 39).start) == 2
    assert len(bunches_of(cloud, np.zeros(3), limits, 40).start) == 5
    few = Cloud(cloud.points[1:], cloud.normals[1:])  # type: ignore[index]
    found = bunches_of(few, np.zeros(3), limits, 40)
    assert found.order.tolist() == list(range(95)) and found.start.tolist() == [0, 95]


def test_each_bunch_has_its_sphere_and_its_cone() -> None:
    cloud = sphere_cloud(130, 1)
    limits = limits_of(Camera(), TRUE, cloud)
    found = bunches_of(cloud, np.zeros(3), limits, 40)
    for number, (first, last) in enumerate(zip(found.start[:-1], found.start[1:], strict=True)):
        points, normals = found.points[:, first:last].T, found.normals[:, first:last].T
        centre = points.mean(axis=0)
        assert found.bounds[:3, number] == pytest.approx(centre)
        assert found.bounds[3, number] == pytest.approx(max(np.linalg.norm(points - centre, axis=1)))
        axis = normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
        assert found.bounds[4:7, number] == pytest.approx(axis)
        widest = min(max(np.arccos(normals @ axis)) + np.radians(75), np.pi)
        assert found.bounds[7:, number] == pytest.approx([np.cos(widest), np.sin(widest)], abs=1e-9)


def test_normals_that_cancel_out_or_do_not_count_face_all_ways() -> None:
    half = sphere_cloud(48, 2).points
    cloud = Cloud(np.vstack([half, half]), np.repeat([[0.0, 0, 1], [0, 0, 1]], 48, axis=0))
    limits = limits_of(Camera(), VisibilitySettings(), cloud)
    bounds = bunches_of(cloud, np.zeros(3), limits, 40).bounds
    assert bounds[7] == pytest.approx(np.full(4, -1.0)) and bounds[8] == pytest.approx(np.zeros(4), abs=1e-12)
    assert not bunches_of(cloud, np.zeros(3), limits, 40).normals.any()


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
    found = []
    assert cloud.normals is not None
    for point, normal in zip(cloud.points, cloud.normals, strict=True):
        x, y, z = Rotation.from_quat(quat).inv().apply(point - at)
        distance = np.sqrt(x * x + y * y + z * z)
        along = np.hypot(x, y) if camera.hfov_deg >= 180 else x
        angles = np.degrees([np.arctan2(abs(y), x), np.arctan2(abs(z), along)])
        tilt = np.degrees(np.arccos((at - point) @ normal / distance))
        within = angles[0] <= camera.hfov_deg / 2 and angles[1] <= camera.vfov_deg / 2
        found.append(bool(within and camera.min_range_m <= distance <= camera.max_range_m and tilt <= 75))
    return found


@pytest.mark.parametrize("camera", [Camera(50, 30, 6.0, 16.0), Camera(200, 60, 8.0, 14.0)])
def test_bunches_leave_out_nothing_that_is_seen(camera: Camera) -> None:
    cloud, rng = sphere_cloud(200, 3), np.random.default_rng(4)
    at = rng.normal(0, 9, (40, 3))
    quats = look_at(at, rng.normal(0, 3, (40, 3)))
    limits = limits_of(camera, TRUE, cloud)
    found = bunches_of(cloud, np.zeros(3), limits, len(at))
    limits = np.tile(limits, (len(at), 1))
    asked = (at, matrices(quats), limits, found.points, found.normals, found.order, found.start, found.bounds)
    seen = np.zeros((40, 200), bool)
    in_view(*asked, seen)
    wanted = np.array([brute(cloud, *pose, camera) for pose in zip(at, quats, strict=True)])
    assert np.array_equal(seen, wanted) and 0.02 < wanted.mean() < 0.5
    grain, rays, pairs = 0.25, np.empty((450, 6)), np.empty(450, np.int64)
    pose, met = 0, []
    while pose < len(at):
        pose, count = gather_rays(*asked, grain, pose, rays, pairs)
        row, column = np.divmod(pairs[:count], 200)
        assert (np.diff(row) >= 0).all() and (count == 0 or row[-1] < pose)
        whole = cloud.points[column] - at[row]
        length = np.linalg.norm(whole, axis=1, keepdims=True)
        assert rays[:count, :3] == pytest.approx(at[row])
        assert rays[:count, 3:] == pytest.approx(whole * (1 - grain / length))
        met.extend(pairs[:count].tolist())
    assert sorted(met) == np.flatnonzero(wanted).tolist()


def test_the_range_itself_and_points_beyond_it() -> None:
    x = np.array([1.999, 2.0, 2.001, 49.999, 50.0, 50.001])
    cloud = Cloud(x[:, None] * [1.0, 0, 0], np.tile([-1.0, 0, 0], (6, 1)))
    limits = limits_of(Camera(min_range_m=2.0, max_range_m=50.0), TRUE, cloud)[None]
    found = bunches_of(cloud, np.zeros(3), limits, 1)
    seen = np.zeros((1, 6), bool)
    axes = matrices(np.array([[0.0, 0, 0, 1]]))
    asked = (found.points, found.normals, found.order, found.start, found.bounds)
    in_view(np.zeros((1, 3)), axes, limits, *asked, seen)
    assert seen[0].tolist() == [False, True, True, True, True, False]


def test_rays_fill_the_room_that_there_is() -> None:
    cloud = Cloud(np.array([[10.0, 0, 0], [11, 0, 0]]), np.tile([-1.0, 0, 0], (2, 1)))
    at, limits = np.zeros((3, 3)), np.tile(limits_of(Camera(), TRUE, cloud), (3, 1))
    found = bunches_of(cloud, np.zeros(3), limits, 3)
    axes = matrices(np.tile([0.0, 0, 0, 1], (3, 1)))
    asked = (at, axes, limits, found.points, found.normals, found.order, found.start, found.bounds)
    rays, pairs = np.empty((5, 6)), np.empty(5, np.int64)
    assert gather_rays(*asked, 0.0, 0, rays, pairs) == (2, 4)
    assert pairs[:4].tolist() == [0, 1, 2, 3] and rays[1].tolist() == [0, 0, 0, 11, 0, 0]
    assert gather_rays(*asked, 0.0, 2, rays, pairs) == (3, 2)
    # A point nearer than the grain is there already.
    assert gather_rays(*asked, 10.5, 2, rays, pairs) == (3, 2)
    assert not rays[0, 3:].any() and rays[1, 3] == pytest.approx(0.5)


def test_rays_that_arrive_are_marked() -> None:
    seen = np.zeros(6, bool)
    mark_free(np.array([4, 1, 2]), np.array([False, True, False]), seen)
    assert seen.tolist() == [False, False, True, False, True, False]
