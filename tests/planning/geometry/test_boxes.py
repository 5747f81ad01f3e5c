"""Scale between bounding boxes, spacing of samples, and surfaces carried to the source's frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.planning.geometry.clouds import box_scale, diagonal_of, in_source_frame, spacing
from upplied.records import Cloud, Floats, Registration


def test_the_scaled_box_is_as_large_as_the_source() -> None:
    rng = np.random.default_rng(0)
    source, target = rng.normal(size=(50, 3)) * [3, 5, 2], rng.normal(size=(60, 3)) * [1, 9, 4]
    scale = box_scale(source, target)
    assert np.ptp(target * scale, axis=0) == pytest.approx(np.ptp(source, axis=0))


@pytest.mark.parametrize("flat", [0.0, 1e-9])
def test_a_flat_axis_keeps_its_scale(flat: float) -> None:
    plate = np.array([[0.0, 0, 0], [4, 0, flat], [0, 2, 0]])
    block = np.array([[0.0, 0, 0], [2, 0, 5], [0, 8, 0]])
    assert box_scale(plate, block) == pytest.approx([2, 0.25, 1])
    assert box_scale(block, plate) == pytest.approx([0.5, 4, 1])


def test_what_is_hardly_thick_is_scaled_all_the_same() -> None:
    thin, block = np.diag([1.0, 1.0, 3e-9]), np.eye(3)
    assert box_scale(thin, block)[2] == pytest.approx(3e-9)
    # Flat is up to a 1e-9 of the larger of both.
    assert box_scale(np.diag([1.0, 1.0, 1.5e-9]), block)[2] == pytest.approx(1.5e-9)
    assert box_scale(np.diag([1.0, 1.0, 1.5e-9]), 2 * block)[2] == 1.0


def test_the_diagonal_is_that_of_the_box() -> None:
    assert diagonal_of(np.array([[0.0, 0, 0], [3, 0, 0], [1, 4, 12]])) == pytest.approx(13.0)


def test_spacing_is_the_leaf_or_follows_from_the_area() -> None:
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 5.0]])
    assert spacing(Cloud(points, leaf_m=0.7)) == 0.7
    assert spacing(Cloud(points, area_m2=np.array([1.0, 2, 6, 7]))) == pytest.approx(2.0)
    # Else from the sides of the box, 2 (2 * 3 + 2 * 5 + 3 * 5) = 62, in four.
    assert spacing(Cloud(points)) == pytest.approx(np.sqrt(62 / 4))


def on_triangle(corners: Floats, number: int) -> Floats:
    share = np.random.default_rng(1).dirichlet(np.ones(3), number)
    return share @ corners


@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_are_carried_as_normals_and_areas_as_areas(mirrored: bool) -> None:
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    scale = np.array([2.0, -0.5 if mirrored else 0.5, 3.0])
    fit = Registration(scale, Rotation.from_euler("x", 25, degrees=True).as_matrix(), np.ones(3), 0.0, True,
                       turn=turn)  # fmt: skip
    corners = np.array([[0.0, 0, 0], [3, 1, 0], [1, 2, 2]])
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    area = np.linalg.norm(across) / 2
    normal = across / np.linalg.norm(across)
    points = on_triangle(corners, 7)
    cloud = Cloud(points, np.tile(normal, (7, 1)), np.full(7, area), np.arange(7), 0.3)
    moved = in_source_frame(cloud, fit)
    there = fit.to_demo(corners)
    carried = np.cross(there[1] - there[0], there[2] - there[0])
    assert moved.points == pytest.approx(fit.to_demo(points))
    assert moved.area_m2 == pytest.approx(np.full(7, np.linalg.norm(carried) / 2))
    assert moved.normals is not None and moved.part is not None
    assert moved.normals @ (there[1] - there[0]) == pytest.approx(np.zeros(7), abs=1e-12)
    assert moved.normals @ (there[2] - there[0]) == pytest.approx(np.zeros(7), abs=1e-12)
    assert np.linalg.norm(moved.normals, axis=1) == pytest.approx(np.ones(7))
    # A point off the surface, on its outside, is on its outside still.
    outside = fit.to_demo(corners.mean(axis=0) + normal) - fit.to_demo(corners.mean(axis=0))
    assert (moved.normals @ outside > 0).all()
    assert moved.part.tolist() == list(range(7)) and moved.leaf_m == 0.3


def test_points_alone_are_carried_alone() -> None:
    fit = Registration(np.full(3, 2.0), np.eye(3), np.zeros(3), 0.0, True)
    moved = in_source_frame(
        Cloud(np.ones((1, 3)), area_m2=np.ones(1), part=np.zeros(1, int), leaf_m=0.1), fit
    )
    assert moved.normals is None and moved.leaf_m == 0.1 and moved.part is not None
    assert moved.points == pytest.approx(np.full((1, 3), 2.0))
    # No normal tells in which plane a sample lies.
    plain = in_source_frame(Cloud(np.ones((1, 3)), np.array([[0.0, 0, 1]])), fit)
    assert plain.area_m2 is None
