"""One decision on a leash agrees with the distance, and deviations of paths are those of the curve."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.geometry.frechet import curve_spread, frechet, spread, suffices


def within_leash(first: np.ndarray, second: np.ndarray, leash: float) -> bool:
    first, second = (np.ascontiguousarray(curve, float) for curve in (first, second))
    return bool(suffices(first, second, leash, *np.empty((2, len(second), 2))))


@pytest.mark.parametrize("seed", range(40))
def test_a_leash_suffices_from_the_distance_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dimension = int(rng.integers(1, 4))
    a, b = (np.cumsum(rng.normal(size=(int(rng.integers(2, 9)), dimension)), axis=0) for _ in range(2))
    distance = frechet(a, b)
    for share in (0.3, 0.9, 0.999, 1 - 1e-7):
        assert not within_leash(a, b, share * distance)
    for share in (1 + 1e-7, 1.001, 1.5, 9.0):
        assert within_leash(a, b, share * distance)
    assert within_leash(b, a, 1.0001 * distance) and not within_leash(b, a, 0.9999 * distance)


def test_curves_that_come_back_need_the_leash_of_their_turns() -> None:
    """A walk that goes back by 2 while the other goes on: half of that, whatever the ends say."""
    there = np.array([[0.0, 0], [6, 0], [4, 0], [10, 0]])
    straight = np.array([[0.0, 0], [10, 0]])
    assert frechet(there, straight) == pytest.approx(1.0)
    assert frechet(straight, there) == pytest.approx(1.0)
    beside = straight + np.array([0.0, 3.0])
    assert frechet(there, beside) == pytest.approx(np.hypot(1, 3))


def test_the_result_is_as_exact_as_asked() -> None:
    rng = np.random.default_rng(5)
    a, b = (np.cumsum(rng.normal(size=(12, 3)), axis=0) for _ in range(2))
    exact = frechet(a, b)
    rough = frechet(a, b, 0.05)
    assert exact <= rough <= 1.05 * exact
    assert frechet(a, a + np.array([3.0, 4.0, 0.0])) <= 5 + 1e-9


def test_a_point_is_as_far_as_the_farthest_of_the_curve() -> None:
    path = np.array([[0.0, 0], [3, 4], [1, 1]])
    for one, other in ((path, path[:1]), (path[:1], path)):
        assert frechet(one, other) == 5.0
        assert within_leash(one, other, 5.0) and not within_leash(one, other, 4.999)
    assert frechet(path[:1], path[1:2]) == 5.0
    assert frechet(path, path) == 0.0


def test_the_spread_is_by_length() -> None:
    corner = np.array([[0.0, 0], [6, 0], [6, 2]])
    mean, deviation = curve_spread(corner)
    assert mean == pytest.approx([(6 * 3 + 2 * 6) / 8, (6 * 0 + 2 * 1) / 8])
    square = np.array([(6 * 12 + 2 * 36) / 8, (2 * 4 / 3) / 8])
    assert deviation == pytest.approx(np.sqrt(square - mean**2))
    level = np.array([[0.0, 0], [100, 1]])
    assert spread(level)[1] == pytest.approx([100 / np.sqrt(12), 10 / np.sqrt(12)])
    still = np.ones((3, 2))
    assert curve_spread(still)[1].tolist() == [0, 0] and spread(still)[1].tolist() == [1, 1]
