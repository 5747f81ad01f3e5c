"""Distances from overlapping discs: those of asking each disc."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.discs import DiscCells


def discs(number: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Discs on a ball and far off it, some of them large."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 10 * normals * [1.0, 2.0, 0.3] + rng.normal(0, 0.1, (number, 3))
    points[::50] += rng.uniform(-60, 60, (len(points[::50]), 3))
    radius = rng.uniform(0.1, 0.6, number)
    radius[::40] *= 8
    return points, normals, radius


def each(places: np.ndarray, points: np.ndarray, normals: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Distance (P, N) of each place from each disc."""
    way = places[:, None] - points
    above = np.einsum("pni,ni->pn", way, normals)
    aside = np.linalg.norm(way - above[:, :, None] * normals, axis=2)
    return np.hypot(above, np.maximum(aside - radius, 0))


@pytest.mark.parametrize("number", [1, 2, 30, 1500])
@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_disc_is_that_of_all(number: int, seed: int) -> None:
    known = discs(number, seed)
    places = np.random.default_rng(seed + 10).uniform(-70, 70, (400, 3))
    places = np.concatenate([places, known[0][:50]])
    cells, truth = DiscCells.of(*known), each(places, *known)
    np.testing.assert_allclose(cells.distance(places), truth.min(axis=1), atol=1e-9)
    foot, disc = cells.closest(places)
    np.testing.assert_allclose(truth[np.arange(len(places)), disc], truth.min(axis=1), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(places - foot, axis=1), truth.min(axis=1), atol=1e-9)
    np.testing.assert_allclose(each(foot, *known)[np.arange(len(places)), disc], 0, atol=1e-9)


def test_discs_at_one_place_and_nothing_asked_are_no_error() -> None:
    cells = DiscCells.of(np.zeros((5, 3)), np.tile([0.0, 0, 1], (5, 1)), np.zeros(5))
    np.testing.assert_allclose(cells.distance(np.array([[3.0, 4.0, 0.0]])), [5.0])
    assert cells.distance(np.empty((0, 3))).shape == (0,)
    assert cells.closest(np.empty((0, 3)))[0].shape == (0, 3)
