"""Corners and ripples taken out of a path, as far as the rules and a small distance allow.

Bends that were added one by one leave a path that no pilot would fly. The fair path is the one with
the least change of direction for its distance from the given one (Whittaker's smoother, by length).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from upplied.planning.airspace import Airspace
from upplied.records import Bools, Floats

_TRIES = 6  # each with half the reach


def faired(positions: Floats, airspace: Airspace, reach_m: float) -> Floats:
    """A smoother path near a given one that keeps every rule the given one keeps.

    Parameters
    ----------
    positions : array, shape (M, 3), m
        Closely spaced; both ends stay.
    airspace : Airspace
    reach_m : float
        Ripples shorter than about six times this are taken out; no position moves further.

    Returns
    -------
    array, shape (M, 3), m
    """
    if len(positions) < 5:
        return positions
    allowed = airspace.broken(positions)
    reach = np.full(len(positions), float(reach_m))
    for _ in range(_TRIES):
        smooth = _whittaker(positions, reach_m)
        step = smooth - positions
        length = np.linalg.norm(step, axis=1)
        tried = positions + step * np.minimum(1, reach / np.maximum(length, 1e-12))[:, None]
        worse = airspace.broken(tried) & ~allowed
        if not worse.any():
            return tried
        reach = np.minimum(reach, np.where(_near(worse), reach / 2, reach))
        reach[_ends(worse)] = 0.0
    return positions


def _whittaker(positions: Floats, reach_m: float) -> Floats:
    """Least squares of the distance and, weighted, of the second derivative along the path."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    gap = np.maximum(np.diff(along), 1e-3 * max(along[-1], 1e-9) / len(positions))
    weight = (gap[:-1] + gap[1:]) / 2
    a, c = 1 / (gap[:-1] * weight), 1 / (gap[1:] * weight)
    rows = np.stack([a, -a - c, c])  # second derivative at each inner position
    mass = np.concatenate([[gap[0] / 2], weight, [gap[-1] / 2]])
    mass[[0, -1]] = 1e9 * mass.max()
    stiff = reach_m**4 * weight
    bands = np.zeros((3, len(positions)))
    bands[0] = mass
    for i in range(3):
        for j in range(i, 3):
            bands[j - i, i : i + len(weight)] += stiff * rows[i] * rows[j]
    return solveh_banded(bands, mass[:, None] * positions, lower=True)


def _near(legs: Bools) -> Bools:
    """Positions within a few of a marked leg."""
    return np.convolve(_ends(legs), np.ones(9), mode="same") > 0


def _ends(legs: Bools) -> Bools:
    ends = np.zeros(len(legs) + 1, bool)
    ends[:-1] |= legs
    ends[1:] |= legs
    return ends
