"""A cloud's surface is known to a stated error, which is kept beside every clearance."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.discs import Discs
from upplied.geometry.scene import scene_of
from upplied.records import Structure

BOX = np.array([8.0, 3.0, 5.0])  # half sizes, m


def on_box(number: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points on a box and the normals of its sides."""
    area = np.array([BOX[1] * BOX[2], BOX[0] * BOX[2], BOX[0] * BOX[1]])
    axis = rng.choice(3, number, p=area / area.sum())
    sign = rng.choice([-1.0, 1.0], number)
    points = rng.uniform(-1, 1, (number, 3)) * BOX
    points[np.arange(number), axis] = sign * BOX[axis]
    normals = np.zeros((number, 3))
    normals[np.arange(number), axis] = sign
    return points, normals


def off_box(points: np.ndarray) -> np.ndarray:
    """Distance of points outside from the box."""
    return np.linalg.norm(np.maximum(np.abs(points) - BOX, 0), axis=1)


def cloud(points: np.ndarray, normals: np.ndarray | None = None) -> Structure:
    return Structure("box", "tank", points, np.empty((0, 3), np.int64), normals)


@pytest.mark.parametrize("noise_m", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("facing", [True, False])
def test_what_a_cloud_promises_is_kept_on_the_surface_that_was_scanned(noise_m: float, facing: bool) -> None:
    rng = np.random.default_rng(3)
    points, normals = on_box(6000, rng)
    scene = scene_of(cloud(points + rng.normal(0, noise_m, points.shape), normals if facing else None), 1)
    places = rng.uniform(-1, 1, (5000, 3)) * (BOX + 4)
    away = off_box(places)
    promised, true = scene.distance(places)[away > 1], away[away > 1]
    assert (promised <= true + 1e-3).all()
    assert (true - promised).mean() < scene.error_m + scene.grain_m  # discs stand out over edges
    assert scene.error_m < max(6 * noise_m, 0.15)


def test_the_error_holds_nearly_all_of_the_surface_and_grows_with_noise_and_gaps() -> None:
    rng = np.random.default_rng(4)
    true = on_box(20_000, rng)[0]
    errors = {}
    for number in (1500, 10_000):
        for noise_m in (0.0, 0.03):
            points, normals = on_box(number, rng)
            scene = scene_of(cloud(points + rng.normal(0, noise_m, points.shape), normals), 1)
            errors[number, noise_m] = scene.error_m
            # Of the discs themselves: `distance` takes the error off.
            apart = np.linalg.norm(true - scene.closest(true)[0], axis=1)
            assert (apart > 1e-6).mean() < 1e-3
    assert errors[1500, 0.0] > 1.5 * errors[10_000, 0.0]
    assert errors[10_000, 0.03] > 1.5 * errors[10_000, 0.0]


def test_units_and_place_do_not_matter() -> None:
    points, normals = on_box(5000, np.random.default_rng(5))
    one, other = Discs.of(points, normals), Discs.of(1000 * points + 3e4, normals)
    assert other.error_m() == pytest.approx(1000 * one.error_m(), rel=1e-6)


def test_what_floats_in_the_air_tells_nothing_of_the_surface() -> None:
    rng = np.random.default_rng(6)
    points, normals = on_box(6000, rng)
    birds = rng.uniform(12, 30, (10, 3))
    alone = Discs.of(np.vstack([points, birds]), np.vstack([normals, np.eye(3)[rng.integers(0, 3, 10)]]))
    assert alone.error_m() == pytest.approx(Discs.of(points, normals).error_m(), rel=0.05)


def test_a_mesh_is_exact_and_few_points_are_as_far_off_as_they_are_apart() -> None:
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = Structure("sheet", "tank", corner, np.array([[0, 1, 2]]))
    assert scene_of(mesh, 1).error_m == 0
    few = Discs.of(corner, np.tile([0.0, 0, 1], (3, 1)))
    assert few.error_m() == few.grain_m > 0


def test_the_closest_place_is_as_far_as_the_distance_says() -> None:
    rng = np.random.default_rng(7)
    scene = scene_of(cloud(*on_box(3000, rng)), 1)
    places = rng.uniform(-1, 1, (500, 3)) * (BOX + 4)
    apart = np.linalg.norm(places - scene.closest(places)[0], axis=1)
    np.testing.assert_allclose(apart, scene.distance(places), atol=1e-5)
