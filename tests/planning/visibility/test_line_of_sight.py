"""Visibility against a brute-force frustum, cases known by geometry, and rays cast one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from upplied.config import VisibilitySettings
from upplied.errors import SettingsError
from upplied.geometry.poses import look_at, matrices
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.visibility import line_of_sight as visibility
from upplied.planning.visibility.line_of_sight import Closeness, visible
from upplied.records import Bools, Camera, Cloud, Floats, Structure

FRUSTUM = VisibilitySettings()
TRUE = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)


def brute_frustum(positions: Floats, quats: Floats, points: Floats, camera: Camera) -> Bools:
    """The definition, angle by angle."""
    local = np.einsum("pji,pnj->pni", matrices(quats), points[None] - positions[:, None])
    x, y, z = np.moveaxis(local, 2, 0)
    along = np.hypot(x, y) if camera.hfov_deg >= 180 else x
    across_ok = np.abs(np.arctan2(y, x)) <= np.radians(camera.hfov_deg / 2)
    upright_ok = np.abs(np.arctan2(z, along)) <= np.radians(camera.vfov_deg / 2)
    distance = np.linalg.norm(local, axis=2)
    return across_ok & upright_ok & (distance >= camera.min_range_m) & (distance <= camera.max_range_m)


def box(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Vertices and outward triangles of a box."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return np.asarray(low) + corner * (np.asarray(high) - low), np.array(triangles)


def faces_of_box(half: float, number: int = 5) -> Cloud:
    """A grid of points with outward normals on each face of a cube."""
    grid = np.linspace(-0.8, 0.8, number) * half
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for a in grid:
                for b in grid:
                    point = np.insert([a, b], axis, side * half)
                    points.append(point)
                    normals.append(np.eye(3)[axis] * side)
    return Cloud(np.array(points), np.array(normals))


@pytest.mark.parametrize("hfov", [10.0, 75.0, 150.0, 179.0, 180.0, 240.0, 359.0, 360.0])
@pytest.mark.parametrize("vfov", [10.0, 60.0, 120.0, 180.0])
def test_frustum_is_its_definition(hfov: float, vfov: float) -> None:
    rng = np.random.default_rng(int(hfov * 1000 + vfov))
    positions, points = rng.normal(0, 5, (60, 3)), rng.normal(0, 15, (500, 3))
    quats = Rotation.random(60, rng).as_quat()
    camera = Camera(hfov, vfov, 2.0, 30.0)
    seen = visible(positions, quats, Cloud(points), camera, FRUSTUM).seen  # in bunches
    few = visible(positions[:9], quats[:9], Cloud(points), camera, FRUSTUM).seen  # point by point
    assert np.array_equal(few, seen[:9])
    assert np.array_equal(seen, brute_frustum(positions, quats, points, camera))
    assert seen.any() and not seen.all()


def test_nothing_behind_a_camera_is_seen_until_its_field_reaches_there() -> None:
    at, level = np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]])
    behind = Cloud(np.array([[-10.0, 0.1, 0.0], [-10.0, -3.0, 4.0]]))
    for hfov in (20.0, 90.0, 179.9, 300.0):
        assert not visible(at, level, behind, Camera(hfov, 170.0), FRUSTUM).seen.any()
    assert visible(at, level, behind, Camera(360.0, 180.0), FRUSTUM).seen.all()


def test_a_sphere_camera_sees_everything_in_range_and_turning_it_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(0, 20, (400, 3))
    camera = Camera(360.0, 180.0, 2.0, 25.0)
    quats = Rotation.random(10, rng).as_quat()
    seen = visible(np.zeros((10, 3)), quats, Cloud(points), camera, FRUSTUM).seen
    distance = np.linalg.norm(points, axis=1)
    assert np.array_equal(seen, np.tile((distance >= 2) & (distance <= 25), (10, 1)))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_moving_everything_rigidly_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(rng=rng), rng.normal(0, 30, 3)
    cloud = faces_of_box(4.0)
    positions = rng.normal(0, 12, (15, 3))
    quats = look_at(positions, rng.normal(0, 2, (15, 3)))
    vertices, triangles = box([-4, -4, -4], [4, 4, 4])
    before = visible(positions, quats, cloud, Camera(), TRUE, Scene(vertices, triangles, 1)).seen
    assert cloud.normals is not None
    moved = Cloud(turn.apply(cloud.points) + shift, turn.apply(cloud.normals))
    turned = (turn * Rotation.from_quat(quats)).as_quat()
    scene = Scene(turn.apply(vertices) + shift, triangles, 1)
    after = visible(turn.apply(positions) + shift, turned, moved, Camera(), TRUE, scene).seen
    assert (before != after).mean() < 1e-3  # only where a limit is touched to the last bits


def test_a_cube_shows_the_face_one_stands_before() -> None:
    cloud = faces_of_box(5.0)
    scene = Scene(*box([-5, -5, -5], [5, 5, 5]), 1)
    at = np.array([[20.0, 0, 0]])
    seen = visible(at, look_at(at, np.zeros((1, 3))), cloud, Camera(), TRUE, scene).seen[0]
    front = cloud.points[:, 0] == 5.0
    assert np.array_equal(seen, front)
    all_round = visible(at, look_at(at, np.zeros((1, 3))), cloud, Camera(), FRUSTUM).seen[0]
    assert all_round.all()  # the paper's frustum sees through walls


def test_a_wall_hides_and_the_incidence_limit_bites() -> None:
    cloud = Cloud(np.array([[0.0, 0, 0]]), np.array([[1.0, 0, 0]]))
    wall, plate = box([5, -1, -1], [5.1, 1, 1]), box([-0.1, -3, -3], [0.0, 3, 3])
    free = Scene(*plate, 1)
    walled = Scene(np.vstack([plate[0], wall[0]]), np.vstack([plate[1], wall[1] + 8]), 1)
    for degrees, expected in ((0, True), (74.0, True), (76.0, False), (100.0, False)):
        angle = np.radians(degrees)
        at = 12 * np.array([[np.cos(angle), np.sin(angle), 0.0]])
        quat = look_at(at, np.zeros((1, 3)))
        assert visible(at, quat, cloud, Camera(), TRUE, free).seen[0, 0] == expected
        hidden = degrees == 0
        assert visible(at, quat, cloud, Camera(), TRUE, walled).seen[0, 0] == (expected and not hidden)


def test_both_sides_of_a_thin_plate_stay_apart() -> None:
    points = np.array([[x, y, 0.0] for x in (-2.0, 0, 2) for y in (-2.0, 0, 2)])
    cloud = Cloud(np.vstack([points, points]), np.repeat([[0.0, 0, 1], [0.0, 0, -1]], 9, axis=0))
    sheet = Scene(
        np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), 1
    )
    above, below = np.array([[0.0, 0, 10]]), np.array([[0.0, 0, -10]])
    for at, expected in ((above, [True, False]), (below, [False, True])):
        seen = visible(at, look_at(at, np.zeros((1, 3))), cloud, Camera(), TRUE, sheet).seen[0]
        assert np.array_equal(seen, np.repeat(expected, 9))


def test_true_visibility_is_what_single_rays_say() -> None:
    rng = np.random.default_rng(8)
    cloud = faces_of_box(3.0, 7)
    blocks = [box(low, low + rng.uniform(0.5, 3, 3)) for low in rng.uniform(-9, 9, (12, 3))]
    blocks.append(box([-3, -3, -3], [3, 3, 3]))
    vertices = np.vstack([block[0] for block in blocks])
    triangles = np.vstack([block[1] + 8 * index for index, block in enumerate(blocks)])
    scene = Scene(vertices, triangles, 1)
    positions = rng.normal(0, 10, (40, 3))
    quats = look_at(positions, np.zeros((40, 3)))
    seen = visible(positions, quats, cloud, Camera(), TRUE, scene).seen
    normals = cloud.normals
    assert normals is not None
    expected = brute_frustum(positions, quats, cloud.points, Camera())
    for pose, index in zip(*np.nonzero(expected), strict=True):
        back = positions[pose] - cloud.points[index]
        steep = back @ normals[index] >= np.cos(np.radians(75)) * np.linalg.norm(back)
        expected[pose, index] = steep and not _blocked(
            positions[pose], cloud.points[index], vertices, triangles
        )
    assert 0.02 < expected.mean() < 0.9
    assert (seen != expected).mean() < 2e-3


def _blocked(start: Floats, end: Floats, vertices: Floats, triangles: Floats) -> bool:
    """Moeller and Trumbore, in double precision, triangle by triangle."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    ray = (end - start) * 0.999
    across = np.cross(ray, c - a)
    volume = np.einsum("ij,ij->i", b - a, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("ij,ij->i", start - a, across) / volume
        side = np.cross(start - a, b - a)
        v = side @ ray / volume
        t = np.einsum("ij,ij->i", c - a, side) / volume
    return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)).any())


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    cloud, scene = faces_of_box(5.0), Scene(*box([-5, -5, -5], [5, 5, 5]), 1)
    positions = rng.normal(0, 15, (200, 3))
    quats = look_at(positions, np.zeros((200, 3)))
    whole = visible(positions, quats, cloud, Camera(), TRUE, scene).seen
    monkeypatch.setattr(visibility, "_BLOCK", 1)
    assert np.array_equal(whole, visible(positions, quats, cloud, Camera(), TRUE, scene).seen)


def test_more_view_never_shows_less() -> None:
    rng = np.random.default_rng(4)
    cloud, scene = faces_of_box(5.0), Scene(*box([-5, -5, -5], [5, 5, 5]), 1)
    positions = rng.normal(0, 15, (60, 3))
    quats = look_at(positions, rng.normal(0, 4, (60, 3)))
    narrow = visible(positions, quats, cloud, Camera(40, 30), TRUE, scene).seen
    wide = visible(positions, quats, cloud, Camera(100, 90, 1.0, 80.0), TRUE, scene).seen
    steep = visible(positions, quats, cloud, Camera(40, 30), replace(TRUE, max_incidence_deg=60), scene).seen
    frustum = visible(positions, quats, cloud, Camera(40, 30), FRUSTUM).seen
    assert not (narrow & ~wide).any() and not (steep & ~narrow).any() and not (narrow & ~frustum).any()


def test_a_cloud_of_discs_sees_nearly_what_its_mesh_sees() -> None:
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(-6, 6, 90))
    normals = np.column_stack([np.cos(angle).ravel(), np.sin(angle).ravel(), np.zeros(angle.size)])
    points = 3 * normals + np.column_stack([np.zeros((angle.size, 2)), height.ravel()])
    structure = Structure("tube", "tower", points, np.empty((0, 3), int), normals)
    at = np.array([[15.0, 0, 0]])
    seen = visible(
        at, look_at(at, np.zeros((1, 3))), Cloud(points, normals), Camera(), TRUE, scene_of(structure, 1)
    )
    back = at - points
    cosine = np.einsum("ij,ij->i", back, normals) / np.linalg.norm(back, axis=1)
    expected = cosine >= np.cos(np.radians(75))  # a convex tube hides nothing else
    assert (seen.seen[0] != expected).mean() < 0.02


@pytest.mark.parametrize(
    "camera", [Camera(0, 75), Camera(400, 75), Camera(75, 200), Camera(75, 75, 5, 5), Camera(75, 75, -1, 5)]
)
def test_impossible_cameras_are_refused_in_words(camera: Camera) -> None:
    with pytest.raises(SettingsError, match="camera"):
        visible(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), Cloud(np.ones((1, 3))), camera, FRUSTUM)


def test_occlusion_needs_a_scene() -> None:
    with pytest.raises(SettingsError, match="scene"):
        visible(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), Cloud(np.ones((1, 3))), Camera(), TRUE)


@pytest.mark.parametrize("grain_m", [0.0, 0.3])
def test_what_any_pose_sees_is_what_all_of_them_see(grain_m: float) -> None:
    rng = np.random.default_rng(3)
    cloud = faces_of_box(3.0, 9)
    vertices, triangles = box([-3.0, -3, -3], [3.0, 3, 3])
    screens = [box(low, low + np.array([0.1, 2.0, 6.0])) for low in rng.uniform(-9, 7, (12, 3))]
    for corners, faces in screens:
        triangles = np.concatenate([triangles, faces + len(vertices)])
        vertices = np.concatenate([vertices, corners])
    scene = Scene(vertices, triangles, 1, grain_m=grain_m)
    positions = rng.uniform(-12, 12, (12, 3))
    quats = look_at(positions, rng.uniform(-3, 3, (12, 3)))
    arguments = positions, quats, cloud, Camera(50, 40, 0.5, 40), TRUE, scene
    every = visible(*arguments).seen
    few = visibility.seen_by_any(*arguments)
    assert 0.2 < few.mean() < 0.95 and (every.sum(axis=0) == 1).any()
    assert few.tolist() == every.any(axis=0).tolist()
    rng = np.random.default_rng(4)
    farthest_m, least, coarse = rng.uniform(4, 14, len(cloud)), rng.uniform(0, 0.9, len(cloud)), np.ones(12)
    coarse[::2] = 1.3
    ray = positions[:, None] - cloud.points
    away = np.linalg.norm(ray, axis=2)
    cosine = (ray * cloud.outward).sum(axis=2) / away
    near = (away * coarse[:, None] <= farthest_m * cosine) & (cosine >= least)
    closeness = Closeness(farthest_m, least, coarse)
    assert np.array_equal(visible(*arguments, closeness=closeness).seen, every & near)
    assert (every & near).any(axis=0).mean() < 0.8 * few.mean()
    nearest = visibility.seen_by_any(*arguments, closeness=closeness)
    assert nearest.tolist() == (every & near).any(axis=0).tolist() and nearest.any()
