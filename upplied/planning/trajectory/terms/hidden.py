"""Hidden surface: what all of the path misses draws it to places beside it, from where it would be seen.

The slope of the coverage is zero for what is hidden from the path, faces away or lies too far off. So places
to all sides of the path are asked what they show of it, as the camera looks there. Each pulls the station it
belongs to by its share of what it shows, the larger the more it shows and the nearer to the path it is.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record

_STATIONS = 48  # of the path, beside which places are tried
_AWAY = 0.4  # stand-offs, to all sides, and twice that
_MISSED = 256  # samples, at most, that stand for all that is missed
_CHOOSY = 8.0  # power of what a place shows for a metre aside, by which what several show is shared
_LITTLE = 1e-4  # of all that is missed, for which a place is left out
_AT_START = 1 - np.exp(-0.5)  # of its pull, that a place keeps at its own distance from the path


@dataclass(frozen=True, eq=False, repr=False)
class Hidden(Record):
    """Share of the need that K places would show, and the path does not, by how far it is from them."""

    station: Ints  # (K,)
    place: Floats  # (K, 3) m
    need: Floats  # (K,) that each shows
    away_m: Floats  # (K,) from the station, as the path was

    @classmethod
    def of(cls, view: View, airspace: Airspace, path: Flown, usual_m: float) -> Hidden:
        """The term near a path; without places where nothing is missed that any of them shows.

        Parameters
        ----------
        view : View
        airspace : Airspace
            Whose rules the places keep.
        path : Flown
            M stations.
        usual_m : float
            The stand-off.
        """
        missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
        few, at, off = missed[:_MISSED], *places_beside(path, usual_m)
        beside = airspace.allowed(path.positions[at] + off) & off.any(axis=1)
        at, off = at[beside], off[beside]
        left, away_m = np.array(view.need[few]), np.linalg.norm(off, axis=1)
        left *= view.need[missed].sum() / max(left.sum(), 1e-12)
        shows = np.zeros((len(at), len(few)), bool)
        if shows.size:
            shows = _shown(path, at, off, few, view)
        need = _shared(shows, left, away_m)
        row = np.flatnonzero(need > _LITTLE * need.sum())
        return cls(at[row], path.positions[at[row]] + off[row], need[row], away_m[row])

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Need of the places, times how much farther than at them the path is, and its slope."""
        off = flown.positions[self.station] - self.place
        near = np.exp(-(off**2).sum(axis=1) / (2 * self.away_m**2))
        need, nothing = self.need / _AT_START, np.zeros(len(flown))
        slope = np.zeros_like(flown.positions)
        np.add.at(slope, self.station, (need * near / self.away_m**2)[:, None] * off)
        return float((need * (1 - near)).sum()), Flown(slope, nothing, nothing)


def _shared(shows: Bools, need: Floats, away_m: Floats) -> Floats:
    """(C,) the need that each place has of the samples (C, m) that it shows: more, the better it is.

    Each sample's need (m,) is shared by all places that show it, so that none is chosen by a hair's breadth.
    """
    worth = (shows @ need) / away_m
    worth = (worth / worth.max(initial=1e-300)) ** _CHOOSY
    total = worth @ shows
    return worth * (shows @ np.where(total > 0, need / np.maximum(total, 1e-300), 0.0))


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


def _shown(path: Flown, at: Ints, off: Floats, few: Ints, view: View) -> Bools:
    """(C, m) which samples are seen from the places with the camera as it looks from their stations."""
    return view.seen(path.positions[at] + off, from_yaw_pitch(path.yaw[at], path.pitch[at]), few, at)
