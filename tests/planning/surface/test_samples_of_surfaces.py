"""Laws of the surface samples, checked where the outside is known by geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

from upplied.config import CloudSettings
from upplied.geometry.scene import scene_of
from upplied.planning.surface.lattice import shares, thin
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Structure

SETTINGS = CloudSettings(surface_samples=1500)
BOX = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)
FACES = np.array(
    [
        0,
        2,
        1,
        0,
        3,
        2,
        4,
        5,
        6,
        4,
        6,
        7,
        0,
        1,
        5,
        0,
        5,
        4,
        1,
        2,
        6,
        1,
        6,
        5,
        2,
        3,
        7,
        2,
        7,
        6,
        3,
        0,
        4,
        3,
        4,
        7,
    ]
).reshape(12, 3)
SIZE = np.array([10.0, 6.0, 4.0])


def mesh(*pieces: tuple[np.ndarray, np.ndarray]) -> Structure:
    offset, vertices, triangles = 0, [], []
    for points, faces in pieces:
        vertices.append(points)
        triangles.append(np.asarray(faces) + offset)
        offset += len(points)
    return Structure("s", "test", np.concatenate(vertices), np.concatenate(triangles))


def box(size: np.ndarray = SIZE, low: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return BOX * size + low, FACES


def sample(structure: Structure, settings: CloudSettings = SETTINGS) -> Cloud:
    return surface_samples(structure, scene_of(structure, 1), settings)


def hull(seed: int) -> tuple[np.ndarray, np.ndarray]:
    points = np.random.default_rng(seed).normal(size=(40, 3)) * [9.0, 5.0, 3.0]
    return points, ConvexHull(points).simplices  # of arbitrary winding


def ball(number: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere, wound outwards."""
    points = np.random.default_rng(1).normal(size=(number, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    corners = points[faces]
    inward = np.linalg.det(corners) < 0
    return points, np.where(inward[:, None], faces[:, ::-1], faces)


AREA = 2 * (SIZE[0] * SIZE[1] + SIZE[1] * SIZE[2] + SIZE[2] * SIZE[0])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_convex_is_wholly_outside(seed: int) -> None:
    points, faces = hull(seed)
    cloud = sample(mesh((points, faces)))
    solid = ConvexHull(points)
    assert cloud.area_m2 is not None and cloud.normals is not None
    assert cloud.area_m2.sum() == pytest.approx(solid.area, rel=0.01)
    assert len(cloud) == pytest.approx(SETTINGS.surface_samples, rel=0.2)
    # Every sample lies on a facet of the hull, and its normal is the outward one of that facet.
    height = cloud.points @ solid.equations[:, :3].T + solid.equations[:, 3]
    np.testing.assert_allclose(height.max(axis=1), 0, atol=1e-9)
    facing = np.einsum("ij,ij->i", cloud.normals, solid.equations[height.argmax(axis=1), :3])
    np.testing.assert_allclose(facing, 1, atol=1e-6)


def test_each_face_of_a_box_has_its_area() -> None:
    cloud = sample(mesh(box()))
    for axis in range(3):
        for sign in (1, -1):
            on = cloud.normals[:, axis] * sign > 0.9
            assert cloud.area_m2[on].sum() == pytest.approx(np.delete(SIZE, axis).prod(), rel=0.02)


def test_interiors_do_not_count() -> None:
    nested = mesh(box(), box(SIZE * 0.5, SIZE * 0.25), box(SIZE * 0.2, SIZE * 0.4))
    cloud = sample(nested)
    assert cloud.area_m2.sum() == pytest.approx(AREA, rel=0.03)
    on_wall = (np.abs(cloud.points) < 1e-9) | (np.abs(cloud.points - SIZE) < 1e-9)
    assert on_wall.any(axis=1).all()


@pytest.mark.parametrize("flip", [False, True])
def test_copies_of_faces_count_once(flip: bool) -> None:
    points, faces = box()
    copies = faces[:6, ::-1] if flip else faces[:6]
    cloud = sample(mesh((points, faces), (points, copies), (points, copies)))
    assert cloud.area_m2.sum() == pytest.approx(AREA, rel=0.03)
    apart = cKDTree(cloud.points).query(cloud.points, k=2)[0][:, 1]
    assert np.percentile(apart, 5) > 0.45 * np.sqrt(AREA / len(cloud))


def test_winding_does_not_matter() -> None:
    points, faces = box()
    flipped = np.where((np.arange(12) % 3 == 0)[:, None], faces[:, ::-1], faces)
    cloud = sample(mesh((points, flipped)))
    outward = np.einsum("ij,ij->i", cloud.normals, cloud.points - SIZE / 2)
    assert (outward > 0).all()
    assert cloud.area_m2.sum() == pytest.approx(AREA, rel=0.02)


def test_sheet_has_two_sides() -> None:
    points = np.array([[0.0, 0, 0], [8, 0, 0], [8, 0, 5], [0, 0, 5]])
    cloud = sample(mesh((points, [[0, 1, 2], [0, 2, 3]])))
    assert cloud.area_m2.sum() == pytest.approx(80, rel=0.01)
    assert cloud.area_m2[cloud.normals[:, 1] > 0.9].sum() == pytest.approx(40, rel=0.05)


def test_thin_plate_keeps_both_skins() -> None:
    cloud = sample(mesh(box(np.array([20.0, 20.0, 0.05]))))
    up, down = cloud.normals[:, 2] > 0.9, cloud.normals[:, 2] < -0.9
    assert cloud.area_m2[up].sum() == pytest.approx(400, rel=0.03)
    assert cloud.area_m2[down].sum() == pytest.approx(400, rel=0.03)


def test_open_bottom_is_closed_by_the_floor() -> None:
    points, faces = box()
    cloud = sample(mesh((points, faces[2:])))  # no bottom
    assert cloud.area_m2.sum() == pytest.approx(AREA - SIZE[0] * SIZE[1], rel=0.03)


def test_open_top_shows_its_inside() -> None:
    points, faces = box()
    shell = np.delete(faces, [2, 3], axis=0)
    cloud = sample(mesh((points, shell)))
    inside = np.einsum("ij,ij->i", cloud.normals, cloud.points - SIZE / 2) < 0
    assert cloud.area_m2[inside].sum() == pytest.approx(AREA - SIZE[0] * SIZE[1], rel=0.05)


@pytest.mark.parametrize("cut", [0.1, 0.3])
@pytest.mark.parametrize("flip", [False, True])
def test_what_was_never_scanned_does_not_show_the_inside_of_the_rest(cut: float, flip: bool) -> None:
    points, faces = ball(2000)
    points = points * [12.0, 1.0, 1.0]
    faces = faces[points[faces].mean(axis=1)[:, 0] < 12 - 24 * cut]
    corners = points[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    drawn = mesh((points, faces[:, ::-1] if flip else faces))
    whole, cloud = sample(drawn), sample(replace(drawn, surface="scanned"))
    inward = np.einsum("ij,ij->i", whole.normals, whole.points * [0, 1, 1]) < 0
    assert inward.mean() > 0.06  # what was drawn is open as it is meant to be
    outward = np.einsum("ij,ij->i", cloud.normals, cloud.points * [0, 1, 1])
    assert (outward > 0).mean() > 0.95
    assert cloud.area_m2.sum() == pytest.approx(area.sum() / 2, rel=0.05)


def test_a_duct_that_touches_another_piece_shows_its_inside() -> None:
    points, faces = ball(2000)
    corners = points[faces].mean(axis=1)[:, 0]
    duct = points * [10.0, 1.0, 1.0], faces[np.abs(corners) < 0.8]
    cloud = sample(mesh(duct, box(SIZE, np.array([-5.0, 0.95, -2.0]))))
    mine = np.linalg.norm(cloud.points[:, 1:], axis=1) < 1.01
    inward = np.einsum("ij,ij->i", cloud.normals, cloud.points * [0, 1, 1])[mine] < 0
    assert inward.mean() > 0.1


def test_a_plate_welded_to_a_shell_keeps_both_sides() -> None:
    points, faces = box()
    fin = np.array([[0.0, 0, 4], [10, 0, 4], [10, 0, 7], [0, 0, 7]])
    cloud = sample(mesh((np.vstack([points, fin]), np.vstack([faces, [[8, 9, 10], [8, 10, 11]]]))))
    above = cloud.points[:, 2] > 4.01
    for sign in (1, -1):
        assert cloud.area_m2[above & (sign * cloud.normals[:, 1] > 0.9)].sum() == pytest.approx(30, rel=0.06)


def test_samples_keep_apart() -> None:
    cloud = sample(mesh(hull(4)))
    apart = cKDTree(cloud.points).query(cloud.points, k=2)[0][:, 1]
    even = np.sqrt(cloud.area_m2.sum() / len(cloud))
    assert np.percentile(apart, 5) > 0.6 * even
    assert cloud.area_m2.max() < 5 * cloud.area_m2.mean()


def test_deterministic_and_moved_with_the_structure() -> None:
    points, faces = hull(5)
    one, again = sample(mesh((points, faces))), sample(mesh((points, faces)))
    np.testing.assert_array_equal(one.points, again.points)
    np.testing.assert_array_equal(one.area_m2, again.area_m2)
    moved = sample(mesh((points + np.array([100.0, -50, 20]), faces)))
    assert len(moved) == pytest.approx(len(one), rel=0.02)
    assert moved.area_m2.sum() == pytest.approx(one.area_m2.sum(), rel=1e-3)


@pytest.mark.parametrize("with_normals", [True, False])
def test_point_cloud_uses_its_points(with_normals: bool) -> None:
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(6000)
    height = np.linspace(-1, 1, 6000)
    ring = np.sqrt(1 - height**2)
    unit = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    structure = Structure("s", "test", 5 * unit, np.empty((0, 3), np.int64), unit if with_normals else None)
    cloud = sample(structure)
    assert len(cloud) == pytest.approx(SETTINGS.surface_samples, rel=0.03)
    assert cloud.area_m2.sum() == pytest.approx(4 * np.pi * 25, rel=0.1)
    assert np.einsum("ij,ij->i", cloud.normals, cloud.points / 5).min() > 0.95


def test_thinning_gives_every_area_away() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((3000, 2)) * 10, np.zeros(3000)])
    normals = np.tile([0.0, 0, 1], (3000, 1))
    index = thin(points, normals, 500, 100.0)
    area = shares(points, normals, np.full(3000, 1 / 30), index)
    assert len(index) == pytest.approx(500, abs=5)
    assert area.sum() == pytest.approx(100)
    nearest = index[np.linalg.norm(points[:, None, :] - points[None, index, :], axis=2).argmin(axis=1)]
    cells = np.array([np.count_nonzero(nearest == index) / 30 for index in index])
    assert np.corrcoef(area, cells)[0, 1] > 0.95 and np.abs(area - cells).mean() < 0.15 * cells.mean()
    # A millimetre decides little of whose an area is: on a grid of lines half of it lies as near to four.
    places = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)
    kept = np.flatnonzero(places.sum(axis=1) % 2 == 0)
    moved = places + rng.uniform(-0.003, 0.003, places.shape)
    up = np.tile([0.0, 0, 1], (400, 1))
    before, after = (shares(some, up, np.ones(400), kept) for some in (places, moved))
    assert np.abs(after / before - 1).max() < 0.03
