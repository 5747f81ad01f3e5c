"""Neighbours by cubes of space: those that a tree finds, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from upplied.cubes import Cubes, nearest_of_all


def on_ball(number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points near a flattened ball, far from the origin, and its normals."""
    normals = np.random.default_rng(seed).normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * [9.0, 4.0, 2.0] + np.random.default_rng(seed + 1).normal(0, 0.02, (number, 3))
    return points + np.array([300.0, -700.0, 40.0]), normals


def uneven(number: int, seed: int) -> np.ndarray:
    """A crowd, some places where several points lie, and others that stand alone."""
    points, rng = on_ball(number, seed)[0], np.random.default_rng(seed)
    points[: number // 3] = points[0] + rng.normal(0, 0.05, (number // 3, 3))
    points[number // 3 : number // 2] = points[number // 3]
    points[-number // 10 :] += rng.uniform(-80, 80, (len(points[-number // 10 :]), 3))
    return points


@pytest.mark.parametrize("number", [1, 2, 13, 14, 40, 3000])
@pytest.mark.parametrize("seed", range(2))
def test_the_nearest_are_those_of_a_tree(number: int, seed: int) -> None:
    for points in (on_ball(number, seed)[0], uneven(number, seed)):
        count = min(13, number)
        away, nearest = cKDTree(points).query(points, k=[*range(1, count + 1)])
        found = nearest_of_all(points, count)
        np.testing.assert_array_equal(found[0], away)
        np.testing.assert_array_equal(found[1], nearest)


def test_cubes_answer_for_most_of_a_surface_and_for_nothing_that_is_as_far_as_another() -> None:
    points = on_ball(5000, 3)[0]
    wide = 1.35 * float(np.median(cKDTree(points).query(points, k=13)[0][:, -1]))
    assert Cubes.of(points, wide).nearest(13)[2].mean() > 0.99
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    assert not Cubes.of(grid, 2.0).nearest(3)[2].any()


@pytest.mark.parametrize("number", [1, 2, 900])
def test_pairs_are_all_that_are_near_and_face_alike(number: int) -> None:
    points, normals = on_ball(number, 5)
    crowd = points[: number // 4]  # with more pairs than memory is set aside for
    points[: number // 4] = points[0] + 1e-3 * (crowd - points[0])
    reach = 0.8
    begin, end, later, distance = Cubes.of(points, reach).facing(normals, reach)
    away = np.linalg.norm(points[:, None] - points, axis=2)
    wanted = np.triu((away < reach) & (normals @ normals.T > 0), 1)
    found = np.zeros((number, number))
    for one in range(number):
        rows = slice(begin[one], end[one])
        found[one, later[rows]] = distance[rows]
    np.testing.assert_allclose(np.where(found < reach, found, 0), np.where(wanted, away, 0), atol=1e-12)
    assert np.count_nonzero(found) == len(later)
