"""A short safe path by some of many poses that together see every sample.

Poses are inserted where they cost least for what they see, until every sample is seen. The path is shortened
by reversing stretches (2-opt), exchanging poses for others that show what they alone show, and dropping those
that are not needed. Then some are removed, at random or all about one, and replaced where that costs least;
the shorter path remains (iterated local search; Lourenco, Martin and Stuetzle 2003). The same poses give the
same path.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.records import Bools, Floats, Ints

_TRIALS = 120  # of leaving some out: beyond, ways of the sample fleet hardly became shorter
_LEFT_OUT = 6  # poses at a time, at most
_WORTH = 1.15  # times the shortest so far, up to which a trial is shortened further
_NOISE = 0.5  # on the costs by which every second trial chooses
_LITTLE_M = 1e-6


def short_tour(apart: Floats, seen: Bools) -> Ints:
    """Poses (K,) in the order of a short open way that together see every sample.

    Parameters
    ----------
    apart : array, shape (P, P), m
        Lengths of the legs between poses.
    seen : array of bool, shape (P, S)
        Which pose sees which sample; each is seen by one at least.
    """
    rng = np.random.default_rng(0)
    nothing, exact = np.zeros(0, np.int64), np.ones(len(apart))
    best = _better(apart, seen, _seen_again(apart, seen, nothing, exact))
    least = _length(apart, best)
    for _ in range(_TRIALS if len(best) > 1 else 0):
        count = int(rng.integers(1, max(2, min(_LEFT_OUT, len(best)))))
        if rng.random() < 0.5:  # neighbours, or any
            out = np.argsort(apart[best[int(rng.integers(len(best)))], best], kind="stable")[:count]
        else:
            out = rng.choice(len(best), count, replace=False)
        noise = rng.uniform(1, 1 + _NOISE * rng.integers(2), len(apart))
        trial = _needed(apart, seen, _seen_again(apart, seen, np.delete(best, out), noise))
        if _length(apart, trial) < _WORTH * least:
            trial = _better(apart, seen, trial)
            if _length(apart, trial) < least - _LITTLE_M:
                best, least = trial, _length(apart, trial)
    return best


def _better(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour uncrossed, exchanged and thinned out while that shortens it."""
    while True:
        before = _length(apart, tour)
        tour = _needed(apart, seen, _exchanged(apart, seen, _uncrossed(apart, tour.copy())))
        if _length(apart, tour) > before - _LITTLE_M:
            return tour


def _length(apart: Floats, tour: Ints) -> float:
    return float(apart[tour[:-1], tour[1:]].sum())


def _seen_again(apart: Floats, seen: Bools, tour: Ints, noise: Floats) -> Ints:
    """The tour with poses put in where they cost least for what they see that it does not."""
    left = ~seen[tour].any(axis=0)
    while left.any():
        gain = seen[:, left].sum(axis=1)
        new = np.flatnonzero(gain)
        cost, at = _detours(apart, tour, new)
        choice = int(((cost + _LITTLE_M) / gain[new] * noise[new]).argmin())
        tour = np.insert(tour, int(at[choice]), new[choice])
        left &= ~seen[new[choice]]
    return tour


def _detours(apart: Floats, tour: Ints, new: Ints) -> tuple[Floats, Ints]:
    """By how much each new pose (K,) lengthens a tour, m, and before which of its poses it does so least."""
    if not len(tour):
        return np.zeros(len(new)), np.zeros(len(new), np.int64)
    way = apart[np.ix_(new, tour)]
    inside = way[:, :-1] + way[:, 1:] - apart[tour[:-1], tour[1:]]
    every = np.concatenate([way[:, :1], inside, way[:, -1:]], axis=1)
    at = every.argmin(axis=1)
    return every[np.arange(len(new)), at], at


def _needed(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour without poses that alone see nothing, those first that save most."""
    while len(tour) > 1:
        once = seen[tour].sum(axis=0) == 1
        spare = np.flatnonzero(~(seen[tour] & once).any(axis=1))
        if not len(spare):
            break
        without = [_length(apart, np.delete(tour, at)) for at in spare]
        tour = np.delete(tour, spare[int(np.argmin(without))])
    return tour


def _exchanged(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour with each pose exchanged for the one that shows what it alone shows on the shortest way."""
    for at in range(len(tour)):
        alone = ~seen[np.delete(tour, at)].any(axis=0)
        fit = np.flatnonzero(seen[:, alone].all(axis=1))
        ends = tour[[end for end in (at - 1, at + 1) if 0 <= end < len(tour)]]
        tour[at] = fit[apart[np.ix_(fit, ends)].sum(axis=1).argmin()]
    return tour


@njit(cache=True)
def _uncrossed(apart: Floats, tour: Ints) -> Ints:
    """The open tour with stretches turned round while that shortens it."""
    better = True
    while better:
        better = False
        for i in range(len(tour) - 1):
            for j in range(i + 1, len(tour)):
                gain = 0.0
                if i > 0:
                    gain += apart[tour[i - 1], tour[i]] - apart[tour[i - 1], tour[j]]
                if j < len(tour) - 1:
                    gain += apart[tour[j], tour[j + 1]] - apart[tour[i], tour[j + 1]]
                if gain > 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                    better = True
    return tour
