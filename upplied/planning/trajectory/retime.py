"""Time stamps: as fast as the expert flew (paper, Sec. III-C), or so under the limits of the vehicle.

Under limits, the speed along the path is the largest that nowhere exceeds the demonstrated one, the
vehicle's, what the curve allows, or what the turning camera allows, and that can be reached and left
in time: one pass forwards and one backwards over the stations (time-optimal path parameterisation).
All limits hold for Euclidean norms, curves and braking together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.config import RetimeSettings
from upplied.planning.demonstration.pauses import pauses, steadied
from upplied.poses import angle_between, from_yaw_pitch, yaw_pitch
from upplied.records import Bools, Floats, Ints, Record, Trajectory, Waypoints

_STEP_M = 0.5  # largest leg of the result
_FINE_M, _PIECES = 0.05, 6  # smallest pieces, and most of them, of a leg that begins or ends at rest
_SLOWEST = 0.2  # of the mean speed: slower was hesitation, which is not copied
_STILL = 0.25  # of the usual speed: slower is a pause
_EVENED_M = 3.0  # along the demonstration, to each side, over which its speed is averaged
_MARGIN = 0.98  # of the limits, for what the stations do not show
_REPAIRS = 8


def retime(path: Waypoints, flight: Trajectory, settings: RetimeSettings) -> tuple[Trajectory, Bools, Floats]:
    """Give a path its times.

    Parameters
    ----------
    path : Waypoints
        `t_s` is the time of the demonstration that each answers to.
    flight : Trajectory
        The demonstration.
    settings : RetimeSettings
        Without `limits`, the paper's rule.

    Returns
    -------
    Trajectory
        With further poses under limits, so that speeds and turns are told as they are flown.
    array of bool
        Which of its poses are viewpoints.
    array
        Time of the demonstration, s, that each of its poses answers to.
    """
    if not settings.limits or len(path) < 2:
        return at_demonstrated_speed(path, flight), np.array(path.is_viewpoint, bool), path.t_s
    path = _without_repeats(path)
    hover = hovering(path, flight, settings.least_stop_s)
    stations = _divided(path, hover)
    bound = np.minimum(demonstrated_speed(stations.t_s, flight), settings.max_speed_mps * _MARGIN)
    times = _timed(stations, bound, settings)
    quats = from_yaw_pitch(stations.yaw, stations.pitch)
    return Trajectory(times, stations.positions, quats), stations.is_viewpoint, stations.t_s


@dataclass(frozen=True, eq=False, repr=False)
class _Stations(Record):
    """Where the speed is decided."""

    positions: Floats  # (S, 3) m
    yaw: Floats  # (S,) rad, unwrapped
    pitch: Floats  # (S,) rad
    t_s: Floats  # (S,) time of the demonstration
    is_viewpoint: Bools  # (S,)
    at_rest: Bools  # (S,)
    hold_s: Floats  # (S - 1,) least time of each leg besides that for turning


def at_demonstrated_speed(path: Waypoints, flight: Trajectory) -> Trajectory:
    """Each leg as fast as the expert flew between the same two places (paper, Sec. III-C)."""
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(flight.positions, axis=0), axis=1))])
    demo = np.diff(np.interp(path.t_s, flight.t_s, flown))
    spent = np.diff(path.t_s)
    leg = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    overall = max(flown[-1] / max(flight.t_s[-1], 1e-9), 1e-3)
    speed = np.where(demo > 1e-6, demo / np.maximum(spent, 1e-9), overall)
    step = np.maximum(leg / np.maximum(speed, 0.05), 1e-3)
    return Trajectory(np.concatenate([[0.0], np.cumsum(step)]), path.positions, path.quat_xyzw)


def _without_repeats(path: Waypoints) -> Waypoints:
    """The path without waypoints that repeat the pose before them."""
    moved = np.linalg.norm(np.diff(path.positions, axis=0), axis=1) > 1e-6
    turned = angle_between(path.quat_xyzw[:-1], path.quat_xyzw[1:]) > 1e-6
    keep = np.concatenate([[True], moved | turned])
    viewpoint = np.logical_or.reduceat(path.is_viewpoint, np.flatnonzero(keep))
    return Waypoints(path.positions[keep], path.quat_xyzw[keep], path.t_s[keep], viewpoint)


def hovering(path: Waypoints, flight: Trajectory, least_s: float) -> Floats:
    """Seconds (W,) to hover at each waypoint, as the expert did at the place it answers to."""
    hover = np.zeros(len(path))
    for begin, end in pauses(flight, least_s):
        hover[int(np.abs(path.t_s - (begin + end) / 2).argmin())] += end - begin
    return hover


def _divided(path: Waypoints, hover: Floats) -> _Stations:
    """The path with shorter legs; a hover is a leg of no length, as is a turn on the spot."""
    length = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    standing = length < 1e-6
    rest = hover > 0
    rest[[0, -1]] = True
    rest[:-1] |= standing
    rest[1:] |= standing
    slow = rest[:-1] | rest[1:]
    pieces = np.maximum(np.ceil(length / _STEP_M - 1e-9).astype(int), 1)
    pieces[slow] = np.maximum(pieces[slow], np.clip(length[slow] / _FINE_M, 2, _PIECES).astype(int))
    pieces[standing] = 1
    origin = np.append(_subdivision(pieces), float(len(path) - 1))
    hovering = np.flatnonzero(hover > 0)
    origin = np.sort(np.concatenate([origin, hovering.astype(float)]))
    index, own = np.arange(float(len(path))), origin == np.round(origin)
    waypoint = np.round(origin).astype(int)
    twice = np.flatnonzero(np.diff(origin) == 0)
    hold = np.zeros(len(origin) - 1)
    hold[twice] = hover[waypoint[twice]]
    yaw, pitch = yaw_pitch(path.quat_xyzw)
    yaw = np.unwrap(yaw)
    return _Stations(
        positions=np.column_stack([np.interp(origin, index, axis) for axis in path.positions.T]),
        yaw=np.interp(origin, index, yaw),
        pitch=np.interp(origin, index, pitch),
        t_s=np.interp(origin, index, path.t_s),
        is_viewpoint=own & path.is_viewpoint[waypoint],
        at_rest=own & rest[waypoint],
        hold_s=hold,
    )


def _subdivision(pieces: Ints) -> Floats:
    """Leg number plus share, for each start of a piece."""
    leg = np.repeat(np.arange(len(pieces)), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    return leg + (np.arange(len(leg)) - first) / pieces[leg]


def _turn_times(path: _Stations, settings: RetimeSettings) -> Floats:
    """Least seconds of each leg for the camera's turn."""
    by_yaw = np.abs(np.diff(path.yaw)) / np.radians(settings.max_yaw_rate_degps * _MARGIN)
    by_pitch = np.abs(np.diff(path.pitch)) / np.radians(settings.max_gimbal_rate_degps * _MARGIN)
    return np.maximum(by_yaw, by_pitch)


def demonstrated_speed(t_s: Floats, flight: Trajectory) -> Floats:
    """How fast the expert flew at these times of the flight (S,), evened out, m/s."""
    if flight.t_s[-1] <= 0:
        return np.full(len(t_s), np.inf)
    times, positions = steadied(flight)
    step, tick = np.linalg.norm(np.diff(positions, axis=0), axis=1), float(times[1] - times[0])
    if step.sum() == 0:
        return np.full(len(t_s), np.inf)
    moving = step > _STILL * float(np.percentile(step, 75))
    along = np.concatenate([[0.0], np.cumsum(step)])
    spent = np.concatenate([[0.0], np.cumsum(np.where(moving, tick, 0.0))])
    here = np.interp(t_s, times, along)
    before, after = np.maximum(here - _EVENED_M, 0), np.minimum(here + _EVENED_M, along[-1])
    lasted = np.interp(after, along, spent) - np.interp(before, along, spent)
    speed = (after - before) / np.maximum(lasted, tick)
    return np.maximum(speed, _SLOWEST * along[-1] / spent[-1])


def _timed(path: _Stations, bound: Floats, settings: RetimeSettings) -> Floats:
    """Times (S,) that keep every limit, found by slowing down where the poses still exceed one."""
    limit = settings.max_acceleration_mps2
    length = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    turn_s, bend = _turn_times(path, settings), _curvature(path.positions)
    cap = np.where(path.at_rest, 0.0, np.minimum(bound, np.sqrt(_MARGIN * limit / np.maximum(bend, 1e-9))))
    by_turn = np.where(turn_s > 0, length / np.maximum(turn_s, 1e-12), np.inf)
    cap[:-1] = np.minimum(cap[:-1], by_turn)
    cap[1:] = np.minimum(cap[1:], by_turn)
    for _ in range(_REPAIRS):
        speed = _passes(cap, length, bend, _MARGIN * limit)
        times = _clock(speed, length, np.maximum(turn_s, path.hold_s))
        excess = _accelerations(times, path.positions) / limit
        if excess.max(initial=0) <= 1:
            return times
        slower = np.minimum(cap[1:-1], speed[1:-1]) / np.sqrt(np.maximum(excess, 1)) * _MARGIN
        cap[1:-1] = np.where(excess > 1, slower, cap[1:-1])
    return times * np.sqrt(_accelerations(times, path.positions).max() / limit)


def _curvature(positions: Floats) -> Floats:
    """Turning angle over length at each station, 1/m; 0 at the ends and where the path stands."""
    leg = np.diff(positions, axis=0)
    length = np.linalg.norm(leg, axis=1)
    cross = np.linalg.norm(np.cross(leg[:-1], leg[1:]), axis=1)
    angle = np.arctan2(cross, (leg[:-1] * leg[1:]).sum(axis=1))
    mean = (length[:-1] + length[1:]) / 2
    moving = np.minimum(length[:-1], length[1:]) > 1e-9
    bend = np.zeros(len(positions))
    bend[1:-1] = np.where(moving, 2 * np.sin(angle / 2) / np.maximum(mean, 1e-9), 0)
    return bend


@njit(cache=True)
def _passes(cap: Floats, length: Floats, bend: Floats, limit: float) -> Floats:
    """Largest speeds under the caps that can be reached from before and left in time."""
    speed = cap.copy()
    for index in range(len(length)):
        across = bend[index] * speed[index] ** 2
        along = np.sqrt(max(limit * limit - across * across, 0.0))
        reached = np.sqrt(speed[index] ** 2 + 2 * along * length[index])
        speed[index + 1] = min(speed[index + 1], reached)
    for index in range(len(length) - 1, -1, -1):
        across = bend[index + 1] * speed[index + 1] ** 2
        along = np.sqrt(max(limit * limit - across * across, 0.0))
        reached = np.sqrt(speed[index + 1] ** 2 + 2 * along * length[index])
        speed[index] = min(speed[index], reached)
    return speed


def _clock(speed: Floats, length: Floats, least_s: Floats) -> Floats:
    """Times from speeds: legs of even acceleration, turns on the spot, and hovering."""
    mean = np.maximum((speed[:-1] + speed[1:]) / 2, 1e-9)
    step = np.where(length < 1e-6, 0.0, length / mean)
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.maximum(step, least_s), 1e-3))])


def _accelerations(times: Floats, positions: Floats) -> Floats:
    """Norm of the change of velocity at each inner station, m/s^2."""
    step = np.diff(times)
    velocity = np.diff(positions, axis=0) / step[:, None]
    return np.linalg.norm(np.diff(velocity, axis=0), axis=1) / ((step[1:] + step[:-1]) / 2)
