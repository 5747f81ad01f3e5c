"""How many passes are flown beside each station of a path, and how far aside the demonstrated one is flown.

All stations are decided at once, by what the lanes show, what they take in time, and what it takes to begin
and to end a pass: so it is flown over the whole length on which it is needed, and no single sample decides.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.lanes import STEPS, Lanes
from upplied.records import Bools, Floats, Ints, Record

_APART = (3, 2)  # steps, from one pass to the next: side by side, or with a third of a swath in common
_ASIDE = 1  # steps, by which the demonstrated pass may be moved where others are flown
_END_S = 10.0  # that beginning a pass takes, and ending it: to fly there, slow down and turn
_WINDOW = 3  # stations to each side, from which a sample is shown
_NEARER = 0.25  # of a step, by which a lane must be nearer to a sample than the next one to the path


@dataclass(frozen=True, eq=False, repr=False)
class Pass(Record):
    """A pass beside the demonstrated one, over R stations of the lanes that follow each other."""

    rows: Ints  # (R,)
    lane: Ints  # (R,)
    own: Ints  # (R,) the lane of the demonstrated pass

    def to(self, stop: int) -> Pass:
        """Its beginning."""
        return Pass(self.rows[:stop], self.lane[:stop], self.own[:stop])

    def flown_with(self, flown: Bools) -> Bools:
        """The lanes that are flown (S, K), with this pass."""
        after = flown.copy()
        after[self.rows, STEPS] &= self.own == STEPS
        after[self.rows, self.own] = after[self.rows, self.lane] = True
        return after


@dataclass(frozen=True, eq=False, repr=False)
class Cover(Record):
    """Which lanes show the samples (m,) that lie before each station."""

    owner: Ints  # (m,) the station that each lies before
    shown: Bools  # (K, m)
    need: Floats  # (m,)
    stations: int

    @classmethod
    def of(cls, lanes: Lanes, need: Floats) -> Cover:
        """The samples that any lane shows; each lies before the place that is nearest to it of those."""
        row, lane, sample = np.nonzero(lanes.shows)
        apart = np.linalg.norm(lanes.surface[row, lane] - lanes.points[sample], axis=1)
        apart += _NEARER * lanes.step_m * np.abs(lane - STEPS)
        order = np.lexsort((apart, sample))
        mine, first = np.unique(sample[order], return_index=True)
        owner = row[order][first]
        of_mine = np.searchsorted(mine, sample)
        beside = np.abs(row - owner[of_mine]) <= _WINDOW
        shown = np.zeros((lanes.shows.shape[1], len(mine)), bool)
        shown[lane[beside], of_mine[beside]] = True
        return cls(owner, shown, need[mine], len(lanes.station))

    def before(self, flown: Bools) -> Floats:
        """Share of the need (S,) that the lanes flown (S, K) show before each station."""
        seen = (flown[self.owner].T & self.shown).any(axis=0)
        return np.asarray(np.bincount(self.owner[seen], self.need[seen], self.stations), float)


def arranged(cover: Cover, seconds: Floats, price: float, most: int) -> list[Pass]:
    """The passes that are worth most over the whole path, the nearest to the demonstrated one first.

    Parameters
    ----------
    cover : Cover
    seconds : array, shape (S,)
        That one pass takes beside each station.
    price : float
        Share of the need, that a second must show.
    most : int
        Passes to each side.
    """
    table, every = _states(most), np.arange(cover.stations)
    cost = np.empty((cover.stations, len(table)))
    for column, state in enumerate(table):
        flown = np.zeros((cover.stations, 2 * STEPS + 1), bool)
        flown[:, _lane(state, np.arange(-state[1], state[2] + 1))] = True
        cost[:, column] = price * seconds * (1 + state[1:3].sum()) - cover.before(flown)
    change = price * _END_S * np.abs(table[:, None] - table[None]).sum(axis=2)
    total, came = cost[0] + change[0], np.zeros(cost.shape, np.int64)
    for row in every[1:]:
        after = total[:, None] + change
        came[row] = after.argmin(axis=0)
        total = after.min(axis=0) + cost[row]
    best = np.full(cover.stations, int((total + change[0]).argmin()))
    for row in every[:0:-1]:
        best[row - 1] = came[row, best[row]]
    state, passes = table[best], []
    for number, (side, sign) in itertools.product(range(1, most + 1), ((1, -1), (2, 1))):
        beside = np.flatnonzero(state[:, side] >= number)
        for rows in np.split(beside, np.flatnonzero(np.diff(beside) > 1) + 1) if len(beside) else []:
            passes.append(Pass(rows, _lane(state[rows], sign * number), _lane(state[rows], 0)))
    return passes


def _states(most: int) -> Ints:
    """Steps aside of the demonstrated pass, passes to its right and left, and steps between them, (N, 4).

    The first has none beside it.
    """
    aside, count = range(-_ASIDE, _ASIDE + 1), range(most + 1)
    every = [one for one in itertools.product(aside, count, count, _APART) if one[1] or one[2]]
    table = np.array([(0, 0, 0, _APART[0]), *every])
    ends = [np.abs(_lane(table, sign * table[:, side]) - STEPS) for side, sign in ((1, -1), (2, 1))]
    return table[np.maximum(*ends) <= STEPS]


def _lane(state: Ints, number: int | Ints) -> Ints:
    """The lane of a pass: 0 is the demonstrated one, those above lie to its left, others to its right."""
    return STEPS + state[..., 0] + state[..., 3] * number
