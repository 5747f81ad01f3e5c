"""Which target samples answer for what was inspected, and from how near, on a handful of points."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    coverage,
    inspected_surface,
)
from upplied.planning.visibility.observations import Views
from upplied.records import Cloud, Correspondences, Trajectory

HERE = Cloud(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0]]), area_m2=np.arange(1.0, 6.0))
THERE = Cloud(np.zeros((3, 3)))
PAIRS = Correspondences(np.array([0, 0, 2, -1, 1]), np.zeros(5), np.zeros((5, 3)))
STATIONS = Trajectory(np.arange(2.0), np.array([[0.0, 3, 0], [2, 0, 4]]), np.tile([0.0, 0, 0, 1], (2, 1)))
SEEN = Views(STATIONS, np.array([[1, 1, 0, 1, 0], [1, 0, 1, 1, 0]], bool))


def test_need_is_the_area_that_answers() -> None:
    surface = inspected_surface(HERE, THERE, PAIRS, SEEN)
    assert surface.need.tolist() == [3, 0, 3] and surface.without == 4 and surface.whole == 10
    assert surface.without_pct == 40
    near = [3.0, np.sqrt(10), 4.0]
    assert surface.standoff_m[[0, 2]] == pytest.approx([(1 * near[0] + 2 * near[1]) / 3, near[2]])
    assert np.isnan(surface.standoff_m[1]) and surface.cloud is THERE


def test_weights_and_carried_distances_count() -> None:
    weight = np.array([0.5, 1, 0, 1, 1])
    surface = inspected_surface(HERE, THERE, PAIRS, SEEN, np.diag([1.0, 2.0, 3.0]), weight)
    assert surface.need.tolist() == [2.5, 0, 0] and surface.without == 4
    near = [6.0, np.sqrt(37)]
    assert surface.standoff_m[0] == pytest.approx((0.5 * near[0] + 2 * near[1]) / 2.5)
    nearest_m = np.array([7.0, np.inf, 1, 1, 1])
    near_m = inspected_surface(HERE, THERE, PAIRS, SEEN, None, weight, nearest_m)
    assert near_m.standoff_m[0] == pytest.approx((0.5 * 7 + 2 * np.sqrt(10)) / 2.5)


def test_points_without_area_count_one() -> None:
    surface = inspected_surface(Cloud(HERE.points), THERE, PAIRS, SEEN)
    assert surface.need.tolist() == [2, 0, 1] and surface.without == 1 and surface.without_pct == 25


def test_who_saw_nothing_was_about_nothing() -> None:
    blind = Views(STATIONS, np.zeros((2, 5), bool))
    surface = inspected_surface(HERE, THERE, PAIRS, blind)
    assert (
        surface.whole == 0 and np.isnan(surface.without_pct) and np.isnan(coverage(surface, np.ones(3, bool)))
    )


def test_several_flights_add_their_needs() -> None:
    one = InspectedSurface(THERE, np.array([3.0, 0, 1]), np.array([10.0, np.nan, 4]), 2.0)
    two = InspectedSurface(THERE, np.array([1.0, 0, 0]), np.array([2.0, np.nan, np.nan]), 0.5)
    both = InspectedSurface.together([one, two])
    assert both.need.tolist() == [4, 0, 1] and both.without == 2.5
    assert both.standoff_m[[0, 2]] == pytest.approx([8.0, 4.0]) and np.isnan(both.standoff_m[1])
    assert InspectedSurface.together([one]) is one


def test_coverage_is_the_share_of_the_need() -> None:
    one = InspectedSurface(THERE, np.array([3.0, 0, 1]), np.ones(3), 4.0)
    assert coverage(one, np.array([True, False, False])) == 75
    assert coverage(one, np.array([True, False, False]), whole=True) == 37.5
    assert coverage(one, np.array([True, False, True])) == 100
    assert coverage(one, np.array([True, False, True]), whole=True) == 50
    assert coverage(one, np.zeros(3, bool)) == 0
