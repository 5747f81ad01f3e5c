"""A short way by some of many poses that together see every sample.

Poses are chosen greedily, without those that are not needed, put in the order of a short open way by 2-opt,
and each is exchanged for another that sees the same where that shortens the way. Then a few poses are left
out, what is lost is seen again from where it costs least, and the shorter way is kept, again and again
(iterated local search; Lourenco, Martin and Stuetzle 2003). The same poses give the same way.
"""

from __future__ import annotations

import numpy as np

from upplied.records import Bools, Floats, Ints

_SWEEPS = 6  # of the exchange of poses
_TRIALS = 120  # of leaving some out: beyond, ways of the sample fleet hardly became shorter
_LEFT_OUT = 6  # poses at a time, at most
_WORTH = 1.15  # times the shortest so far, up to which a trial is made better
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
    best = _better(apart, seen, _order(apart, _cover(seen)))
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
    """The tour ordered, exchanged and thinned out while that shortens it."""
    while True:
        before = _length(apart, tour)
        tour = _needed(apart, seen, _exchanged(apart, seen, _order(apart, tour)))
        if _length(apart, tour) > before - _LITTLE_M:
            return tour


def _length(apart: Floats, tour: Ints) -> float:
    return float(apart[tour[:-1], tour[1:]].sum())


def _seen_again(apart: Floats, seen: Bools, tour: Ints, noise: Floats) -> Ints:
    """The tour with poses put in where they cost least for what they see that it does not."""
    left = ~seen[tour].any(axis=0) if len(tour) else np.ones(seen.shape[1], bool)
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


def _cover(seen: Bools) -> Ints:
    """Poses (K,) that together see every sample: greedily, then without those that are not needed."""
    left, chosen = np.ones(seen.shape[1], bool), []
    while left.any():
        gain = seen[:, left].sum(axis=1)
        chosen.append(int(gain.argmax()))
        left &= ~seen[chosen[-1]]
    for pose in chosen[:-1]:
        others = [other for other in chosen if other != pose]
        if seen[others].any(axis=0).all():
            chosen = others
    return np.array(sorted(chosen), np.int64)


def _order(apart: Floats, chosen: Ints) -> Ints:
    """The chosen poses in the order of a short open way: nearest first from an end, then 2-opt."""
    if len(chosen) < 3:
        return chosen
    gap = apart[np.ix_(chosen, chosen)]
    best: list[int] = []
    least = np.inf
    for start in {0, len(chosen) - 1, int(gap.sum(axis=1).argmax())}:
        tour = _two_opt(_nearest_first(gap, start), gap)
        length = gap[tour[:-1], tour[1:]].sum()
        if length < least:
            best, least = tour, length
    return chosen[best]


def _nearest_first(gap: Floats, start: int) -> list[int]:
    left, tour = set(range(len(gap))) - {start}, [start]
    while left:
        tour.append(min(left, key=lambda other: (gap[tour[-1], other], other)))
        left.remove(tour[-1])
    return tour


def _two_opt(tour: list[int], gap: Floats) -> list[int]:
    """The tour without crossings: stretches are turned round while that shortens it."""
    order, better = np.array(tour), True
    while better:
        better = False
        for i in range(len(order) - 1):
            for j in range(i + 1, len(order)):
                before = 0.0 if i == 0 else gap[order[i - 1], order[i]]
                before += 0.0 if j == len(order) - 1 else gap[order[j], order[j + 1]]
                after = 0.0 if i == 0 else gap[order[i - 1], order[j]]
                after += 0.0 if j == len(order) - 1 else gap[order[i], order[j + 1]]
                if after < before - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1].copy()
                    better = True
    return order.tolist()


def _exchanged(apart: Floats, seen: Bools, chosen: Ints) -> Ints:
    """The same with poses exchanged for others that show what they alone show, on a shorter way."""
    chosen = chosen.copy()
    for _ in range(_SWEEPS):
        changed = False
        at = 0
        while at < len(chosen):
            others = np.delete(chosen, at)
            needed = ~seen[others].any(axis=0) if len(others) else np.ones(seen.shape[1], bool)
            if len(others) and not needed.any():
                chosen, changed = others, True
                continue
            fit = np.flatnonzero(seen[:, needed].all(axis=1))
            ends = [chosen[near] for near in (at - 1, at + 1) if 0 <= near < len(chosen)]
            cost = np.zeros(len(fit))
            for end in ends:
                cost += apart[fit, end]
            best = int(fit[int(cost.argmin())])
            own = sum(float(apart[chosen[at], end]) for end in ends)
            if cost.min() < own - 1e-6:
                chosen[at], changed = best, True
            at += 1
        if not changed:
            break
        chosen = _order(apart, chosen)
    return chosen
