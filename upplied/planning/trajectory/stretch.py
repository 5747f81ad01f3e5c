"""The whole path made wider, higher or flatter where that shows more (preset `recommended`).

A path is recognised by its shape whatever its extent along each axis: the paper compares z-scored
paths. So a flight that rises and sinks by two metres round a small structure may rise and sink by
three round one that is fuller in the shoulders, before any single bend is tried.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from upplied.planning.trajectory.likeness import Likeness
from upplied.planning.trajectory.look import View
from upplied.records import Bools, Floats

_FACTORS = (1.2, 1.45, 1.75, 2.0, 0.85)
_CHANGES = (  # axis, and what is tried along it: factors, and shifts in stand-offs
    (2, (*((factor, 0.0) for factor in _FACTORS), *((f, s) for s in (0.1, -0.1) for f in (1.0, *_FACTORS)))),
    (1, tuple((factor, 0.0) for factor in _FACTORS)),
    (0, tuple((factor, 0.0) for factor in _FACTORS)),
)
_STATIONS, _SAMPLES = 64, 500
_WORTH = 0.004  # share of the need that a stretch must add


def stretched(
    positions: Floats, view: View, likeness: Likeness, allowed: Callable[[Floats], Bools]
) -> Floats:
    """The path stretched along each axis by the factor from which most can be seen.

    Parameters
    ----------
    positions : array, shape (M, 3), m
    view : View
    likeness : Likeness
    allowed : callable
        Takes positions (K, 3), gives (K,) bool.
    """
    needed = np.flatnonzero(view.need > 0)
    if len(needed) == 0 or len(positions) < 3:
        return positions
    asked = needed[np.unique(np.linspace(0, len(needed) - 1, min(_SAMPLES, len(needed))).astype(int))]
    stations = np.unique(np.linspace(0, len(positions) - 1, min(_STATIONS, len(positions))).astype(int))
    standoff_m = likeness.standoff.usual_m
    worth = _WORTH * view.need[asked].sum()

    def shown(path: Floats) -> float:
        return float(view.need[asked][view.reachable(path[stations], asked)].sum())

    best = shown(positions)
    if best > view.need[asked].sum() - worth:
        return positions
    for axis, changes in _CHANGES:
        start = positions
        middle = (start[:, axis].max() + start[:, axis].min()) / 2
        for factor, shift in changes:
            tried = np.array(start)
            tried[:, axis] = middle + factor * (start[:, axis] - middle) + shift * standoff_m
            if not likeness.kept(tried, positions) or not allowed(tried[stations]).all():
                continue
            found = shown(tried)
            if found > best + worth:
                positions, best = tried, found
    return positions
