"""Caps of speeds at corners and at rest, and passes along a path, by closed forms of steady acceleration."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.trajectory.speeds import corner_cap, passes
from upplied.records import Bools, Floats

ACCELERATION, ANGULAR = 2.0, 1.5
NONE = 1e9


def rest_at(count: int, *places: int) -> Bools:
    rest = np.zeros(count + 1, bool)
    rest[list(places)] = True
    return rest


def straight(lengths: list[float]) -> Floats:
    return np.array([[0.6 * length, 0.8 * length, 0.0] for length in lengths])


def test_beside_rest_half_a_leg_is_there_to_accelerate() -> None:
    legs, still = straight([3.0, 5.0, 7.0, 2.0]), np.zeros(4)
    cap = corner_cap(legs, still, rest_at(4, 0, 3, 4), ACCELERATION, ANGULAR)
    # v within half a leg's time, l / 2 v: v^2 = a l / 2.
    assert cap[[0, 2, 3]] == pytest.approx([np.sqrt(3.0), np.sqrt(7.0), np.sqrt(2.0)]) and cap[1] > 1e5


def test_beside_rest_a_turning_heading_is_accelerated_too() -> None:
    legs, turns = straight([4.0, 4.0]), np.array([2.0, -2.0])
    cap = corner_cap(legs, turns, rest_at(2, 0, 1, 2), NONE, ANGULAR)
    # A rate of v b within l / 2 v, with b = 0.5 rad/m.
    assert cap == pytest.approx(np.full(2, np.sqrt(ANGULAR * 4 / (2 * 0.5))))


@pytest.mark.parametrize("degrees", [10.0, 90.0, 180.0])
def test_a_corner_turns_the_velocity_from_middle_to_middle(degrees: float) -> None:
    angle = np.radians(degrees)
    legs = np.array([[3.0, 0, 0], 5 * np.array([np.cos(angle), 0, np.sin(angle)])])
    cap = corner_cap(legs, np.zeros(2), rest_at(2), ACCELERATION, ANGULAR)
    change = 2 * np.sin(angle / 2)  # of the unit vectors, in a time of 4 m / v
    assert cap == pytest.approx(np.full(2, np.sqrt(ACCELERATION * 4 / change)))
    stopped = corner_cap(legs, np.zeros(2), rest_at(2, 1), ACCELERATION, ANGULAR)
    assert stopped == pytest.approx([np.sqrt(3.0), np.sqrt(5.0)])


def test_a_change_of_the_headings_turn_is_a_corner_as_well() -> None:
    legs, turns = straight([2.0, 6.0]), np.array([1.0, -1.5])
    cap = corner_cap(legs, turns, rest_at(2), NONE, ANGULAR)
    assert cap == pytest.approx(np.full(2, np.sqrt(ANGULAR * 4 / 0.75)))
    steady = corner_cap(legs, np.array([1.0, 3.0]), rest_at(2), NONE, ANGULAR)
    assert (steady > 1e5).all()


def test_each_leg_keeps_the_least_of_its_corners() -> None:
    legs = np.array([[2.0, 0, 0], [0, 2.0, 0], [0, 2.0, 0], [0.0, 0, 2.0]])
    cap = corner_cap(legs, np.zeros(4), rest_at(4), ACCELERATION, ANGULAR)
    assert cap == pytest.approx(np.full(4, np.sqrt(ACCELERATION * 2 / np.sqrt(2))))
    gentle = np.array([[2.0, 0, 0], [1.99, 0.2, 0], [0, 2.0, 0]])
    first, middle, last = corner_cap(gentle, np.zeros(3), rest_at(3), ACCELERATION, ANGULAR)
    assert first > middle and middle == last


def test_speeds_grow_and_fall_as_a_steady_acceleration_allows() -> None:
    count, step = 200, 0.5
    legs, still, rest = straight([step] * count), np.zeros(count), rest_at(count, 0, count)
    cap = np.minimum(corner_cap(legs, still, rest, ACCELERATION, ANGULAR), 6.0)
    speed = passes(cap, legs, still, rest, ACCELERATION, ANGULAR)
    assert speed == pytest.approx(speed[::-1])
    middle = (np.arange(count) + 0.5) * step
    free = np.minimum(np.sqrt(2 * ACCELERATION * np.minimum(middle, count * step - middle)), 6.0)
    assert (speed <= free * 1.01).all()
    assert speed[4:-4] == pytest.approx(free[4:-4], rel=0.05)
    change = np.diff(speed) / (step * (1 / speed[1:] + 1 / speed[:-1]) / 2)
    assert np.abs(change).max() <= ACCELERATION * (1 + 1e-9)
    assert np.abs(change)[:20].max() > 0.9 * ACCELERATION


def test_a_slow_leg_slows_its_neighbours_on_both_sides_and_a_stop_parts_them() -> None:
    count = 60
    legs, still = straight([1.0] * count), np.zeros(count)
    cap = np.full(count, 5.0)
    cap[30] = 1.0
    speed = passes(cap, legs, still, rest_at(count), ACCELERATION, ANGULAR)
    assert speed[30] == 1 and speed[31] == pytest.approx(speed[29]) and 1 < speed[31] < 3
    assert speed[0] == speed[-1] == 5
    parted = passes(cap, legs, still, rest_at(count, 31), ACCELERATION, ANGULAR)
    assert (parted[31:] == 5).all() and parted[:31] == pytest.approx(speed[:31])
    before = passes(cap, legs, still, rest_at(count, 30), ACCELERATION, ANGULAR)
    assert (before[:30] == 5).all() and before[30:] == pytest.approx(speed[30:])


def test_a_heading_that_turns_more_needs_time_to_do_so() -> None:
    count = 40
    legs = straight([1.0] * count)
    turns = np.where(np.arange(count) < 20, 0.0, 0.5)
    rest = rest_at(count)
    cap = np.minimum(corner_cap(legs, turns, rest, NONE, ANGULAR), 8.0)
    speed = passes(cap, legs, turns, rest, NONE, ANGULAR)
    rate = speed * turns
    lasts = (1 / speed[1:] + 1 / speed[:-1]) / 2
    assert (np.abs(np.diff(rate)) <= ANGULAR * lasts * (1 + 1e-9)).all()
    assert speed[19] == speed[20] == pytest.approx(np.sqrt(ANGULAR / 0.5)) and speed[0] == 8
    assert speed[-1] > speed[21] > speed[20]


def test_legs_of_different_length_and_direction_keep_the_limit() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        legs, turns = rng.normal(0, 1.5, (25, 3)), rng.normal(0, 0.3, 25)
        rest = rest_at(25, 0, 25)
        cap = np.minimum(corner_cap(legs, turns, rest, ACCELERATION, ANGULAR), rng.uniform(0.5, 5, 25))
        speed = passes(cap, legs, turns, rest, ACCELERATION, ANGULAR)
        length = np.linalg.norm(legs, axis=1)
        velocity, rate = legs * (speed / length)[:, None], turns * speed / length
        lasts = (length[1:] / speed[1:] + length[:-1] / speed[:-1]) / 2
        assert (np.linalg.norm(np.diff(velocity, axis=0), axis=1) <= ACCELERATION * lasts * (1 + 1e-9)).all()
        assert (np.abs(np.diff(rate)) <= ANGULAR * lasts * (1 + 1e-9)).all()
