"""Times: every limit, checked by differences of the poses that come out, and what the expert did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.config import RetimeSettings
from upplied.geometry.poses import from_yaw_pitch, in_a_row, look_at, matrices
from upplied.planning.trajectory.retime import (
    Sharp,
    at_demonstrated_speed,
    demonstrated_speed,
    hovering,
    retime,
)
from upplied.planning.trajectory.sharpness import _swung_degps
from upplied.planning.trajectory.speeds import _fits, corner_cap, passes
from upplied.records import Floats, Trajectory, Waypoints

LIMITS = RetimeSettings(limits=True)


def flown(positions: Floats, speed: float | Floats = 1.0) -> Trajectory:
    step = np.linalg.norm(np.diff(positions, axis=0), axis=1) / speed
    return Trajectory(
        np.concatenate([[0.0], np.cumsum(step)]), positions, look_at(positions, 0 * positions - 50)
    )


def path_of(flight: Trajectory, every: int = 1) -> Waypoints:
    chosen = np.arange(0, len(flight), every)
    viewpoint = np.arange(len(chosen)) % 5 == 0
    return Waypoints(flight.positions[chosen], flight.quat_xyzw[chosen], flight.t_s[chosen], viewpoint)


def helix(number: int = 300) -> Floats:
    angle = np.linspace(0, 6 * np.pi, number)
    return np.column_stack([12 * np.cos(angle), 12 * np.sin(angle), angle])


def rates(planned: Trajectory) -> dict[str, float]:
    """Largest speeds, accelerations (also of the heading) and rates, by differences, written anew."""
    step = np.diff(planned.t_s)
    velocity = np.diff(planned.positions, axis=0) / step[:, None]
    middles = (planned.t_s[1:] + planned.t_s[:-1]) / 2
    acceleration = np.diff(velocity, axis=0) / np.diff(middles)[:, None]
    axes = matrices(planned.quat_xyzw)
    yaw = np.degrees(np.unwrap(np.arctan2(-axes[:, 0, 1], axes[:, 1, 1])))
    pitch = np.degrees(np.arcsin(np.clip(axes[:, 2, 0], -1, 1)))
    turning = np.diff(yaw) / step
    return {
        "max_speed_mps": float(np.linalg.norm(velocity, axis=1).max()),
        "max_climb_mps": float(velocity[:, 2].max()),
        "max_descent_mps": float(-velocity[:, 2].min()),
        "max_acceleration_mps2": float(np.linalg.norm(acceleration, axis=1).max(initial=0)),
        "max_yaw_rate_degps": float(np.abs(turning).max()),
        "max_yaw_acceleration_degps2": float(np.abs(np.diff(turning) / np.diff(middles)).max(initial=0)),
        "max_gimbal_rate_degps": float(np.abs(np.diff(pitch) / step).max()),
    }


def assert_within(planned: Trajectory, limits: RetimeSettings) -> None:
    for name, actual in rates(planned).items():
        assert actual <= getattr(limits, name) * (1 + 1e-6) + 1e-7, name
    assert planned.t_s[0] == 0 and (np.diff(planned.t_s) > 0).all()


@settings(max_examples=120, deadline=None)
@given(st.integers(0, 2**31))
def test_limits_hold_on_any_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 40))
    positions = np.cumsum(rng.normal(0, rng.uniform(0.1, 8), (count, 3)), axis=0)
    twice = rng.integers(0, count, 3)  # looks to other sides on the spot
    positions = np.insert(positions, twice, positions[twice], axis=0)
    quats = from_yaw_pitch(rng.uniform(-3, 3, len(positions)), rng.uniform(-1.5, 0.5, len(positions)))
    flight = flown(positions + rng.normal(0, 0.01, positions.shape), rng.uniform(0.3, 15))
    limits = RetimeSettings(
        limits=True,
        max_speed_mps=float(rng.uniform(0.5, 10)),
        max_climb_mps=float(rng.uniform(0.2, 5)),
        max_descent_mps=float(rng.uniform(0.2, 5)),
        max_yaw_acceleration_degps2=float(rng.uniform(5, 300)),
        max_acceleration_mps2=float(rng.uniform(0.2, 4)),
        max_yaw_rate_degps=float(rng.uniform(5, 90)),
        max_gimbal_rate_degps=float(rng.uniform(5, 90)),
    )
    path = Waypoints(positions, quats, flight.t_s, rng.random(len(positions)) < 0.4)
    planned, viewpoint, *_ = retime(path, flight, limits)
    assert_within(planned, limits)
    assert len(viewpoint) == len(planned)
    # Each viewpoint is still flown through, in order and looking the same way.
    wanted, stops = np.flatnonzero(path.is_viewpoint), np.flatnonzero(viewpoint)
    assert len(stops) == len(wanted)
    assert planned.positions[stops] == pytest.approx(positions[wanted], abs=1e-9)
    assert np.abs((planned.quat_xyzw[stops] * quats[wanted]).sum(axis=1)) == pytest.approx(1, abs=1e-9)


def test_the_expert_is_never_outrun() -> None:
    slow = flown(helix(), 1.5)
    planned, *_ = retime(path_of(slow), slow, LIMITS)
    assert rates(planned)["max_speed_mps"] <= 1.5 * 1.02
    length = np.linalg.norm(np.diff(slow.positions, axis=0), axis=1).sum()
    assert planned.t_s[-1] == pytest.approx(length / 1.5, rel=0.03)  # and not left far behind
    bigger = replace(path_of(slow), positions=3 * slow.positions)
    assert (
        rates(retime(bigger, slow, LIMITS)[0])["max_speed_mps"] <= 1.5 * 1.02
    )  # metres per second do not scale


def test_jitter_makes_nobody_faster() -> None:
    flight = flown(helix(3000), 1.5)
    shaken = replace(flight, positions=flight.positions + np.random.default_rng(0).normal(0, 0.05, (3000, 3)))
    planned, *_ = retime(path_of(flight, 10), shaken, LIMITS)
    assert (
        1.3
        < np.median(np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s))
        < 1.6
    )


def test_a_straight_line_is_flown_as_fast_as_physics_allows() -> None:
    line = np.column_stack([np.linspace(0, 100, 201), np.zeros((201, 2))])
    fast = Trajectory(np.linspace(0, 5, 201), line, np.tile([0.0, 0, 0, 1], (201, 1)))
    planned, *_ = retime(path_of(fast), fast, LIMITS)
    ideal = 100 / 8 + 8 / 2  # cruise at 8 m/s, and half the ramps of 4 s at 2 m/s^2
    assert ideal <= planned.t_s[-1] <= 1.06 * ideal


def test_a_circle_is_flown_at_the_speed_its_curve_allows() -> None:
    angle = np.linspace(0, 4 * np.pi, 800)
    circle = np.column_stack([4 * np.cos(angle), 4 * np.sin(angle), np.zeros(800)])
    fast = replace(flown(circle, 3.5), quat_xyzw=np.tile([0.0, 0, 0, 1], (800, 1)))
    planned, *_ = retime(path_of(fast), fast, LIMITS)
    speed = np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s)
    assert np.median(speed) == pytest.approx(np.sqrt(2.0 * 4), rel=0.05)
    assert_within(planned, LIMITS)


def test_hovering_to_look_is_kept_and_hesitation_is_not() -> None:
    positions = np.repeat(np.column_stack([np.linspace(0, 40, 801), np.zeros((801, 2))]), 1, axis=0)
    step = np.full(800, 0.05)
    step[400] += 12.0
    step[200] += 1.0
    flight = Trajectory(
        np.concatenate([[0.0], np.cumsum(step)]), positions, np.tile([0.0, 0, 0, 1], (801, 1))
    )
    planned, *_ = retime(path_of(flight, 4), flight, LIMITS)
    speed = np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s)
    still = speed < 1e-3
    assert np.diff(planned.t_s)[still].sum() == pytest.approx(12, abs=2.5)
    assert planned.positions[:-1][still][:, 0] == pytest.approx(20, abs=1.0)
    without, *_ = retime(path_of(flight, 4), flight, replace(LIMITS, least_stop_s=60.0))
    assert without.t_s[-1] < planned.t_s[-1] - 9
    assert_within(planned, LIMITS)


def test_legs_are_short_and_the_camera_stays_level() -> None:
    flight = flown(helix(30), 2.0)
    planned, *_ = retime(path_of(flight), flight, LIMITS)
    assert np.linalg.norm(np.diff(planned.positions, axis=0), axis=1).max() <= 0.5 + 1e-9
    assert matrices(planned.quat_xyzw)[:, 2, 1] == pytest.approx(0, abs=1e-9)


def test_looking_straight_down_is_no_reason_to_spin() -> None:
    line = np.column_stack([np.linspace(0, 30, 61), np.zeros(61), np.full(61, 9.0)])
    pitch = np.radians(-90 + 0.5 * np.sin(np.arange(61)))
    flight = Trajectory(
        np.linspace(0, 15, 61), line, from_yaw_pitch(np.zeros(61), np.clip(pitch, -np.pi / 2, None))
    )
    planned, *_ = retime(path_of(flight), flight, LIMITS)
    assert rates(planned)["max_yaw_rate_degps"] < 1e-6
    assert planned.t_s[-1] < 25


def test_the_papers_rule_gives_each_leg_the_demonstrated_speed() -> None:
    speed = 1 + np.arange(29) / 10
    flight = flown(helix(30), speed)
    same = at_demonstrated_speed(path_of(flight), flight)
    assert same.t_s == pytest.approx(flight.t_s)
    doubled = at_demonstrated_speed(replace(path_of(flight), positions=2 * flight.positions), flight)
    assert np.diff(doubled.t_s) == pytest.approx(2 * np.diff(flight.t_s))
    planned, viewpoint, *_ = retime(path_of(flight), flight, RetimeSettings())
    assert planned.t_s == pytest.approx(flight.t_s) and viewpoint.sum() == path_of(flight).is_viewpoint.sum()


def test_one_waypoint_and_a_flight_that_never_moves() -> None:
    still = Trajectory(np.arange(10.0), np.zeros((10, 3)), np.tile([0.0, 0, 0, 1], (10, 1)))
    one = Waypoints(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), np.zeros(1), np.ones(1, bool))
    assert len(retime(one, still, LIMITS)[0]) == 1
    path = Waypoints(helix(10), np.tile([0.0, 0, 0, 1], (10, 1)), np.arange(10.0), np.ones(10, bool))
    assert_within(retime(path, still, LIMITS)[0], LIMITS)


def crooked(seed: int) -> tuple[Waypoints, Trajectory]:
    """A path that turns back on itself, with repeated places and a camera that looks anywhere."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 60))
    at = np.cumsum(rng.normal(size=(count, 3)) * rng.choice([0.3, 2, 8]), axis=0)
    at = np.repeat(at, rng.integers(1, 3, count), axis=0) if seed % 3 == 0 else at
    t_s = np.cumsum(rng.uniform(0.2, 2, len(at)))
    quats = from_yaw_pitch(rng.uniform(-3, 3, len(at)), rng.uniform(-1, 0.5, len(at)))
    flight = Trajectory(t_s - t_s[0], at, quats)
    return Waypoints(at, quats, flight.t_s, np.ones(len(at), bool)), flight


@pytest.mark.parametrize("seed", range(12))
def test_one_sharp_corner_slows_the_path_down_there_and_nowhere_else(seed: int) -> None:
    """What precedes a corner far off is flown as if there were none; and so is every hover."""
    path, flight = crooked(seed)
    line = np.column_stack([np.linspace(-200, -1, 400), np.zeros((400, 2))]) + path.positions[0]
    t_s = np.linspace(0, 100, 400)
    level = np.tile(path.quat_xyzw[:1], (400, 1))
    whole = Trajectory(
        np.concatenate([t_s, 101 + flight.t_s]),
        np.vstack([line, flight.positions]),
        np.vstack([level, path.quat_xyzw]),
    )
    both = Waypoints(whole.positions, whole.quat_xyzw, whole.t_s, np.ones(len(whole), bool))
    planned, *_ = retime(both, whole, LIMITS)
    alone, *_ = retime(Waypoints(line, level, t_s, np.ones(400, bool)), Trajectory(t_s, line, level), LIMITS)
    far = planned.positions[:, 0] < path.positions[0, 0] - 60
    same = alone.positions[:, 0] < path.positions[0, 0] - 60
    assert planned.t_s[: far.argmin()] == pytest.approx(alone.t_s[: same.argmin()], rel=0.03, abs=0.15)
    assert_within(planned, LIMITS)


def test_the_speeds_are_the_largest_that_fit() -> None:
    """A leg that is not at its cap cannot be any faster beside the speeds of its neighbours."""
    rng = np.random.default_rng(2)
    slower = 0
    for seed in range(20):
        legs = rng.normal(0, 1, (30, 3)) * rng.uniform(0.3, 3)
        legs = np.repeat(legs, 5, axis=0)
        turns = rng.normal(0, 0.1, len(legs))
        rest = np.zeros(len(legs) + 1, bool)
        rest[[0, 75, -1]] = True
        cap = np.minimum(corner_cap(legs, turns, rest, 2.0, 2.0), rng.uniform(0.5, 6, len(legs)))
        speed = passes(cap, legs, turns, rest, 2.0, 2.0)
        assert (speed <= cap).all() and (speed > 0).all()
        for index in np.flatnonzero(speed < 0.999 * cap):
            beside = [n for n in (index - 1, index + 1) if 0 <= n < len(legs) and not rest[max(n, index)]]
            faster = 1.01 * speed[index]
            blocked = [
                n
                for n in beside
                if speed[n] <= faster and not _fits(speed[n], faster, n, index, (legs, turns, 2.0, 2.0))
            ]
            assert blocked, (seed, index)
            slower += 1
    assert slower > 200


def test_climbing_and_descending_have_limits_of_their_own() -> None:
    mast = np.column_stack(
        [np.zeros((201, 2)), np.concatenate([np.linspace(0, 50, 101), np.linspace(49.5, 0, 100)])]
    )
    flight = Trajectory(np.arange(201) / 20, mast, np.tile([0.0, 0, 0, 1], (201, 1)))  # 10 m/s
    limits = replace(LIMITS, max_climb_mps=4.0, max_descent_mps=1.5)
    planned, *_ = retime(path_of(flight), flight, limits)
    actual = rates(planned)
    assert actual["max_climb_mps"] == pytest.approx(4, rel=0.01)
    assert actual["max_descent_mps"] == pytest.approx(1.5, rel=0.01)
    assert planned.t_s[-1] == pytest.approx(50 / 4 + 50 / 1.5, rel=0.12)


def test_a_gap_in_the_flight_is_no_hover_and_crossed_as_fast_as_the_expert_flew() -> None:
    """Two loops one after another: the seam lasts 10 s and leads over 20 m, at no demonstrated speed."""
    loop = helix(400) * [1, 1, 0]
    one = flown(loop, 1.2)
    two = replace(one, positions=np.add(one.positions, [0.0, 0, 20]), t_s=one.t_s + one.t_s[-1] + 10)
    flight = in_a_row([one, two])
    seam = np.array([400])
    path = path_of(flight)
    assert hovering(path, flight, 3.0, seam).sum() == 0
    speed = demonstrated_speed(np.array([one.t_s[-1] + 5, 50.0]), flight, seam)
    assert speed == pytest.approx(1.2, rel=0.1)
    faster = demonstrated_speed(np.array([one.t_s[-1] + 5, 50.0]), flight, seam, 2.0)
    assert faster == pytest.approx([2.0, 1.2], rel=0.1)
    planned, _, answers, _ = retime(path, flight, LIMITS, seam)
    between = (answers > one.t_s[-1]) & (answers < two.t_s[0])
    climb = planned.positions[between, 2]
    assert np.ptp(planned.t_s[between]) < 1.2 * np.ptp(climb) / 1.2
    closed = Trajectory(flight.t_s, np.vstack([one.positions] * 2), flight.quat_xyzw)
    assert hovering(path, closed, 3.0, seam).sum() == 0  # it ends where it begins, and nobody waited there


def test_sharp_pictures_bound_speed_and_turning_where_something_is_shown_and_nowhere_else() -> None:
    """Two straight lines of one heading each, 90 degrees apart, and the way from one to the other."""
    x = np.linspace(0, 20, 41)
    ends = [np.column_stack([x, 0 * x, 0 * x]), np.column_stack([x + 60, 0 * x, 0 * x])]
    quats = np.repeat(from_yaw_pitch(np.array([0.0, np.pi / 2]), np.zeros(2)), 41, axis=0)
    times = np.concatenate([x / 2, x / 2 + 20])
    flight = Trajectory(times, np.vstack(ends), quats)
    path = Waypoints(flight.positions, quats, times, np.zeros(82, bool))
    slow = np.where(np.arange(82) < 20, 0.5, np.inf)
    sharp = Sharp(slow, np.full(82, 5.0))
    apart, _, answers, _ = retime(path, flight, LIMITS, np.array([41]), sharp)
    between = (answers >= 10) & (answers <= 20)
    assert np.ptp(apart.t_s[between]) < 25  # 40 m at no more than 2 m/s
    speed = np.linalg.norm(np.diff(apart.positions, axis=0), axis=1) / np.diff(apart.t_s)
    shown_slowly = apart.positions[1:, 0] < 9.5
    assert speed[shown_slowly].max() <= 0.5 * (1 + 1e-9)
    assert speed[(apart.positions[:-1, 0] > 12) & (apart.positions[1:, 0] < 18)].min() > 1


def test_a_camera_pans_no_faster_than_it_is_sharp_unless_the_expert_swung_it() -> None:
    x = np.linspace(0, 20, 81)
    yaw = np.radians(np.clip((x - 8) * 30, 0, 120))
    path = np.column_stack([x, 0 * x, 0 * x])
    flight = Trajectory(x, path, from_yaw_pitch(yaw, 0 * yaw))  # 1 m/s, 30 deg/s from 8 to 12 s
    along = path_of(flight)
    usual = Sharp(np.full(81, np.inf), np.full(81, 5.0))
    slow, *_ = retime(along, flight, LIMITS, None, usual)
    assert rates(slow)["max_yaw_rate_degps"] <= 5 * (1 + 1e-6)
    assert slow.t_s[-1] > 120 / 5
    swung = Sharp(usual.speed_mps, np.maximum(5.0, _swung_degps(along.t_s, flight)))
    fast, *_ = retime(along, flight, LIMITS, None, swung)
    assert 20 < rates(fast)["max_yaw_rate_degps"] <= 30 * (1 + 1e-6)
    assert fast.t_s[-1] < 26
    still = (fast.positions[1:, 0] < 7) | (fast.positions[1:, 0] > 13)
    assert np.abs(np.diff(np.degrees(yaw_of(fast)))[still]).max() < 1e-6


def yaw_of(planned: Trajectory) -> Floats:
    axes = matrices(planned.quat_xyzw)
    return np.unwrap(np.arctan2(axes[:, 1, 0], axes[:, 0, 0]))


def test_beside_a_place_that_is_to_be_sharp_the_whole_legs_are_flown_slowly() -> None:
    """The legs to it and from it: what lies between two waypoints is as sharp as the slower one asks."""
    at = np.column_stack([np.arange(5) * 10.0, np.zeros((5, 2))])
    flight = Trajectory(np.arange(5) * 4.0, at, np.tile([0.0, 0, 0, 1], (5, 1)))  # 2.5 m/s
    sharp = Sharp(np.array([np.inf, np.inf, 0.5, np.inf, np.inf]), np.full(5, np.inf))
    planned, *_ = retime(path_of(flight), flight, LIMITS, None, sharp)
    speed = np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s)
    middle = (planned.positions[1:, 0] + planned.positions[:-1, 0]) / 2
    beside = (middle > 10.5) & (middle < 29.5)
    assert speed[beside] == pytest.approx(np.full(beside.sum(), 0.5), rel=0.01)
    assert speed[(middle > 3) & (middle < 7)].min() > 1.5 and speed[(middle > 33) & (middle < 37)].min() > 1.5
