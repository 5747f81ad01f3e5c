"""Waypoints that are passed without a stop: the distance at which the vehicle may start its turn.

A vehicle that passes a waypoint at speed leaves the straight leg some metres before it and joins the next leg
equally far behind it. The curve lies in the triangle of these two points and the waypoint, so the
whole triangle must obey the rules.
"""

from __future__ import annotations

import numpy as np

from upplied.planning.airspace.rules import Airspace
from upplied.records import Bools, Floats

_SHARE = 0.4  # of the shorter leg: two neighbours together stay below the whole
_MOST_M = 5.0
_LEAST_M = 0.2  # below it is a stop
_GAP_M = 0.1  # between the lines that stand for the triangle


def passing_m(positions: Floats, stops: Bools, airspace: Airspace, stray_m: float) -> Floats:
    """Distance before and behind each waypoint within which the vehicle may turn, (N,), m; 0: it stops.

    Parameters
    ----------
    positions : array, shape (N, 3), m, structure frame
    stops : array of bool, shape (N,)
        Waypoints with a stop for other reasons.
    airspace : Airspace
        Rules that apply to the curve as well.
    stray_m : float
        Largest distance of the curve from the waypoint.
    """
    distance = np.zeros(len(positions))
    for at in range(1, len(positions) - 1):
        before, after = positions[at - 1] - positions[at], positions[at + 1] - positions[at]
        legs = [float(np.linalg.norm(leg)) for leg in (before, after)]
        if stops[at] or min(legs) < 1e-6:
            continue
        before, after = before / legs[0], after / legs[1]
        most = min(_SHARE * float(min(legs)), _MOST_M)
        sagitta = float(np.linalg.norm(before + after)) / 2  # of the chord, over the distance
        if sagitta > 1e-9:
            most = min(most, stray_m / sagitta)
        while most >= _LEAST_M and not _free(positions[at], before, after, most, airspace):
            most /= 2
        distance[at] = most if most >= _LEAST_M else 0.0
    return distance


def triangle(corner: Floats, before: Floats, after: Floats, distance_m: float) -> tuple[Floats, Floats]:
    """Lines (L, 3) to (L, 3) from a corner that cover the triangle around its curve."""
    chord = distance_m * float(np.linalg.norm(after - before))
    share = np.linspace(0, 1, max(3, int(np.ceil(chord / _GAP_M)) + 1))[:, None]
    ends = corner + distance_m * ((1 - share) * before + share * after)
    return np.repeat(corner[None], len(ends), axis=0), ends


def _free(corner: Floats, before: Floats, after: Floats, distance_m: float, airspace: Airspace) -> bool:
    start, end = triangle(corner, before, after, distance_m)
    return not (airspace.broken_legs(start, end).any() or airspace.broken_legs(end[:-1], end[1:]).any())
