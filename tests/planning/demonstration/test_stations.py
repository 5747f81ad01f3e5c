"""Stations of a flight: as dense as its bends, turns and hovers ask for, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from winding import turning_deg_per_m

from upplied.geometry.poses import angle_between, from_yaw_pitch, look_at, yaw_pitch
from upplied.planning.demonstration.stations import axes_of, looking, stations_of
from upplied.records import Floats, Trajectory


def flown(at: Floats, yaw: Floats | float = 0.0) -> Trajectory:
    count = len(at)
    quats = from_yaw_pitch(np.broadcast_to(yaw, count), np.full(count, -0.3))
    return Trajectory(np.linspace(0, 0.05 * (count - 1), count), at, quats)


def stations(flight: Trajectory, spacing_m: float = np.inf) -> Trajectory:
    at = flight.positions
    extent = 2 * float(np.linalg.norm(at - at.mean(axis=0), axis=1).max())
    return stations_of(flight, spacing_m, extent, float(np.linalg.norm(np.diff(at, axis=0), axis=1).sum()))


def line(length: float, count: int = 2001) -> Floats:
    return np.column_stack([np.linspace(0, length, count), np.zeros((count, 2))])


@pytest.mark.parametrize(
    ("length", "spacing", "legs"), [(80.0, np.inf, 160), (80.0, 0.25, 320), (400.0, 1.0, 400)]
)
def test_a_straight_flight_has_even_stations(length: float, spacing: float, legs: int) -> None:
    flight = flown(line(length, 8001))
    even = stations(flight, spacing)
    assert len(even) == legs + 1
    assert np.diff(even.positions[:, 0]) == pytest.approx(np.full(legs, length / legs), rel=1e-6)
    assert even.t_s == pytest.approx(np.linspace(0, 400, legs + 1), rel=1e-6)
    assert angle_between(even.quat_xyzw, np.tile(flight.quat_xyzw[:1], (legs + 1, 1))).max() < 1e-7


@pytest.mark.parametrize("radius", [2.0, 10.0, 40.0])
def test_a_circle_has_stations_that_leave_it_by_the_chord_allowed(radius: float) -> None:
    angle = np.linspace(0, 2 * np.pi, 20001)
    at = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(20001)])
    even = stations(flown(at))
    chord = min(0.03, 0.002 * 2 * radius)
    known = 2 * np.pi * radius / np.sqrt(8 * chord * radius)
    usual = 160.0
    assert len(even) - 1 == pytest.approx(np.clip(known, usual, 10 * usual), rel=0.02)
    middle = (even.positions[1:] + even.positions[:-1]) / 2
    assert radius - np.linalg.norm(middle, axis=1).min() <= chord * 1.1


def test_a_turning_camera_has_a_station_every_six_degrees() -> None:
    still = flown(np.tile([1.0, 2, 3], (401, 1)), np.linspace(0, np.radians(90), 401))
    assert len(stations_of(still, np.inf, 30.0, 100.0)) == 16  # a hover: its ends, and 15 legs of 6 degrees
    moving = flown(line(30.0, 4001), np.linspace(0, np.radians(1440), 4001))
    even = stations(moving)
    legs = np.hypot(160, 1440 * np.cos(0.3) / 6)
    assert len(even) - 1 == pytest.approx(legs, rel=0.02)
    yaw, pitch = yaw_pitch(even.quat_xyzw)
    expected = even.positions[:, 0] / 30 * np.radians(1440)
    assert np.abs((yaw - expected + np.pi) % (2 * np.pi) - np.pi).max() < 1e-3
    assert pitch == pytest.approx(np.full(len(even), -0.3), abs=1e-3)


def test_a_hover_is_two_stations_at_its_place() -> None:
    at = np.vstack(
        [line(40.0, 1001), np.tile([40.0, 0, 0], (200, 1)), line(40.0, 1001)[1:] + np.array([40.0, 0, 0])]
    )
    even = stations(flown(at))
    there = np.flatnonzero(np.abs(even.positions[:, 0] - 40) < 1e-9)
    assert len(there) == 2
    assert even.t_s[there] == pytest.approx([50.0, 60.0], abs=1e-9)


def test_there_is_a_station_right_at_a_corner() -> None:
    leg = np.linspace(0, 20, 801)[:, None]
    corner = np.array([20.0, 0, 0])
    at = np.vstack([leg * [1.0, 0, 0], corner + leg[1:] * [0.3, 1.0, 0]])
    even = stations(flown(at), 3.0)
    assert np.linalg.norm(even.positions - corner, axis=1).min() < 0.03
    gap = np.abs((even.positions - corner) @ [1.0, -0.3, 0]) * (even.positions[:, 1] > 0.1)
    assert gap.max() < 0.05


def test_short_flights_are_told_as_they_are() -> None:
    two = flown(line(3.0, 2))
    assert stations_of(two, 1.0, 3.0, 3.0) is two
    three = stations_of(flown(line(3.0, 3)), 1.0, 3.0, 3.0)
    assert three.positions[[0, -1]] == pytest.approx(line(3.0, 3)[[0, -1]])


def test_axes_say_where_a_camera_looks() -> None:
    rng = np.random.default_rng(0)
    at, to = rng.normal(size=(2, 9, 3))
    flight = Trajectory(np.arange(9.0), at, look_at(at, to))
    axes = axes_of(flight)
    assert np.cross(to - at, axes[:, :3]) == pytest.approx(np.zeros((9, 3)), abs=1e-9)
    assert axes[:, 5] == pytest.approx(np.zeros(9), abs=1e-9)  # left is level
    assert angle_between(looking(3 * axes), flight.quat_xyzw) == pytest.approx(np.zeros(9), abs=1e-6)


@pytest.mark.parametrize("radius", [3.0, 11.0])
def test_a_circle_winds_by_its_curvature(radius: float) -> None:
    angle = np.linspace(0, 2 * np.pi, 3000)
    at = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(3000)])
    assert turning_deg_per_m(at, radius / 10) == pytest.approx(np.degrees(1 / radius), rel=0.02)
    assert turning_deg_per_m(at[::20], radius / 10) == pytest.approx(np.degrees(1 / radius), rel=0.1)


def test_straight_and_short_paths_do_not_wind() -> None:
    assert turning_deg_per_m(line(9.0, 50), 0.5) == pytest.approx(0, abs=1e-4)
    assert turning_deg_per_m(line(0.9, 50), 0.5) == 0.0
    corner = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0]])
    assert turning_deg_per_m(corner, 1.0) == pytest.approx(90 / 8)
    skipped = np.array(
        [[0.0, 0, 0], [4, 0, 0], [4, 0.4, 0], [4, 0, 0], [4, 4, 0]]
    )  # a twitch below the spacing
    assert turning_deg_per_m(skipped, 1.0) == pytest.approx(90 / 8)


@pytest.mark.ci
@pytest.mark.parametrize("draw", range(8))
def test_the_last_bit_does_not_choose_the_stations(draw: int) -> None:
    """160 stations to a flight are a quotient that is whole but for the last bit."""
    angle = np.linspace(0, 5.0, 1200)
    at = np.column_stack([30 * np.cos(angle), 20 * np.sin(1.7 * angle), 3 + np.sin(9 * angle)])
    noise = 1e-12 * np.random.default_rng(draw).standard_normal(at.shape)
    plain, moved = stations(flown(at, 0.4 * angle)), stations(flown(at + noise, 0.4 * angle))
    assert len(moved) == len(plain)
    assert moved.t_s == pytest.approx(plain.t_s, abs=1e-6)
