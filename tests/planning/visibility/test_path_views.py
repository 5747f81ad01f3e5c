"""Poses at which a path is asked what it sees: close enough, its own among them, and never too many."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import VisibilitySettings
from upplied.geometry.poses import angle_between, from_yaw_pitch
from upplied.planning.visibility.observations import BY_FRUSTUM, TRULY, Views, stations, views
from upplied.records import Camera, Cloud, Trajectory


def path(turn_deg: float = 0.0, t_s: tuple[float, ...] = (0.0, 2.0, 3.0)) -> Trajectory:
    at = np.array([[0.0, 0, 0], [2, 0, 0], [2, 3.1, 0]])
    yaw = np.radians([0.0, turn_deg, turn_deg])
    return Trajectory(np.array(t_s), at, from_yaw_pitch(yaw, np.zeros(3)))


def test_stations_stand_every_half_metre() -> None:
    actual = stations(path())
    assert len(actual) == 4 + 7 + 1
    assert actual.positions[[0, 4, 11]] == pytest.approx(path().positions)
    assert actual.positions[:5, 0] == pytest.approx(np.linspace(0, 2, 5))
    assert actual.positions[4:, 1] == pytest.approx(np.linspace(0, 3.1, 8))
    assert actual.t_s == pytest.approx(np.concatenate([np.linspace(0, 2, 5), 2 + np.arange(1, 8) / 7]))


def test_turning_takes_stations_as_moving_does() -> None:
    actual = stations(path(turn_deg=30.0))  # 4 half metres and 10 times 3 degrees
    assert len(actual) == 14 + 7 + 1
    steps = angle_between(actual.quat_xyzw[:-1], actual.quat_xyzw[1:])
    assert steps[:14] == pytest.approx(np.full(14, np.radians(30 / 14)), abs=1e-6)
    assert steps[14:] == pytest.approx(np.zeros(7), abs=1e-6)


def test_where_they_would_be_too_many_the_spacing_grows() -> None:
    actual = stations(path(), most=9)  # 10.2 steps in 6: one each 1.7
    assert len(actual) == 3 + 4 + 1
    assert actual.positions[[0, 3, 7]] == pytest.approx(path().positions)


@pytest.mark.parametrize("most", [3, 50, 400])
def test_a_path_of_more_poses_is_thinned_to_some_of_its_own(most: int) -> None:
    rng = np.random.default_rng(0)
    at = np.cumsum(np.abs(rng.normal(0, 0.2, (400, 3))), axis=0)
    dense = Trajectory(np.arange(400.0), at, from_yaw_pitch(np.zeros(400), np.zeros(400)))
    actual = stations(dense, most)
    assert len(actual) <= most and actual.t_s[0] == 0 and actual.t_s[-1] == 399
    own = actual.t_s.astype(int)
    assert np.array_equal(actual.positions, at[own]) and np.array_equal(
        actual.quat_xyzw, dense.quat_xyzw[own]
    )
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(at, axis=0), axis=1))])[own]
    assert np.diff(along).max() < along[-1] / (most - 1) + 1.5  # evenly by the way, not by the poses


def test_a_path_that_stands_still_keeps_its_poses() -> None:
    still = Trajectory(np.arange(5.0), np.zeros((5, 3)), np.tile([0.0, 0, 0, 1], (5, 1)))
    assert len(stations(still)) == 5
    assert len(stations(still, most=4)) <= 4
    one = Trajectory(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))
    assert stations(one) is one


def test_views_are_asked_at_the_stations() -> None:
    cloud = Cloud(np.array([[10.0, 0, 0], [10.0, 8.5, 0], [-10.0, 0, 0]]))
    actual = views(path(), cloud, Camera(75, 75, 1, 50), BY_FRUSTUM)
    assert np.array_equal(actual.stations.t_s, stations(path()).t_s)
    assert actual.seen[0].tolist() == [True, False, False] and actual.total.tolist() == [True, True, False]
    assert Views(path(), np.eye(3, dtype=bool)[:, :2]).total.tolist() == [True, True]


def test_what_the_measures_call_seen() -> None:
    assert VisibilitySettings(occlusion=False) == BY_FRUSTUM
    assert TRULY.occlusion and TRULY.max_incidence_deg == 75.0
