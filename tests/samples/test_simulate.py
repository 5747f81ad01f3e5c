"""The simulated flight: laws of the vehicle and of the wind, and the margin that a plan keeps."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.errors import RefusedError, SettingsError
from upplied.geometry.poses import angle_between, from_yaw_pitch, interpolate
from upplied.planning.plan import plan_transfer
from upplied.records import Plan, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import Vehicle, Wind, dryden, fly_trajectory, measure_flown, wind_along

CALM = Wind(speed_mps=0.0, gusts=False)
FLAWLESS = Vehicle(estimate_error_m=0.0, gimbal_error_deg=0.0)


def circle(radius: float = 20.0, speed: float = 2.0, height: float = 15.0) -> Trajectory:
    angle = np.linspace(0, 2 * np.pi, 240)
    positions = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(240, height)])
    return Trajectory(angle * radius / speed, positions, from_yaw_pitch(angle + np.pi, 0 * angle))


def hover(seconds: float = 120.0, height: float = 15.0) -> Trajectory:
    t = np.array([0.0, seconds])
    return Trajectory(t, np.tile([1.0, 2.0, height], (2, 1)), from_yaw_pitch(np.zeros(2), np.zeros(2)))


def strayed(flown: Trajectory, plan: Trajectory) -> np.ndarray:
    return np.linalg.norm(flown.positions - interpolate(plan, flown.t_s).positions, axis=1)


def test_in_calm_air_a_flawless_vehicle_flies_the_plan() -> None:
    plan = circle()
    flown = fly_trajectory(plan, FLAWLESS, CALM)
    # It starts from rest where the plan starts at speed: after some seconds it has caught up.
    assert strayed(flown, plan)[200:-30].max() < 0.3
    assert np.median(strayed(flown, plan)) < 0.15
    radius = np.hypot(*flown.positions[:, :2].T)
    assert np.abs(radius - 20).max() < 0.4
    turned = angle_between(flown.quat_xyzw, interpolate(plan, flown.t_s).quat_xyzw)
    assert np.degrees(turned).max() < 2.0


def test_a_slower_flight_strays_less() -> None:
    slow, quick = (circle(speed=speed) for speed in (1.0, 4.0))
    assert (
        strayed(fly_trajectory(slow, FLAWLESS, CALM), slow).max()
        < 0.5 * strayed(fly_trajectory(quick, FLAWLESS, CALM), quick).max()
    )


def test_it_hovers_in_a_steady_wind() -> None:
    plan = hover()
    flown = fly_trajectory(plan, FLAWLESS, Wind(10.0, gusts=False))
    assert strayed(flown, plan).max() < 0.01


@pytest.mark.ci
def test_gusts_push_it_about_and_more_so_in_more_wind() -> None:
    plan = hover(300.0)
    strays = [
        np.sqrt(np.mean(strayed(fly_trajectory(plan, FLAWLESS, Wind(speed), seed=1), plan) ** 2))
        for speed in (3.0, 6.0, 12.0)
    ]
    assert 0.01 < strays[0] < 0.5 * strays[2]
    assert strays[0] < strays[1] < strays[2]


def test_the_frame_of_the_wind_turns_with_the_path() -> None:
    """Turning plan and wind by a quarter turns the flight."""
    plan = circle()
    turned = Trajectory(plan.t_s, plan.positions @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], plan.quat_xyzw)
    one = fly_trajectory(plan, Vehicle(estimate_error_m=0.0), Wind(6.0, 10.0), seed=4)
    two = fly_trajectory(turned, Vehicle(estimate_error_m=0.0), Wind(6.0, 100.0), seed=4)
    assert np.allclose(one.positions @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], two.positions, atol=1e-9)


def test_gusts_have_the_strength_and_length_of_the_standard() -> None:
    positions = np.tile([0.0, 0.0, 30.0], (400_000, 1))
    wind = Wind(8.0, towards_deg=0.0)
    air = wind_along(positions, wind, 0.0, np.random.default_rng(3))
    sigma, length = dryden(np.array([30 / 0.3048]), 8.0)
    assert air.mean(axis=0) == pytest.approx([8.0, 0.0, 0.0], abs=0.25)
    assert air.std(axis=0) == pytest.approx(sigma[0], rel=0.1)
    for axis in range(3):
        gust = air[:, axis] - air[:, axis].mean()
        lag = int(length[0, axis] / 8.0 / 0.02)
        share = (gust[lag:] * gust[:-lag]).mean() / gust.var()
        assert share == pytest.approx(np.exp(-1), abs=0.12)
    # MIL-F-8785C at 1000 feet: isotropic, and as long as the height.
    sigma, length = dryden(np.array([1000.0]), 10.0)
    assert sigma[0] == pytest.approx([1, 1, 1])
    assert length[0] == pytest.approx([304.8] * 3)


def test_tilt_and_climb_are_limited() -> None:
    t = np.array([0.0, 0.5, 8.0])
    leap = Trajectory(
        t, np.array([[0.0, 0, 5], [6.0, 0, 9], [6.0, 0, 9]]), from_yaw_pitch(np.zeros(3), np.zeros(3))
    )
    vehicle = Vehicle(estimate_error_m=0.0, drag_per_s=0.0)
    flown = fly_trajectory(leap, vehicle, CALM)
    pull = np.diff(flown.positions, n=2, axis=0) / 0.1**2
    assert np.hypot(pull[:, 0], pull[:, 1]).max() <= 9.81 * np.tan(np.radians(30)) * 1.001
    assert np.abs(pull[:, 2]).max() <= 3.003
    assert np.abs(flown.positions[-1] - leap.positions[-1]).max() < 0.5


@pytest.mark.ci
def test_the_error_of_the_estimate_is_flown() -> None:
    plan = hover(600.0)
    flown = fly_trajectory(plan, Vehicle(estimate_error_m=0.5), CALM, seed=2)
    off = flown.positions - plan.positions[0]
    assert off.std(axis=0) == pytest.approx([0.5] * 3, rel=0.45)


def test_the_same_seed_is_the_same_flight() -> None:
    one, again, other = (fly_trajectory(circle(), seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(one.positions, again.positions)
    assert np.array_equal(one.quat_xyzw, again.quat_xyzw)
    assert np.abs(one.positions - other.positions).max() > 0.05


def test_a_storm_is_refused() -> None:
    with pytest.raises(RefusedError, match="blown more than"):
        fly_trajectory(circle(), wind=Wind(40.0))
    with pytest.raises(SettingsError, match="negative wind"):
        fly_trajectory(circle(), wind=Wind(-1.0))


def test_one_waypoint_is_held() -> None:
    one = Trajectory(np.zeros(1), np.array([[1.0, 2.0, 8.0]]), from_yaw_pitch(np.zeros(1), np.zeros(1)))
    flown = fly_trajectory(one, wind=Wind(3.0))
    assert np.abs(flown.positions - one.positions).max() < 1.0


@pytest.mark.ci
def test_a_flight_is_measured_like_its_plan() -> None:
    cube, cuboid = (member(name).structure for name in ("cube-v1", "cuboid-v1"))
    flight = fly(cube, "sides", seed=1)
    settings = settings_for("recommended")
    plan = plan_transfer(flight, cube, cuboid, settings)
    assert isinstance(plan, Plan)
    assert plan.trajectory is not None
    planned = measure_flown(plan.trajectory, plan, flight, cube, cuboid, settings).measures
    assert planned.coverage_seen_pct == pytest.approx(plan.measures.coverage_seen_pct)
    assert planned.min_clearance_m == pytest.approx(plan.measures.min_clearance_m)
    flown = fly_trajectory(plan.trajectory, wind=Wind(6.0), seed=3)
    measured = measure_flown(flown, plan, flight, cube, cuboid, settings).measures
    assert measured.coverage_seen_pct > plan.measures.coverage_seen_pct - 10
    assert abs(measured.min_clearance_m - plan.measures.min_clearance_m) < 2.0
    assert measured.min_clearance_m != plan.measures.min_clearance_m
