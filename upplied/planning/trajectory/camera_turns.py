"""Turns of the camera laid into a path, and spread over as many metres as they take at full speed.

A turn that has to happen within half a metre makes the vehicle creep. Most of what the poses around
it see is seen by others too: these poses may look on the way from one direction to the next.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from upplied.planning.trajectory.look import Looks, View
from upplied.poses import angle_between, from_yaw_pitch, yaw_pitch
from upplied.records import Bools, Floats, Ints, Waypoints

_PAST_M = 0.4  # past a station, at most, is where the camera turns
_AMPLE = 1.05  # times the way that a turn takes
_PEAK, _BEND = 1.5, 6.0  # of a turn by a cubic from rest to rest: rate and acceleration over the mean ones
_ROUNDS = 5
_LOST = 1e-4  # share of the need that turns on the way may hide


def past(positions: Floats) -> Floats:
    """Places (M, 3), m, a little past each position of a path, on the leg to the next, for turns.

    Past it, not at it: a vehicle that may turn its camera on the way need not stop for it.
    """
    leg = np.diff(positions, axis=0, append=positions[-1:])
    length = np.linalg.norm(leg, axis=1, keepdims=True)
    return positions + leg * np.minimum(0.5, _PAST_M / np.maximum(length, 1e-9))


def with_looks(path: Waypoints, looks: Looks) -> tuple[Waypoints, Bools]:
    """The path with each turn of the camera as a waypoint past its station, and which waypoints are turns.

    Several turns at one station follow each other on its leg, each by the least turn.
    """
    station, quats = _in_turn(path, looks)
    before = np.arange(len(station)) - np.searchsorted(station, station)
    number = np.bincount(station, minlength=len(path))[station]
    share = (before + 1) / (number + 1)
    begin = path.positions[station]
    places = begin + 2 * share[:, None] * (past(path.positions)[station] - begin)
    after = station + 1
    laid = Waypoints(
        positions=np.insert(path.positions, after, places, axis=0),
        quat_xyzw=np.insert(path.quat_xyzw, after, quats, axis=0),
        t_s=np.insert(path.t_s, after, path.t_s[station]),
        is_viewpoint=np.insert(path.is_viewpoint, after, True),
    )
    return laid, np.insert(np.zeros(len(path), bool), after, True)


def eased(path: Waypoints, fixed: Bools, speed_mps: Floats, view: View) -> Waypoints:
    """The path whose camera begins to turn early enough, and turns back late enough, to keep its speed.

    Parameters
    ----------
    path : Waypoints
        M waypoints, closely spaced.
    fixed : array of bool, shape (M,)
        Whose directions are to be kept: turns, and where the vehicle hovers.
    speed_mps : array, shape (M,), m/s
        At which it would fly if it had not to turn.
    view : View
        What is to be seen; all that the path sees is still seen, but for a ten thousandth.
    """
    if not fixed.any() or len(path) < 3:
        return path
    yaw, pitch = yaw_pitch(path.quat_xyzw)
    step = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    free = _turning(yaw, pitch, along, fixed, speed_mps, view)
    free[[0, -1]] = False
    before = view.covered(path.positions, path.quat_xyzw)
    least = _LOST * float(view.need.sum())
    for _ in range(_ROUNDS):
        quats = _on_the_way(yaw, pitch, along, free, path.quat_xyzw)
        lost = np.flatnonzero(before & ~view.covered(path.positions, quats))
        if view.need[lost].sum() <= least:
            return Waypoints(path.positions, quats, path.t_s, path.is_viewpoint)
        asked = np.flatnonzero(free)
        showed = view.sees(path.positions[asked], path.quat_xyzw[asked], lost)
        free[asked[_fewest(showed, view.need[lost])]] = False
    return path


def _in_turn(path: Waypoints, looks: Looks) -> tuple[Ints, Floats]:
    """Stations and orientations of the turns, those at one station in the order of the least turn."""
    order: list[int] = []
    for station in np.unique(looks.station):
        left = np.flatnonzero(looks.station == station).tolist()
        at = path.quat_xyzw[station]
        while left:
            turn = angle_between(np.tile(at, (len(left), 1)), looks.quat_xyzw[left])
            order.append(left.pop(int(turn.argmin())))
            at = looks.quat_xyzw[order[-1]]
    return looks.station[order], looks.quat_xyzw[order]


def _turning(yaw: Floats, pitch: Floats, along: Floats, fixed: Bools, speed_mps: Floats, view: View) -> Bools:
    """Which waypoints (M,) lie within the way that a turn takes, before or after a fixed direction."""
    rates = np.radians([view.limits.max_yaw_rate_degps, view.limits.max_gimbal_rate_degps])
    angular = np.radians(view.limits.max_yaw_acceleration_degps2)
    free = np.zeros(len(fixed), bool)
    for place in np.flatnonzero(fixed):
        across = np.abs((yaw - yaw[place] + np.pi) % (2 * np.pi) - np.pi)
        turn_s = _PEAK * np.maximum(across / rates[0], np.abs(pitch - pitch[place]) / rates[1])
        turn_s = np.maximum(turn_s, np.sqrt(_BEND * across / angular))
        apart = np.abs(along - along[place])
        enough = apart >= _AMPLE * min(speed_mps[place], view.limits.max_speed_mps) * turn_s
        later = np.flatnonzero(enough[place + 1 :] & ~fixed[place + 1 :])
        earlier = np.flatnonzero(enough[:place] & ~fixed[:place])
        end = place + 1 + later[0] if len(later) else len(fixed)
        begin = earlier[-1] + 1 if len(earlier) else 0
        free[begin:end] = True
    return free & ~fixed


def _on_the_way(yaw: Floats, pitch: Floats, along: Floats, free: Bools, quat_xyzw: Floats) -> Floats:
    """The orientations, those of free waypoints on the way between the others', by arc length.

    Rates are steady: a turn begins and ends gently, and goes no further than the directions it joins.
    """
    kept = np.flatnonzero(~free)
    apart = along + 1e-6 * np.arange(len(along))  # so that places where the vehicle stands follow each other
    angles = np.column_stack([np.unwrap(yaw[kept]), pitch[kept]])
    turned = from_yaw_pitch(*PchipInterpolator(apart[kept], angles)(apart).T)
    return np.where(free[:, None], turned, quat_xyzw)


def _fewest(showed: Bools, need: Floats) -> Ints:
    """Rows of `showed` (F, m) that together show all that any does, greedily."""
    left = np.array(need, float)
    rows: list[int] = []
    while True:
        gain = showed @ left
        best = int(gain.argmax())
        if gain[best] <= 0:
            return np.array(rows, np.int64)
        rows.append(best)
        left[showed[best]] = 0.0
