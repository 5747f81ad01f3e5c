"""Time stamps: as fast as the expert flew (paper, Sec. III-C), or so under the limits of the vehicle.

Under limits, the speed along the path is the largest that nowhere exceeds the demonstrated one, the
vehicle's, what the curve allows, or what the turning camera allows, and that can be reached and left
in time (`trajectory.speeds`). All limits hold for Euclidean norms, curves and braking together.
"""

import itertools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from upplied.config import RetimeSettings
from upplied.geometry.polylines import arc_length, cumulated, interpolated, leg_lengths, pieces_of_legs
from upplied.geometry.poses import angle_between, from_yaw_pitch, yaw_pitch
from upplied.planning.constants import STILL
from upplied.planning.demonstration.stations import pauses, steadied
from upplied.planning.trajectory.speeds import corner_cap, passes
from upplied.records import Bools, Floats, Ints, Record, Rows, Trajectory, Waypoints

_STEP_M = 0.5  # largest leg of the result
_FINE_M, _PIECES = 0.05, 6  # smallest pieces, and most of them, of a leg that begins or ends at rest
_EVENED_M = 3.0  # along the demonstration, to each side, over which its speed is averaged
_TRANSIT = 95  # percentile of the demonstrated speed, at which parts of the flight are joined
_MARGIN = 0.999  # of the limits, for the rounding of what is stored
_SHORTEST_S = 2e-3  # of a leg
_STANDING_M = 1e-6  # shorter legs are none


class Timed(NamedTuple):
    """A path with its times."""

    trajectory: Trajectory  # P poses, target frame; under limits as close as speeds and turns are flown
    is_viewpoint: Bools  # (P,)
    demonstrated_s: Floats  # (P,) s, of the joined flights (`repetition.joined`), that each corresponds to
    added: Bools  # (P,) on passes added to the demonstrated ones


def retime(
    path: Waypoints,
    flight: Trajectory,
    settings: RetimeSettings,
    breaks: Ints | None = None,
    sharp: "Sharp | None" = None,
) -> Timed:
    """Give a path its times.

    Parameters
    ----------
    path : Waypoints
        `t_s` is the time of the demonstration that each corresponds to.
    settings : RetimeSettings
        Without `limits`, the paper's rule.
    breaks : array of int, optional
        First pose of each part of the demonstration but the first; nothing was flown in between.
    sharp : Sharp, optional
        How fast the path may be flown where the demonstration shows something; in between its parts only
        the vehicle's limits hold.
    """
    if not settings.limits or len(path) < 2:
        viewpoint = np.array(path.is_viewpoint, bool)
        return Timed(at_demonstrated_speed(path, flight), viewpoint, path.t_s, path.added)
    anything = np.full(len(path), np.inf)
    sharp = Sharp(anything, anything) if sharp is None else sharp
    # Without waypoints that repeat the pose before them.
    moved = leg_lengths(path.positions) > _STANDING_M
    turned = angle_between(path.quat_xyzw[:-1], path.quat_xyzw[1:]) > 1e-6
    keep = np.concatenate([[True], moved | turned])
    viewpoint = np.logical_or.reduceat(path.is_viewpoint, np.flatnonzero(keep))
    path, sharp = replace(path.rows(keep), is_viewpoint=viewpoint), sharp.rows(keep)
    hover = hovering(path, flight, settings.least_stop_s, breaks)
    stations = _divided(path, hover, sharp)
    bound = demonstrated_speed(stations.t_s, flight, breaks, settings.transit_speed_mps)
    shows = _within_parts(stations.t_s, flight, breaks)
    bound = np.where(shows, np.minimum(bound, stations.sharp.speed_mps), bound)
    legs_show = _within_parts((stations.t_s[:-1] + stations.t_s[1:]) / 2, flight, breaks)
    pan_degps = np.minimum(stations.sharp.pan_degps[:-1], stations.sharp.pan_degps[1:])
    pan = np.radians(np.where(legs_show, pan_degps, np.inf))
    times = _timed(stations, bound, pan, settings)
    planned = Trajectory(times, stations.positions, from_yaw_pitch(stations.yaw, stations.pitch))
    return Timed(planned, stations.is_viewpoint, stations.t_s, stations.added)


@dataclass(frozen=True, eq=False, repr=False)
class Sharp(Rows):
    """Up to which speeds the pictures of a path are sharp (`sharpness`)."""

    speed_mps: Floats  # (W,) at each waypoint
    pan_degps: Floats  # (W,) by which the camera turns at most


@dataclass(frozen=True, eq=False, repr=False)
class _Stations(Record):
    """Where the speed is decided."""

    positions: Floats  # (S, 3) m
    yaw: Floats  # (S,) rad, unwrapped
    pitch: Floats  # (S,) rad
    t_s: Floats  # (S,) time of the demonstration
    is_viewpoint: Bools  # (S,)
    at_rest: Bools  # (S,)
    sharp: Sharp  # of S stations
    hold_s: Floats  # (S - 1,) time to hover, on legs of no length
    added: Bools  # (S,) on added passes


def at_demonstrated_speed(path: Waypoints, flight: Trajectory) -> Trajectory:
    """Each leg as fast as the expert flew between the same two places (paper, Sec. III-C)."""
    flown = arc_length(flight.positions)
    demo = np.diff(np.interp(path.t_s, flight.t_s, flown))
    spent = np.diff(path.t_s)
    leg = leg_lengths(path.positions)
    overall = max(flown[-1] / max(flight.t_s[-1], 1e-9), 1e-3)
    speed = np.where(demo > 1e-6, demo / np.maximum(spent, 1e-9), overall)
    step = np.maximum(leg / np.maximum(speed, 0.05), 1e-3)
    return Trajectory(cumulated(step), path.positions, path.quat_xyzw)


def hovering(path: Waypoints, flight: Trajectory, least_s: float, breaks: Ints | None = None) -> Floats:
    """Seconds (W,) to hover at each waypoint, as the expert did at the place it corresponds to."""
    hover = np.zeros(len(path))
    for part in _parts(flight, breaks):
        for begin, end in pauses(part, least_s):
            off = np.where(path.added & ~path.added.all(), np.inf, np.abs(path.t_s - (begin + end) / 2))
            hover[int(off.argmin())] += end - begin
    return hover


def _parts(flight: Trajectory, breaks: Ints | None) -> list[Trajectory]:
    """The stretches of a flight between its gaps."""
    cuts = [0, *(int(index) for index in ([] if breaks is None else breaks)), len(flight)]
    return [flight.take(slice(a, b)) for a, b in itertools.pairwise(cuts) if b > a]


def _within_parts(t_s: Floats, flight: Trajectory, breaks: Ints | None) -> Bools:
    """Which times (S,) the demonstration shows something at: those within its parts."""
    within = np.zeros(len(t_s), bool)
    for part in _parts(flight, breaks):
        within |= (t_s >= part.t_s[0]) & (t_s <= part.t_s[-1])
    return within


def _divided(path: Waypoints, hover: Floats, sharp: Sharp) -> _Stations:
    """The path with shorter legs; a hover is a leg of no length, as is a turn on the spot."""
    length = leg_lengths(path.positions)
    standing = length < _STANDING_M
    rest = hover > 0
    rest[[0, -1]] = True
    rest[:-1] |= standing
    rest[1:] |= standing
    slow = rest[:-1] | rest[1:]
    pieces = np.maximum(np.ceil(length / _STEP_M - 1e-9).astype(int), 1)
    pieces[slow] = np.maximum(pieces[slow], np.clip(length[slow] / _FINE_M, 2, _PIECES).astype(int))
    pieces[standing] = 1
    leg, share = pieces_of_legs(pieces)
    origin = np.append(leg + share, float(len(path) - 1))
    hovering = np.flatnonzero(hover > 0)
    origin = np.sort(np.concatenate([origin, hovering.astype(float)]))
    index, own = np.arange(float(len(path))), origin == np.round(origin)
    waypoint = np.round(origin).astype(int)
    twice = np.flatnonzero(np.diff(origin) == 0)
    hold = np.zeros(len(origin) - 1)
    hold[twice] = hover[waypoint[twice]]
    ends = [of(origin).astype(int) for of in (np.floor, np.ceil)]
    yaw, pitch = yaw_pitch(path.quat_xyzw)
    yaw = np.unwrap(yaw)
    return _Stations(
        positions=interpolated(origin, index, path.positions),
        yaw=np.interp(origin, index, yaw),
        pitch=np.interp(origin, index, pitch),
        t_s=np.interp(origin, index, path.t_s),
        is_viewpoint=own & path.is_viewpoint[waypoint],
        at_rest=own & rest[waypoint],
        sharp=Sharp(*(np.minimum(of[ends[0]], of[ends[1]]) for of in (sharp.speed_mps, sharp.pan_degps))),
        hold_s=hold,
        added=path.added[ends[0]] & path.added[ends[1]],
    )


def demonstrated_speed(
    t_s: Floats, flight: Trajectory, breaks: Ints | None = None, transit_mps: float = 0.0
) -> Floats:
    """How fast the expert flew at these times of the flight (S,), evened out, m/s.

    In between its parts, where he showed nothing, at `transit_mps`, or as fast as he was seen to fly.
    """
    flown, fastest = [], [transit_mps]
    for part in _parts(flight, breaks):
        if not part.t_s[-1] > part.t_s[0]:
            continue
        times, positions = steadied(part)
        step, tick = leg_lengths(positions), float(times[1] - times[0])
        moving = step > STILL * float(np.percentile(step, 75))
        # What way it had made when, and in how much time of moving.
        along, spent = cumulated(step), cumulated(np.where(moving, tick, 0.0))
        if along[-1] > 0:
            flown.append((times, along, spent))
            fastest.append(float(np.percentile(step, _TRANSIT)) / tick)
    if not flown:
        return np.full(len(t_s), np.inf)
    length = sum(along[-1] for _, along, _ in flown)
    mean = float(length / sum(spent[-1] for *_, spent in flown))
    speed = np.full(len(t_s), max(fastest))
    for times, along, spent in flown:
        inside = (t_s >= times[0]) & (t_s <= times[-1])
        here = np.interp(t_s[inside], times, along)
        before, after = np.maximum(here - _EVENED_M, 0), np.minimum(here + _EVENED_M, along[-1])
        lasted = np.interp(after, along, spent) - np.interp(before, along, spent)
        evened = (after - before) / np.maximum(lasted, times[1] - times[0])
        speed[inside] = np.maximum(evened, STILL * mean)
    return speed


def _timed(path: _Stations, bound: Floats, pan: Floats, settings: RetimeSettings) -> Floats:
    """Times (S,) that keep every limit; `pan` (S - 1,), rad/s, bounds the camera's turning on each leg."""
    legs, turns = np.diff(path.positions, axis=0), np.diff(path.yaw)
    length = np.linalg.norm(legs, axis=1)
    acceleration = settings.max_acceleration_mps2 * _MARGIN
    angular = np.radians(settings.max_yaw_acceleration_degps2) * _MARGIN
    # What each leg allows by itself.
    vehicle = np.radians([settings.max_yaw_rate_degps, settings.max_gimbal_rate_degps])
    yaw_rate, pitch_rate = np.minimum(vehicle[0], pan), np.minimum(vehicle[1], pan)
    rise, turn, nod = np.diff(path.positions[:, 2]), np.abs(turns), np.abs(np.diff(path.pitch))
    least_s = np.maximum(length / settings.max_speed_mps, _SHORTEST_S)
    least_s = np.maximum(least_s, rise / settings.max_climb_mps)
    least_s = np.maximum(least_s, -rise / settings.max_descent_mps)
    least_s = np.maximum(np.maximum(least_s, turn / yaw_rate), nod / pitch_rate)
    cap = np.minimum(_MARGIN * length / least_s, np.minimum(bound[:-1], bound[1:]))
    # Legs of no length are spent at rest, the heading turned from rest to rest: they have a time, no speed.
    most = np.radians(settings.max_yaw_acceleration_degps2)
    at_rate, ramp = turn / yaw_rate, yaw_rate / most  # s to full rate
    from_rest = np.where(at_rate > ramp, at_rate + ramp, 2 * np.sqrt(turn / most))
    step = np.maximum(path.hold_s, np.maximum(from_rest, nod / pitch_rate) / _MARGIN)
    index = np.flatnonzero(length >= _STANDING_M)
    if len(index):
        rest = np.concatenate([path.at_rest[index], [path.at_rest[index[-1] + 1]]])
        corner = corner_cap(legs[index], turns[index], rest, acceleration, angular)
        speed = passes(np.minimum(cap[index], corner), legs[index], turns[index], rest, acceleration, angular)
        step[index] = length[index] / speed
    return cumulated(np.maximum(step, _SHORTEST_S))
