"""Which target samples answer for what was inspected, and from how near, on a handful of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from upplied.planning.carry.inspected_surface import (
    InspectedSurface,
    coverage,
    inspected_surface,
)
from upplied.planning.visibility.observations import Views
from upplied.records import Cloud, Correspondences, Floats, Trajectory

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


def plane(step: float, number: int, seed: int) -> Cloud:
    """Samples about so far apart on a square, facing up; each stands for the same area."""
    places = np.stack(np.meshgrid(np.arange(number), np.arange(number), [0.0]), axis=-1).reshape(-1, 3) * step
    places[:, :2] += np.random.default_rng(seed).uniform(-0.2, 0.2, (len(places), 2)) * step
    up = np.tile([0.0, 0, 1], (len(places), 1))
    return Cloud(places, up, np.full(len(places), step**2), np.zeros(len(places), np.int64))


def onto(source: Cloud, target: Cloud, places: Floats) -> InspectedSurface:
    """What the half with x below 5 needs, whose counterparts are at these places."""
    index = cKDTree(target.points).query(places)[1]
    match = Correspondences(np.asarray(index, np.int64), np.zeros(len(index)), places)
    poses = Trajectory(np.zeros(1), np.array([[0.0, 0, 9]]), np.array([[0.0, 0, 0, 1]]))
    views = Views(poses, (source.points[:, 0] < 5)[None])
    return inspected_surface(source, target, match, views)


def test_on_itself_each_sample_needs_its_own_area() -> None:
    whole = plane(0.5, 21, 0)
    surface = onto(whole, whole, whole.points)
    assert surface.need == pytest.approx(np.where(whole.points[:, 0] < 5, 0.25, 0.0), abs=1e-6)
    assert surface.without == 0


def test_a_counterpart_that_moves_a_little_changes_little() -> None:
    """Other samples there than here: nobody's nearest is needed like its neighbours."""
    here, there = plane(0.5, 21, 0), plane(0.4, 26, 1)
    moved = here.points + np.random.default_rng(2).uniform(-0.005, 0.005, here.points.shape) * [1, 1, 0]
    before, after = onto(here, there, here.points), onto(here, there, moved)
    inside = there.points[:, 0] < 4
    assert before.need[inside] == pytest.approx(np.full(inside.sum(), 0.16))
    assert np.abs(after.need - before.need).sum() < 0.01 * before.need.sum()
    assert before.need.sum() == pytest.approx(0.16 * (there.points[:, 0] < 5).sum(), rel=0.03)


def test_surface_beside_all_counterparts_and_round_an_edge_is_not_needed() -> None:
    here = plane(0.5, 21, 0)
    wall = replace(here, points=here.points[:, [2, 1, 0]], normals=here.outward[:, [2, 1, 0]])
    longer = np.concatenate([here.points + np.array([20, 0, 0]), wall.points - np.array([0, 0, 0.3])])
    whole = Cloud(
        np.concatenate([here.points, longer]),
        np.concatenate([here.outward, here.outward, -wall.outward]),
        np.full(3 * len(here), 0.25),
        np.zeros(3 * len(here), np.int64),
    )
    surface = onto(here, whole, here.points)
    assert surface.need[: len(here)] == pytest.approx(np.where(here.points[:, 0] < 5, 0.25, 0.0), abs=1e-6)
    assert not surface.need[len(here) :].any()


def test_what_comes_to_nothing_has_no_counterpart() -> None:
    """All of it is reported, so that such a pair is refused."""
    here = plane(0.5, 21, 0)
    away = replace(here, normals=-here.outward)
    match = Correspondences(np.full(441, -1), np.zeros(441), np.full((441, 3), np.nan))
    poses = Trajectory(np.zeros(1), np.array([[0.0, 0, 9]]), np.array([[0.0, 0, 0, 1]]))
    surface = inspected_surface(here, away, match, Views(poses, (here.points[:, 0] < 5)[None]))
    assert not surface.need.any() and surface.without_pct == 100
    assert surface.without == pytest.approx(0.25 * (here.points[:, 0] < 5).sum())
