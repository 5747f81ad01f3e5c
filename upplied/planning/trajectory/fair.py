"""Corners and ripples taken out of a path, as far as the rules and a small distance allow.

Bends that were added one by one leave a path that no pilot would fly. The fair path is the one with
the least change of direction for its distance from the given one (Whittaker's smoother, by length).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d

from upplied.planning.airspace.rules import Airspace
from upplied.records import Bools, Floats

_TRIES = 8  # each with half the step where a rule was broken
_BLEND = 3.0  # positions over which full and halved steps meet


def faired(positions: Floats, airspace: Airspace, reach_m: float, like: Floats | None = None) -> Floats:
    """A smoother path near a given one that keeps every rule the given one keeps.

    Parameters
    ----------
    positions : array, shape (M, 3), m
        Closely spaced; both ends stay.
    airspace : Airspace
    reach_m : float
        Ripples shorter than about six times this are taken out; no position moves further.
    like : array, shape (M, 3), m, optional
        A path whose own shape is meant: what is made smooth is the difference from it.

    Returns
    -------
    array, shape (M, 3), m
    """
    if len(positions) < 5 or reach_m <= 0:
        return positions
    before = airspace.broken(positions)
    added = positions if like is None else positions - like
    step = _whittaker(positions, added, reach_m) - added
    step[[0, -1]] = 0.0
    step *= np.minimum(1, reach_m / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]
    share = np.ones(len(positions))
    for _ in range(_TRIES):
        tried = positions + share[:, None] * step
        worse = airspace.broken(tried) & ~before
        if not worse.any():
            return tried
        share = np.where(_near(worse), share / 2, share)
        share = np.minimum(share, gaussian_filter1d(share, _BLEND, mode="nearest"))
        share[_ends(worse)] /= 2
    return positions


def _whittaker(positions: Floats, values: Floats, reach_m: float) -> Floats:
    """Values (M, 3) along a path: least squares of the distance and, weighted, of the second derivative."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    gap = np.maximum(np.diff(along), max(0.1 * along[-1] / len(positions), 0.01 * reach_m))
    weight = (gap[:-1] + gap[1:]) / 2
    a, c = 1 / (gap[:-1] * weight), 1 / (gap[1:] * weight)
    rows = np.stack([a, -a - c, c])  # second derivative at each inner position
    mass = np.concatenate([[gap[0] / 2], weight, [gap[-1] / 2]])
    mass[[0, -1]] = 1e6 * mass.max()  # both ends stay
    stiff = reach_m**4 * weight
    bands = np.zeros((3, len(positions)))
    bands[0] = mass
    for i in range(3):
        for j in range(i, 3):
            bands[j - i, i : i + len(weight)] += stiff * rows[i] * rows[j]
    return solveh_banded(bands, mass[:, None] * values, lower=True)


def _near(legs: Bools) -> Bools:
    """Positions within a few of a marked leg."""
    return np.convolve(_ends(legs), np.ones(9), mode="same") > 0


def _ends(legs: Bools) -> Bools:
    ends = np.zeros(len(legs) + 1, bool)
    ends[:-1] |= legs
    ends[1:] |= legs
    return ends
