"""A plan flown in simulation: what wind, a late controller and a drifting position estimate do to it.

The vehicle is a point mass with a position controller (PD with integral, speed and its drag fed
forward), an attitude loop of first order, limits on tilt and climb, and drag on the speed through
the air. The wind is a mean wind with gusts after Dryden at low altitude (MIL-F-8785C, 3.7.3), each
axis reduced to its first-order part. The gimbal levels the camera and turns it, with a lag and a
little error. Not modelled: propeller wash near walls, lee and speed-up round the structure, battery.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from upplied.config import Settings
from upplied.errors import RefusedError, SettingsError
from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.planning.correspondence.memo import Memo, no_memo
from upplied.planning.correspondence.siblings import study
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.measures.evaluate import judge
from upplied.planning.surface.frames import demonstration_in, frames_for, in_declared, in_frame, structure_in
from upplied.records import Demonstration, Floats, Plan, Structure, Trajectory
from upplied.threads import one_thread

_GRAVITY_MPS2 = 9.81
_STEP_S = 0.02
_STEPS = 5  # of which one is returned
_AHEAD = 10  # steps
_SETTLE_S = 2.0  # hovering at the end
_FEET_PER_M = 1 / 0.3048


@dataclass(frozen=True)
class Vehicle:
    """A quadrotor of some kilograms with a camera on a gimbal."""

    stiffness_radps: float = 1.3  # natural frequency of the position loop
    damping: float = 0.9
    integral_gain: float = 0.3  # 1/s^3
    response_s: float = 0.18  # of the acceleration: attitude and motors
    max_tilt_deg: float = 30.0
    max_climb_mps2: float = 3.0
    drag_per_s: float = 0.28  # deceleration per speed through the air: 15 m/s of wind at 23 deg of tilt
    estimate_error_m: float = 0.08  # one sigma per axis, of the position estimate
    estimate_time_s: float = 15.0  # over which that error drifts
    gimbal_response_s: float = 0.15
    gimbal_error_deg: float = 0.4  # one sigma
    lost_m: float = 8.0  # farther off its reference the flight counts as lost


@dataclass(frozen=True)
class Wind:
    """The air round the structure."""

    speed_mps: float = 5.0  # mean, at 20 feet for the strength of the gusts
    towards_deg: float = 60.0  # where it blows to, counter-clockwise from the structure's +X
    gusts: bool = True


def fly_trajectory(
    trajectory: Trajectory, vehicle: Vehicle | None = None, wind: Wind | None = None, ground_z_m: float = 0.0,
    seed: int = 0,
) -> Trajectory:  # fmt: skip
    """What a vehicle really flies of a planned trajectory: camera poses at 10 Hz, structure frame.

    It begins hovering at the first waypoint and ends hovering at the last; a `RefusedError` if the vehicle
    cannot hold its path in this wind.

    Parameters
    ----------
    trajectory, vehicle, wind
        Camera poses in the structure frame, as planned; who flies them, in what air.
    ground_z_m : float
        Height of the ground, m, structure frame: gusts grow longer with height.
    seed : int
        Of gusts and errors; the same seed gives the same flight.
    """
    vehicle, wind = vehicle or Vehicle(), wind or Wind()
    if len(trajectory) == 0 or wind.speed_mps < 0:
        rule = "waypoints, and a wind of 0 or more"
        raise SettingsError("flight", "nothing to fly, or a negative wind", rule)
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, trajectory.t_s[-1] + _SETTLE_S, _STEP_S)
    planned = interpolate(trajectory, t)
    air = wind_along(planned.positions, wind, ground_z_m, rng)
    error = _drifting(len(t), vehicle.estimate_error_m, vehicle.estimate_time_s, rng)
    flown = _followed(planned.positions, air, error, vehicle)
    quats = _gimballed(planned.quat_xyzw, vehicle, rng)
    return replace(planned, positions=flown, quat_xyzw=quats).take(slice(None, None, _STEPS))


def measure_flown(
    flown: Trajectory, plan: Plan, demonstration: Demonstration, source: Structure, target: Structure,
    settings: Settings, memo: Memo = no_memo, siblings: Sequence[Structure] = (),
) -> Plan:  # fmt: skip
    """A flight measured by the same code as its plan: the plan with what depends on the path as flown.

    Parameters
    ----------
    flown : Trajectory
        Of `fly_trajectory`, or read from a log, in the frame of the target.
    plan : Plan
        What was to be flown.
    demonstration, source, target, settings, memo, siblings
        As for `upplied.planning.plan.plan_transfer`.
    """
    here, there = frames_for(source, target, settings)
    with one_thread():
        reference = [one for one in siblings if one.structure_id == plan.parts_told_by]
        pair = study(structure_in(here, source), structure_in(there, target), settings, memo, reference)
        takes = takes_of(demonstration_in(here, demonstration), pair, settings, memo)
        measures, surface, warnings = judge(in_frame(there, flown), None, takes, settings)
    seen, supposed = in_declared(there, surface), in_declared(there, pair.supposed)
    return replace(
        plan, trajectory=flown, is_viewpoint=None, measures=measures, surface=seen, supposed=supposed,
        warnings=warnings,
    )  # fmt: skip


def wind_along(positions: Floats, wind: Wind, ground_z_m: float, rng: np.random.Generator) -> Floats:
    """Wind (N, 3), m/s, structure frame, that meets a vehicle at positions (N, 3), one every 0.02 s."""
    towards = np.radians(wind.towards_deg)
    along = np.array([np.cos(towards), np.sin(towards), 0.0])
    air = np.tile(wind.speed_mps * along, (len(positions), 1))
    if not wind.gusts or wind.speed_mps <= 0:
        return air
    across = np.array([-along[1], along[0], 0.0])
    speed = np.maximum(wind.speed_mps, 1.0)
    height_ft = np.clip((positions[:, 2] - ground_z_m) * _FEET_PER_M, 10.0, 1000.0)
    sigma, length_m = dryden(height_ft, wind.speed_mps)
    axes = along, across, np.array([0.0, 0, 1])
    for axis, strength, length in zip(axes, sigma.T, length_m.T, strict=True):
        air += (strength * _first_order(np.exp(-_STEP_S * speed / length), rng))[:, None] * axis
    return air


def dryden(height_ft: Floats, wind_mps: float) -> tuple[Floats, Floats]:
    """Strength (N, 3), m/s, and length (N, 3), m, of gusts along, across and up, below 1000 feet."""
    base = 0.177 + 0.000823 * height_ft
    up = 0.1 * wind_mps * np.ones_like(height_ft)
    level, length_ft = up / base**0.4, height_ft / base**1.2
    lengths_ft = np.column_stack([length_ft, length_ft, height_ft])
    return np.column_stack([level, level, up]), lengths_ft / _FEET_PER_M


def _first_order(share: Floats, rng: np.random.Generator) -> Floats:
    """Noise (N,) of unit deviation that keeps `share` of itself from step to step."""
    noise = rng.standard_normal(len(share)) * np.sqrt(1 - share**2)
    value, values = float(rng.standard_normal()), np.empty(len(share))
    for step in range(len(share)):
        value = share[step] * value + noise[step]
        values[step] = value
    return values


def _drifting(count: int, sigma: float, time_s: float, rng: np.random.Generator) -> Floats:
    """Error (N, 3) of the position estimate, m, zero at the start, where the pilot has set it right."""
    share = np.full(count, np.exp(-_STEP_S / time_s))
    error = sigma * np.stack([_first_order(share, rng) for _ in range(3)], axis=1)
    return error * (1 - np.exp(-np.arange(count) * _STEP_S / time_s))[:, None]


def _followed(planned: Floats, air: Floats, error: Floats, vehicle: Vehicle) -> Floats:
    """Positions (N, 3) of the point mass under its controller, from hovering in the first wind."""
    frequency, flown = vehicle.stiffness_radps, np.empty_like(planned)
    gain, rate = frequency**2, 2 * vehicle.damping * frequency
    # The speed that is fed forward is the mean over 0.2 s on each side.
    padded = np.pad(planned, ((_AHEAD, _AHEAD), (0, 0)), mode="edge")
    speeds = (padded[2 * _AHEAD :] - padded[: -2 * _AHEAD]) / (2 * _AHEAD * _STEP_S)
    position, velocity = planned[0].copy(), np.zeros(3)
    integral = -vehicle.drag_per_s * air[0]  # leaning into the wind already
    thrust = integral.copy()
    for step, (goal, pace, wind, wrong) in enumerate(zip(planned, speeds, air, error, strict=True)):
        lacking = goal - position - wrong
        forward = vehicle.drag_per_s * pace  # what flying at that speed costs in still air
        acceleration = _limited(gain * lacking + rate * (pace - velocity) + integral + forward, vehicle)
        integral = integral + vehicle.integral_gain * lacking * _STEP_S
        thrust = thrust + (acceleration - thrust) * (_STEP_S / vehicle.response_s)
        velocity = velocity + (thrust - vehicle.drag_per_s * (velocity - wind)) * _STEP_S
        position = position + velocity * _STEP_S
        flown[step] = position
        if np.abs(goal - position).max() > vehicle.lost_m:
            where = f"at {goal.round(1).tolist()} after {step * _STEP_S:.0f} s"
            finding = f"is blown more than {vehicle.lost_m:g} m off its path {where}"
            rule = "a path that the vehicle can hold"
            raise RefusedError("flight", finding, rule, "fly slower, or in less wind")
    return flown


def _limited(acceleration: Floats, vehicle: Vehicle) -> Floats:
    most = _GRAVITY_MPS2 * np.tan(np.radians(vehicle.max_tilt_deg))
    (x, y, climb), steepest = acceleration, vehicle.max_climb_mps2
    level = np.hypot(x, y)
    shrink = min(1.0, most / level) if level > 0 else 1.0
    return np.array([x * shrink, y * shrink, min(max(climb, -steepest), steepest)])


def _gimballed(quat_xyzw: Floats, vehicle: Vehicle, rng: np.random.Generator) -> Floats:
    """Orientations that follow with a lag, and with a small slow error."""
    yaw, pitch = yaw_pitch(quat_xyzw)
    planned = np.column_stack([np.unwrap(yaw), pitch])
    gain = 1 - np.exp(-_STEP_S / vehicle.gimbal_response_s)
    at, turned = planned[0], np.empty_like(planned)
    for step, goal in enumerate(planned):
        at = at + gain * (goal - at)
        turned[step] = at
    share = np.full(len(turned), np.exp(-_STEP_S / 1.0))
    noise = np.stack([_first_order(share, rng) for _ in range(2)], axis=1)
    turned = turned + np.radians(vehicle.gimbal_error_deg) * noise
    return from_yaw_pitch(turned[:, 0], np.clip(turned[:, 1], -np.pi / 2, np.pi / 2))
