"""Times: every limit, checked by differences of the poses that come out, and what the expert did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.config import RetimeSettings
from upplied.planning.trajectory.retime import at_demonstrated_speed, retime
from upplied.poses import from_yaw_pitch, look_at, matrices
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


def rates(planned: Trajectory) -> tuple[float, float, float, float]:
    """Largest speed, acceleration, yaw rate and pitch rate (deg/s), by differences, written anew."""
    step = np.diff(planned.t_s)
    velocity = np.diff(planned.positions, axis=0) / step[:, None]
    middles = (planned.t_s[1:] + planned.t_s[:-1]) / 2
    acceleration = np.diff(velocity, axis=0) / np.diff(middles)[:, None]
    axes = matrices(planned.quat_xyzw)
    yaw = np.unwrap(np.arctan2(-axes[:, 0, 1], axes[:, 1, 1]))
    pitch = np.arcsin(np.clip(axes[:, 2, 0], -1, 1))
    return (
        float(np.linalg.norm(velocity, axis=1).max()),
        float(np.linalg.norm(acceleration, axis=1).max(initial=0)),
        float(np.degrees(np.abs(np.diff(yaw) / step)).max()),
        float(np.degrees(np.abs(np.diff(pitch) / step)).max()),
    )


def assert_within(planned: Trajectory, limits: RetimeSettings) -> None:
    speed, acceleration, yaw, pitch = rates(planned)
    assert speed <= limits.max_speed_mps * 1.001
    assert acceleration <= limits.max_acceleration_mps2 * 1.001
    assert yaw <= limits.max_yaw_rate_degps * 1.001
    assert pitch <= limits.max_gimbal_rate_degps * 1.001
    assert planned.t_s[0] == 0 and (np.diff(planned.t_s) > 0).all()


@settings(max_examples=40, deadline=None)
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
        max_acceleration_mps2=float(rng.uniform(0.2, 4)),
        max_yaw_rate_degps=float(rng.uniform(5, 90)),
        max_gimbal_rate_degps=float(rng.uniform(5, 90)),
    )
    path = Waypoints(positions, quats, flight.t_s, rng.random(len(positions)) < 0.4)
    planned, viewpoint, _ = retime(path, flight, limits)
    assert_within(planned, limits)
    assert len(viewpoint) == len(planned)
    # Each viewpoint is still flown through, in order and looking the same way.
    wanted, kept = np.flatnonzero(path.is_viewpoint), np.flatnonzero(viewpoint)
    assert len(kept) == len(wanted)
    assert planned.positions[kept] == pytest.approx(positions[wanted], abs=1e-9)
    assert np.abs((planned.quat_xyzw[kept] * quats[wanted]).sum(axis=1)) == pytest.approx(1, abs=1e-9)


def test_the_expert_is_never_outrun() -> None:
    slow = flown(helix(), 1.5)
    planned, _, _ = retime(path_of(slow), slow, LIMITS)
    assert rates(planned)[0] <= 1.5 * 1.02
    length = np.linalg.norm(np.diff(slow.positions, axis=0), axis=1).sum()
    assert planned.t_s[-1] == pytest.approx(length / 1.5, rel=0.03)  # and not left far behind
    bigger = replace(path_of(slow), positions=3 * slow.positions)
    assert rates(retime(bigger, slow, LIMITS)[0])[0] <= 1.5 * 1.02  # metres per second do not scale


def test_jitter_makes_nobody_faster() -> None:
    flight = flown(helix(3000), 1.5)
    shaken = replace(flight, positions=flight.positions + np.random.default_rng(0).normal(0, 0.05, (3000, 3)))
    planned, _, _ = retime(path_of(flight, 10), shaken, LIMITS)
    assert (
        1.3
        < np.median(np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s))
        < 1.6
    )


def test_a_straight_line_is_flown_as_fast_as_physics_allows() -> None:
    line = np.column_stack([np.linspace(0, 100, 201), np.zeros((201, 2))])
    fast = Trajectory(np.linspace(0, 5, 201), line, np.tile([0.0, 0, 0, 1], (201, 1)))
    planned, _, _ = retime(path_of(fast), fast, LIMITS)
    ideal = 100 / 8 + 8 / 2  # cruise at 8 m/s, and half the ramps of 4 s at 2 m/s^2
    assert ideal <= planned.t_s[-1] <= 1.06 * ideal


def test_a_circle_is_flown_at_the_speed_its_curve_allows() -> None:
    angle = np.linspace(0, 4 * np.pi, 800)
    circle = np.column_stack([4 * np.cos(angle), 4 * np.sin(angle), np.zeros(800)])
    fast = replace(flown(circle, 3.5), quat_xyzw=np.tile([0.0, 0, 0, 1], (800, 1)))
    planned, _, _ = retime(path_of(fast), fast, LIMITS)
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
    planned, _, _ = retime(path_of(flight, 4), flight, LIMITS)
    speed = np.linalg.norm(np.diff(planned.positions, axis=0), axis=1) / np.diff(planned.t_s)
    still = speed < 1e-3
    assert np.diff(planned.t_s)[still].sum() == pytest.approx(12, abs=2.5)
    assert planned.positions[:-1][still][:, 0] == pytest.approx(20, abs=1.0)
    without, _, _ = retime(path_of(flight, 4), flight, replace(LIMITS, least_stop_s=60.0))
    assert without.t_s[-1] < planned.t_s[-1] - 9
    assert_within(planned, LIMITS)


def test_legs_are_short_and_the_camera_stays_level() -> None:
    flight = flown(helix(30), 2.0)
    planned, _, _ = retime(path_of(flight), flight, LIMITS)
    assert np.linalg.norm(np.diff(planned.positions, axis=0), axis=1).max() <= 0.5 + 1e-9
    assert matrices(planned.quat_xyzw)[:, 2, 1] == pytest.approx(0, abs=1e-9)


def test_looking_straight_down_is_no_reason_to_spin() -> None:
    line = np.column_stack([np.linspace(0, 30, 61), np.zeros(61), np.full(61, 9.0)])
    pitch = np.radians(-90 + 0.5 * np.sin(np.arange(61)))
    flight = Trajectory(
        np.linspace(0, 15, 61), line, from_yaw_pitch(np.zeros(61), np.clip(pitch, -np.pi / 2, None))
    )
    planned, _, _ = retime(path_of(flight), flight, LIMITS)
    assert rates(planned)[2] < 1e-6
    assert planned.t_s[-1] < 25


def test_the_papers_rule_gives_each_leg_the_demonstrated_speed() -> None:
    speed = 1 + np.arange(29) / 10
    flight = flown(helix(30), speed)
    same = at_demonstrated_speed(path_of(flight), flight)
    assert same.t_s == pytest.approx(flight.t_s)
    doubled = at_demonstrated_speed(replace(path_of(flight), positions=2 * flight.positions), flight)
    assert np.diff(doubled.t_s) == pytest.approx(2 * np.diff(flight.t_s))
    planned, viewpoint, _ = retime(path_of(flight), flight, RetimeSettings())
    assert planned.t_s == pytest.approx(flight.t_s) and viewpoint.sum() == path_of(flight).is_viewpoint.sum()


def test_one_waypoint_and_a_flight_that_never_moves() -> None:
    still = Trajectory(np.arange(10.0), np.zeros((10, 3)), np.tile([0.0, 0, 0, 1], (10, 1)))
    one = Waypoints(np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), np.zeros(1), np.ones(1, bool))
    assert len(retime(one, still, LIMITS)[0]) == 1
    path = Waypoints(helix(10), np.tile([0.0, 0, 0, 1], (10, 1)), np.arange(10.0), np.ones(10, bool))
    assert_within(retime(path, still, LIMITS)[0], LIMITS)
