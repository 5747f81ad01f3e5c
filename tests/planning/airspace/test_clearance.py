"""Clearance of whole paths against closed forms and dense sampling."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import legs_below, path_clearance
from upplied.records import Floats

TRIANGLE = np.array([[0, 1, 2]])


def tiny(at: Floats) -> Scene:
    """A scene that is nearly one point."""
    return Scene(np.asarray(at) + 1e-6 * np.eye(3), TRIANGLE, 1)


def dense(path: Floats, pieces: int = 400) -> Floats:
    share = np.linspace(0, 1, pieces)[:, None]
    return np.stack([a + share * (b - a) for a, b in itertools.pairwise(path)])


def test_a_leg_between_safe_waypoints_is_found_to_touch() -> None:
    path = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 20, 0]])
    nearest = path_clearance(tiny([3.0, 1.5, 0]), path)
    assert nearest.distance_m == pytest.approx(1.5, abs=0.006)
    assert nearest.leg == 0 and nearest.position == pytest.approx([3, 0, 0], abs=0.2)
    assert legs_below(tiny([3.0, 1.5, 0]), path[:-1], path[1:], 2.0).tolist() == [True, False]


def test_a_path_through_the_surface_has_no_clearance() -> None:
    sheet = Scene(np.array([[0.0, -5, -5], [0, 5, -5], [0, 0, 9]]), TRIANGLE, 1)
    assert path_clearance(sheet, np.array([[-3.0, 0, 0], [4, 0, 0]])).distance_m <= 0.006


def test_paths_of_one_point_and_hovering() -> None:
    scene = tiny([0.0, 0, 0])
    assert path_clearance(scene, np.array([[3.0, 4, 0]])).distance_m == pytest.approx(5, abs=1e-4)
    assert path_clearance(scene, np.array([[3.0, 4, 0]] * 3)).distance_m == pytest.approx(5, abs=1e-4)
    still = np.array([[3.0, 4, 0]] * 2)
    assert legs_below(scene, still, still, 4.9).tolist() == [False, False]
    assert legs_below(scene, still[:0], still[:0], 9.0).tolist() == []


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_agrees_with_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(0, 5, (12, 3))
    scene = Scene(vertices, np.arange(12).reshape(4, 3), 1)
    path = rng.normal(0, 12, (int(rng.integers(2, 8)), 3))
    sampled = scene.distance(dense(path)).reshape(len(path) - 1, -1).min(axis=1)
    spacing = np.linalg.norm(np.diff(path, axis=0), axis=1).max() / 399
    nearest = path_clearance(scene, path)
    assert nearest.distance_m <= sampled.min() + 0.005 + 1e-5
    assert nearest.distance_m >= sampled.min() - spacing / 2 - 1e-5
    assert nearest.certain_m <= sampled.min() + 1e-5
    assert scene.distance(nearest.position)[0] == pytest.approx(nearest.distance_m, abs=1e-4)
    for limit in (0.5, 2.0, 5.0):
        below = legs_below(scene, path[:-1], path[1:], limit)
        assert below[sampled < limit].all()
        assert not below[sampled > limit + 0.006 + spacing / 2].any()


def test_moving_both_changes_nothing_even_far_from_the_origin() -> None:
    rng = np.random.default_rng(1)
    vertices, path = rng.normal(0, 5, (9, 3)), rng.normal(0, 9, (6, 3))
    triangles, shift = np.arange(9).reshape(3, 3), np.array([4.5e5, 5.2e6, 300.0])
    here = path_clearance(Scene(vertices, triangles, 1), path)
    there = path_clearance(Scene(vertices + shift, triangles, 1), path + shift)
    assert there.distance_m == pytest.approx(here.distance_m, abs=0.01)


def test_a_long_path_along_a_wall_costs_little() -> None:
    wall = Scene(
        np.array([[-300.0, 0, -50], [300, 0, -50], [300, 0, 50], [-300, 0, 50]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        1,
    )
    calls = []
    distance = wall.distance
    wall.distance = lambda points: (calls.append(len(points)), distance(points))[1]  # type: ignore[assignment]
    path = np.column_stack([np.linspace(-200, 200, 5), np.full(5, 3.0), np.zeros(5)])
    assert path_clearance(wall, path).distance_m == pytest.approx(3, abs=1e-4)
    assert sum(calls) < 2500


def test_legs_of_a_path_are_judged_as_legs_anywhere() -> None:
    rng = np.random.default_rng(8)
    path = np.cumsum(rng.normal(0, 1.5, (60, 3)), axis=0)
    scene, order = tiny(path[30] + 1.0), rng.permutation(59)
    together = legs_below(scene, path[:-1], path[1:], 3.0)
    np.testing.assert_array_equal(legs_below(scene, path[:-1][order], path[1:][order], 3.0), together[order])
    assert 0 < together.sum() < 59
