"""Times in which a pilot stands still, found in flights whose pauses are known."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.demonstration.stations import pauses, steadied
from upplied.records import Floats, Trajectory


def flown(speed: Floats, tick: float = 0.1, noise: float = 0.0) -> Trajectory:
    """Along a line at these speeds, m/s, one for each tick."""
    along = np.concatenate([[0.0], np.cumsum(speed * tick)])
    at = np.column_stack([along, np.zeros((len(along), 2))])
    at += np.random.default_rng(0).normal(0, noise, at.shape) if noise else 0.0
    return Trajectory(tick * np.arange(len(along)), at, np.tile([0.0, 0, 0, 1], (len(along), 1)))


def speeds(*parts: tuple[float, float], tick: float = 0.1) -> Floats:
    return np.concatenate([np.full(round(lasts / tick), speed) for lasts, speed in parts])


def test_pauses_at_the_very_same_place_are_exact() -> None:
    flight = flown(speeds((10, 2.0), (4, 0.0), (10, 2.0), (3.05, 0.0), (10, 2.0)))
    first, second = pauses(flight)
    assert first == pytest.approx((10.0, 14.0)) and second == pytest.approx((24.0, 27.0), abs=0.1)
    assert pauses(flight, 3.5) == [(pytest.approx(10.0), pytest.approx(14.0))]
    assert len(pauses(flight, 4.1)) == 0


def test_slow_flight_is_a_pause_from_where_it_falls_below_a_quarter() -> None:
    slow = flown(speeds((10, 2.0), (6, 0.3), (10, 2.0)), noise=0.002)
    (pause,) = pauses(slow)
    assert pause == (pytest.approx(10, abs=0.6), pytest.approx(16, abs=0.6))
    assert 4.8 < pause[1] - pause[0] < 6.0  # what is averaged rounds its ends off
    assert len(pauses(flown(speeds((10, 2.0), (6, 0.45), (10, 2.0)), noise=0.002))) == 1
    assert not pauses(flown(speeds((10, 2.0), (6, 0.6), (10, 2.0)), noise=0.002))
    dip = flown(speeds((10, 2.0), (4, 0.45), (1.5, 0.1), (4, 0.45), (10, 2.0)), noise=0.002)
    ((begin, end),) = pauses(dip)
    assert end - begin > 7.5  # all of the slow stretch round the stand


def test_start_and_landing_are_no_pauses() -> None:
    assert not pauses(flown(speeds((5, 0.0), (20, 2.0), (5, 0.0))))
    still = flown(speeds((5, 0.0), (20, 2.0), (5, 0.0), (1, 2.0)))
    assert pauses(still) == [(pytest.approx(25.0), pytest.approx(30.0))]


def test_hesitations_and_short_flights_are_no_pauses() -> None:
    assert not pauses(flown(speeds((10, 2.0), (2.5, 0.0), (10, 2.0))))
    assert not pauses(flown(speeds((1, 2.0), (3.4, 0.0), (1, 2.0))))  # less than twice the least in all
    assert len(pauses(flown(speeds((1.5, 2.0), (3.4, 0.0), (1.5, 2.0))))) == 1
    assert not pauses(flown(np.zeros(200)))
    assert not pauses(flown(speeds((0.2, 2.0), (0.1, 0.0)), tick=0.1), 0.05)


def test_repeated_poses_of_a_log_are_no_stand() -> None:
    """A log that holds each position for a second at walking speed."""
    flight = flown(speeds((40, 1.0)))
    positions = flight.positions[(np.arange(len(flight)) // 9) * 9]
    assert not pauses(Trajectory(flight.t_s, positions, flight.quat_xyzw))


def test_known_places_are_told_once() -> None:
    flight = flown(speeds((10, 2.0), (5, 0.0), (1, 0.3), (10, 2.0)))
    assert pauses(flight) == [(pytest.approx(10.0), pytest.approx(15.0))]


def test_even_times_and_means_of_about_a_second() -> None:
    flight = flown(speeds((20, 3.0)), noise=0.0)
    times, positions = steadied(flight)
    assert times[[0, -1]] == pytest.approx([0, 20]) and np.diff(times) == pytest.approx(np.full(200, 0.1))
    assert positions[20:-20, 0] == pytest.approx(3 * times[20:-20], abs=1e-9)
    jump = Trajectory(np.arange(201) * 0.1, np.where(np.arange(201)[:, None] < 100, 0.0, 1.0) * [1.0, 0, 0],
                      flight.quat_xyzw)  # fmt: skip
    step = steadied(jump)[1][:, 0]
    from math import erf

    known = [(1 + erf((at - 9.95) / 0.4 / np.sqrt(2))) / 2 for at in times]
    assert step == pytest.approx(known, abs=0.01)
