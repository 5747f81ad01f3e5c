"""Extra views: where leaving the path or turning the camera far shows what no small change would.

No term: the slope of the coverage is zero for what lies far outside of the picture, is hidden from all of
the path or faces away from it, and which way to look is a choice among separate directions. So views from
places on the path and beside it are inserted greedily, the best net gain first, and the optimisation goes on
from there.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.geometry.polylines import arc_length, chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, matrices, optical_axis, wrapped
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record

_STATIONS = 48  # of the path, on and beside which places are tried
_AWAY = 0.4  # stand-offs, to all sides, and twice that
_MISSED = 128  # samples, at most, that stand for all that is missed
_AIMS = 3  # directions from each place, besides that towards the middle of what it reaches
_INSIDE = 0.98  # of the field of view: well inside the picture
_LENGTH = 2.0  # of the way back to the path, along it, over the way aside: a gentle bend
_OF_TENT = 2 / 3  # mean square of a tent over both its slopes, over one of them
_LEAST = 5e-3  # share of the need, net of its price, that a view must add


@dataclass(frozen=True, eq=False, repr=False)
class Price(Record):
    """What an extra view costs, as a share of the need that it must add."""

    usual_m: float  # the stand-off
    departure: Callable[[Floats], Floats]  # of (C, 3), m, if all of the path went there
    turn: float  # of the camera, by one radian
    turning_m: float  # flown while the camera turns by one radian


def with_extra_views(path: Flown, view: View, airspace: Airspace, price: Price) -> Flown:
    """The path with views of what all of it misses, from places on and beside it, if worth their price.

    Parameters
    ----------
    path : Flown
        M stations.
    view : View
    airspace : Airspace
        Whose rules the places keep.
    price : Price

    Returns
    -------
    Flown
        Each view is a tent over the way to its place and back, and so is the turn of its camera.
    """
    missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    if not len(missed) or view.need[missed].sum() <= _LEAST:
        return path
    few = missed[:_MISSED]
    left = view.need[few] * (view.need[missed].sum() / view.need[few].sum())
    at, off = places_beside(path, price.usual_m)
    allowed = airspace.allowed(path.positions[at] + off)
    at, off = at[allowed], off[allowed]
    reach = view.reach(path.positions[at] + off, few, station=at)
    if not reach.any():
        return path
    half = view.halves_rad(len(path))[at]
    row, yaw, pitch, shows = _directions(path.positions[at] + off, half, reach, few, view)
    return _taken(path, _Places(at[row], off[row], yaw, pitch, shows), left, price)


@dataclass(frozen=True, eq=False, repr=False)
class _Places(Record):
    """Where the path could be led to, and where the camera would look there."""

    at: Ints  # (C,) station
    off: Floats  # (C, 3) m, from the path there
    yaw: Floats  # (C,) rad
    pitch: Floats  # (C,) rad
    shows: Bools  # (C, m) of what is missed


def places_beside(path: Flown, usual_m: float) -> tuple[Ints, Floats]:
    """The station of each place (C,), and how far it is aside (C, 3), m: none, and all round, as it looks."""
    stations = chosen_evenly(len(path), _STATIONS)
    ahead = optical_axis(from_yaw_pitch(path.yaw[stations], np.zeros(len(stations))))
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([ahead, np.cross(up, ahead), np.broadcast_to(up, ahead.shape)], axis=1)
    ways = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    steps = usual_m * np.concatenate([np.zeros((1, 3)), _AWAY * ways, 2 * _AWAY * ways])
    aside = np.einsum("ci,sij->scj", steps, axes).reshape(-1, 3)
    return np.repeat(stations, len(steps)), aside


def _taken(path: Flown, places: _Places, left: Floats, price: Price) -> Flown:
    """The path led to the places that show most for what they cost, one after the other."""
    at, table, left = places.at, places.shows.astype(np.float32), np.array(left, np.float32)
    along = arc_length(path.positions)
    moved, yaw, pitch = np.zeros_like(path.positions), path.yaw.copy(), path.pitch.copy()
    level, whole = np.cos(path.pitch[at]), max(float(along[-1]), 1e-6)
    leaving = price.departure(places.off)
    while True:
        off = places.off - moved[at]
        turned = np.hypot(level * wrapped(places.yaw - yaw[at]), places.pitch - pitch[at])
        way_m = np.maximum(_LENGTH * np.linalg.norm(off, axis=1), price.turning_m * turned)
        aside = _OF_TENT * way_m / whole * (leaving - price.departure(moved[at]))
        net = table @ left - aside - 2 * price.turn * turned
        best = int(np.argmax(net))
        if net[best] <= _LEAST:
            return Flown(path.positions + moved, yaw, pitch)
        left[places.shows[best]] = 0.0
        tent = np.clip(1 - np.abs(along - along[at[best]]) / max(float(way_m[best]), 1e-6), 0, 1)
        moved += tent[:, None] * off[best]
        yaw += tent * wrapped(places.yaw[best] - yaw[at[best]])
        pitch += tent * (places.pitch[best] - pitch[at[best]])


def _directions(
    places: Floats, half_rad: Floats, reach: Bools, missed: Ints, view: View
) -> tuple[Ints, Floats, Floats, Bools]:
    """Directions worth trying from places (P, 3), and which of the missed samples each shows.

    From each place that reaches any: towards the middle of what it reaches, and towards `_AIMS` single
    samples; `half_rad` (P, 2) is half the field of view there. Returns for each its place (C,), yaw and
    pitch (C,), and (C, m) what it shows.
    """
    points, need = view.cloud.points[missed], view.need[missed]
    rows, aims = [], []
    for place in np.flatnonzero(reach.any(axis=1)):
        hit = np.flatnonzero(reach[place])
        count = min(_AIMS, len(hit))
        chosen = hit[np.arange(count) * (len(hit) - 1) // max(count - 1, 1)]
        middle = (need[hit, None] * points[hit]).sum(axis=0) / need[hit].sum()
        aims += [middle[None], points[chosen]]
        rows.append(np.full(1 + count, place))
    row = np.concatenate(rows)
    towards = np.concatenate(aims) - places[row]
    yaw = np.arctan2(towards[:, 1], towards[:, 0])
    pitch = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    pitch = np.clip(pitch, low, high)
    half = half_rad[row]
    axes = matrices(from_yaw_pitch(yaw, pitch))
    round_ = half[:, 0] >= np.pi / 2
    return row, yaw, pitch, in_picture(places, row, axes, points, reach, half * _INSIDE, round_)


@njit(cache=True)
def in_picture(
    places: Floats, row: Ints, axes: Floats, points: Floats, reach: Bools, half: Floats, round_: Bools
) -> Bools:
    """Which of the points in reach fall into the picture of each orientation, (C, m)."""
    shown = np.zeros((len(row), len(points)), np.bool_)
    for index in range(len(row)):
        place, turn = places[row[index]], axes[index]
        for sample in range(len(points)):
            if not reach[row[index], sample]:
                continue
            x, y, z = 0.0, 0.0, 0.0
            for axis in range(3):
                ray = points[sample, axis] - place[axis]
                x += turn[axis, 0] * ray
                y += turn[axis, 1] * ray
                z += turn[axis, 2] * ray
            forward = np.hypot(x, y) if round_[index] else x
            across, up = abs(np.arctan2(y, x)), abs(np.arctan2(z, forward))
            shown[index, sample] = across <= half[index, 0] and up <= half[index, 1]
    return shown
