"""Moves aside: where leaving the path shows what no turn of the camera does, chosen greedily.

No term, as looks aside are none: what is hidden from all of the path, or faces away from it, has no slope.
So places beside the path are tried, and the best are where the optimisation goes on from.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.looks import directions
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.polylines import arc_length, chosen_evenly
from upplied.poses import from_yaw_pitch, optical_axis, wrapped
from upplied.records import Bools, Floats, Ints, Record

_STATIONS = 48  # of the path beside which places are tried
_AWAY = 0.4  # stand-offs, to all sides, and twice that
_MISSED = 128  # samples, at most, that stand for all that is missed
_AIMS = 3  # directions from each place, besides that towards the middle of what it reaches
_LENGTH = 2.0  # of the way back to the path, along it, over the way aside: a gentle bend
_OF_TENT = 2 / 3  # mean square of a tent over both its slopes, over one of them
_LEAST = 1e-3  # share of the need, net of its price, that a move must add


@dataclass(frozen=True, eq=False, repr=False)
class Aside(Record):
    """What to leave the path costs, as a share of the need that must be shown for it."""

    usual_m: float  # the stand-off
    departure: Callable[[Floats], Floats]  # of (C, 3), m, if all of the path went there
    turn: float  # of the camera, by one radian


def moves_aside(path: Flown, view: View, airspace: Airspace, aside: Aside) -> Flown:
    """The path with bulges to where something is seen that all of it misses, if worth their price.

    Parameters
    ----------
    path : Flown
        M stations.
    view : View
    airspace : Airspace
        Whose rules the places keep.
    aside : Aside

    Returns
    -------
    Flown
        Each move is a tent over the way to the place and back, and so is the turn of its camera.
    """
    missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    if not len(missed) or view.need[missed].sum() <= _LEAST:
        return path
    few = missed[chosen_evenly(len(missed), _MISSED)]
    left = view.need[few] * (view.need[missed].sum() / view.need[few].sum())
    at, off = places_beside(path, aside.usual_m)
    kept = airspace.allowed(path.positions[at] + off)
    at, off = at[kept], off[kept]
    reach = view.reach(path.positions[at] + off, few, station=at)
    if not reach.any():
        return path
    half = view.halves_rad(len(path))[at]
    row, yaw, pitch, shows = directions(path.positions[at] + off, half, reach, few, view, _AIMS)
    return _taken(path, _Places(at[row], off[row], yaw, pitch, shows), left, aside)


@dataclass(frozen=True, eq=False, repr=False)
class _Places(Record):
    """Where the path could be led to, and where the camera would look there."""

    at: Ints  # (C,) station
    off: Floats  # (C, 3) m, from the path there
    yaw: Floats  # (C,) rad
    pitch: Floats  # (C,) rad
    shows: Bools  # (C, m) of what is missed


def places_beside(path: Flown, usual_m: float) -> tuple[Ints, Floats]:
    """The station of each place (C,), and how far it is aside (C, 3), m: all round, as the camera looks."""
    stations = chosen_evenly(len(path), _STATIONS)
    ahead = optical_axis(from_yaw_pitch(path.yaw[stations], np.zeros(len(stations))))
    up = np.array([0.0, 0.0, 1.0])
    axes = np.stack([ahead, np.cross(up, ahead), np.broadcast_to(up, ahead.shape)], axis=1)
    ways = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    steps = usual_m * np.concatenate([length * ways for length in (_AWAY, 2 * _AWAY)])
    aside = np.einsum("ci,sij->scj", steps, axes).reshape(-1, 3)
    return np.repeat(stations, len(steps)), aside


def _taken(path: Flown, places: _Places, left: Floats, aside: Aside) -> Flown:
    """The path led to the places that show most for what they cost, one after the other."""
    at, table, left = places.at, places.shows.astype(np.float32), np.array(left, np.float32)
    along = arc_length(path.positions)
    moved, yaw, pitch = np.zeros_like(path.positions), path.yaw.copy(), path.pitch.copy()
    level, whole = np.cos(path.pitch[at]), max(float(along[-1]), 1e-6)
    price = aside.departure(places.off)
    while True:
        off = places.off - moved[at]
        way_m = _LENGTH * np.linalg.norm(off, axis=1)
        turned = np.hypot(level * wrapped(places.yaw - yaw[at]), places.pitch - pitch[at])
        leaving = _OF_TENT * way_m / whole * (price - aside.departure(moved[at]))
        net = table @ left - leaving - 2 * aside.turn * turned
        best = int(np.argmax(net))
        if net[best] <= _LEAST:
            return Flown(path.positions + moved, yaw, pitch)
        left[places.shows[best]] = 0.0
        tent = np.clip(1 - np.abs(along - along[at[best]]) / max(float(way_m[best]), 1e-6), 0, 1)
        moved += tent[:, None] * off[best]
        yaw += tent * wrapped(places.yaw[best] - yaw[at[best]])
        pitch += tent * (places.pitch[best] - pitch[at[best]])
