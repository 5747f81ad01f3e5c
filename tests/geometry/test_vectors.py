"""Directions, normals and areas, each by its definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from upplied.geometry.vectors import (
    across,
    area_vectors,
    neighbour_spacing,
    plane_normals,
    scaled_normals,
    sphere,
    with_normals,
)


def unit(rng: np.random.Generator, number: int) -> np.ndarray:
    vectors = rng.normal(size=(number, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("number", [16, 48, 60, 300])
def test_directions_are_spread_evenly(number: int) -> None:
    directions = sphere(number)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    assert np.linalg.norm(directions.mean(axis=0)) < 2 / number
    nearest = cKDTree(directions).query(directions, k=2)[0][:, 1]
    assert nearest.min() > 0.5 * np.sqrt(4 * np.pi / number)  # an even share of the sphere as a square


def test_what_lies_across_a_normal_makes_right_angles() -> None:
    normals = np.vstack([unit(np.random.default_rng(0), 200), np.eye(3), -np.eye(3)])
    frame = np.stack([normals, *across(normals)], axis=1)
    assert frame @ frame.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (206, 1, 1)), abs=1e-12)


def test_a_triangles_vector_is_normal_to_it_and_twice_its_area() -> None:
    corners = np.array([[[0.0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 0, 0], [0, 4, 0], [3, 0, 0]]])
    assert area_vectors(corners).tolist() == [[0, 0, 12], [0, 0, -12]]


def test_the_plane_of_neighbours_is_theirs() -> None:
    rng = np.random.default_rng(1)
    normal, flat = unit(rng, 1)[0], rng.normal(0, 5, (40, 3))
    flat -= (flat @ normal)[:, None] * normal
    normals = plane_normals(flat + 3 * normal, rng.integers(0, 40, (7, 12)))
    assert np.abs(normals @ normal) == pytest.approx(1)


def test_a_scaled_surface_keeps_its_normals_normal() -> None:
    rng = np.random.default_rng(2)
    normals, scale = unit(rng, 50), np.array([2.0, 0.5, 7.0])
    first, second = across(normals)
    scaled = scaled_normals(normals, scale)
    assert np.linalg.norm(scaled, axis=1) == pytest.approx(1)
    for tangent in (first, second):
        assert ((tangent * scale) * scaled).sum(axis=1) == pytest.approx(np.zeros(50), abs=1e-12)


def test_two_sides_of_a_sheet_lie_twice_the_weight_apart() -> None:
    up = np.array([[0.0, 0, 1]])
    one, other = with_normals(np.ones((1, 3)), up, 0.5), with_normals(np.ones((1, 3)), -up, 0.5)
    assert one.shape == (1, 6) and np.linalg.norm(one - other) == pytest.approx(1.0)


def test_the_spacing_of_a_grid_is_its_step() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3) * 0.25
    assert neighbour_spacing(grid) == 0.25 and neighbour_spacing(grid, grid[:3]) == 0.25
    assert neighbour_spacing(grid[:1]) == 0.0
