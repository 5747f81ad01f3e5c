"""Further passes in the expert's manner, for what a path leaves unseen in the time that there is.

Of the strips beside a path, stretches that show most for their time are taken one after the other and put
into the path where the transits to and from them are shortest; so neighbours are flown back and forth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.planning.airspace.detours import Ways
from upplied.planning.airspace.roadmap import way
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.strips import Strip, strips_beside
from upplied.planning.trajectory.view import View
from upplied.polylines import arc_length, interpolated, leg_lengths
from upplied.poses import from_yaw_pitch, wrapped
from upplied.records import Bools, Floats, Ints, Record

_MISSED = 600  # samples, at most, that stand for all that is missed
_LEAST = 2e-3  # share of the need that a stretch must add
_END_S = 2.0  # to slow down and turn at each end of a stretch
_PRICES = np.array([1.0, 3.0, 9.0, 27.0])  # of a second, over the least rate


@dataclass(frozen=True, eq=False, repr=False)
class Extended(Record):
    """A path with passes added to it, at M' stations."""

    path: Flown
    origin: Ints  # (M',) the station of the path before, whose moment of the demonstration each has
    added: Bools  # (M',)


@dataclass(frozen=True, eq=False, repr=False)
class Pace(Record):
    """How fast a path is flown, and in how much time."""

    speed_mps: Floats  # (M,) at its stations
    pan_radps: float
    allowed_s: float
    least_rate: float  # of the mean share of the need shown a second, that a stretch must show more

    def seconds(self, path: Flown, origin: Ints) -> Floats:
        """About how long each leg (M - 1,) takes."""
        speed = np.maximum(np.minimum(self.speed_mps[origin][1:], self.speed_mps[origin][:-1]), 0.1)
        turned = np.hypot(np.cos(path.pitch[1:]) * wrapped(np.diff(path.yaw)), np.diff(path.pitch))
        return np.maximum(leg_lengths(path.positions) / speed, turned / self.pan_radps)


def with_added_passes(path: Flown, view: View, ways: Ways, pace: Pace, half_rad: float) -> Extended | None:
    """The path with stretches of strips that show what it misses; None where none is worth its time.

    Parameters
    ----------
    path : Flown
        M stations.
    view : View
    ways : Ways
        Of the target: transits to a strip and back lead round what stands in their way.
    pace : Pace
    half_rad : float
        See `strips.strips_beside`.
    """
    missed = view.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    if view.need[missed].sum() <= _LEAST:
        return None
    few = missed[:: max(1, len(missed) // _MISSED)]
    left = view.need[few] * (view.need[missed].sum() / view.need[few].sum())
    strips, _ = strips_beside(path, view, ways.planning, half_rad, few)
    strips = [strip for strip in strips if strip.shows.any()]
    tour = _Tour(path, ways, pace)
    spare_s = pace.allowed_s - float(pace.seconds(path, np.arange(len(path))).sum())
    while strips:
        offers = [offer for strip in strips for offer in _offers(strip, left, tour)]
        worth = np.array(
            [offer.gain / offer.seconds if offer.seconds <= spare_s else 0.0 for offer in offers]
        )
        worth[[offer.gain < _LEAST for offer in offers]] = 0.0
        best = int(worth.argmax())
        offer = offers[best]
        if worth[best] * pace.allowed_s < pace.least_rate:
            break
        if tour.put_in(offer):
            left[offer.strip.shows[offer.rows].any(axis=0)] = 0.0
            spare_s -= offer.seconds
        else:
            strips.remove(offer.strip)
    return tour.flown() if tour.inserted else None


@dataclass(frozen=True, eq=False, repr=False)
class _Offer(Record):
    """A stretch of a strip, where it would be put, and what it would show."""

    strip: Strip
    rows: Ints  # (K,) of the strip, in the order that they would be flown in
    gap: int  # station after which
    place: int  # among the stretches that are there already
    gain: float
    seconds: float


def _offers(strip: Strip, left: Floats, tour: _Tour) -> list[_Offer]:
    """Stretches of a strip that are worth most by several prices of time, put where that takes least.

    A low price takes a strip as a whole, a high one what of it shows much in little time.
    """
    shows, pace = strip.shows, tour.pace
    count = shows.sum(axis=0)
    wanted = np.flatnonzero((count > 0) & (left > 0))
    middle = np.argmax(2 * np.cumsum(shows[:, wanted], axis=0) >= count[wanted], axis=0)
    gain = np.bincount(middle, left[wanted], len(strip.station))
    seconds = np.append(pace.seconds(strip.poses, strip.station), 0.0)
    speed = max(float(np.median(pace.speed_mps[strip.station])), 0.1)
    offers = []
    for first, last in dict.fromkeys(
        _best_run(gain - seconds * rate / pace.allowed_s) for rate in pace.least_rate * _PRICES
    ):
        rows = np.arange(first, last + 1)
        gap, place, turned, way_m = tour.cheapest(strip.poses.positions[[first, last]])
        total = float(left[shows[rows].any(axis=0)].sum())
        spent = float(seconds[first:last].sum()) + way_m / speed + 2 * _END_S
        offers.append(_Offer(strip, rows[::-1] if turned else rows, gap, place, total, spent))
    return offers


def _best_run(values: Floats) -> tuple[int, int]:
    """First and last of the run of values with the largest sum."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    lowest = np.minimum.accumulate(total[:-1])
    last = int(np.argmax(total[1:] - lowest))
    return int(np.argmin(total[: last + 1])), last


class _Tour:
    """A path, and the stretches that are flown between two of its stations."""

    def __init__(self, path: Flown, ways: Ways, pace: Pace) -> None:
        self.path, self.ways, self.pace = path, ways, pace
        self.inserted: dict[int, list[tuple[Strip, Ints]]] = {}

    def cheapest(self, ends: Floats) -> tuple[int, int, bool, float]:
        """Where a stretch between two ends (2, 3) makes the way least longer: gap, place there, turned, m."""
        positions = self.path.positions
        free = np.array([gap for gap in range(len(positions) - 1) if gap not in self.inserted], np.int64)
        chains = {gap: self._chain(gap) for gap in self.inserted}
        taken = [(gap, place) for gap, ends in chains.items() for place in range(len(ends) // 2)]
        gaps = np.concatenate([free, np.array([gap for gap, _ in taken], np.int64)])
        places = np.concatenate([np.zeros(len(free), np.int64), np.array([at for _, at in taken], np.int64)])
        start = np.vstack([positions[free], *(chains[gap][2 * at][None] for gap, at in taken)])
        stop = np.vstack([positions[free + 1], *(chains[gap][2 * at + 1][None] for gap, at in taken)])
        direct = np.linalg.norm(stop - start, axis=1)
        costs = np.stack(
            [
                np.linalg.norm(ends[a] - start, axis=1) + np.linalg.norm(stop - ends[b], axis=1) - direct
                for a, b in ((0, 1), (1, 0))
            ]
        )
        turned, row = divmod(int(costs.argmin()), costs.shape[1])
        return int(gaps[row]), int(places[row]), bool(turned), float(costs[turned, row])

    def _chain(self, gap: int) -> list[Floats]:
        """The places that legs of a gap start and stop at, in turn."""
        ends = [strip.poses.positions[rows[[0, -1]]] for strip, rows in self.inserted.get(gap, [])]
        return [
            self.path.positions[gap],
            *(place for pair in ends for place in pair),
            self.path.positions[gap + 1],
        ]

    def put_in(self, offer: _Offer) -> bool:
        """Put a stretch in, if there is a way to it and on from it."""
        ends = offer.strip.poses.positions[offer.rows[[0, -1]]]
        chain = self._chain(offer.gap)
        legs = (chain[2 * offer.place], ends[0]), (ends[1], chain[2 * offer.place + 1])
        if any(self._transit(*leg) is None for leg in legs):
            return False
        self.inserted.setdefault(offer.gap, []).insert(offer.place, (offer.strip, offer.rows))
        return True

    def _transit(self, start: Floats, stop: Floats) -> Floats | None:
        """A safe way (K, 3) from one place to another, both included."""
        both = np.stack([start, stop])
        return both if not self.ways.planning.broken(both)[0] else way(self.ways.graph, start, stop)

    def flown(self) -> Extended:
        """The path with its stretches and the ways there and back."""
        step_m = max(float(np.median(leg_lengths(self.path.positions))), 0.05)
        parts: list[tuple[Flown, Ints, Bools]] = []
        last = 0
        for gap in sorted(self.inserted):
            parts.append(self._own(last, gap + 1))
            chain = self._chain(gap)
            for place, (strip, rows) in enumerate(self.inserted[gap]):
                poses = Flown(strip.poses.positions[rows], strip.poses.yaw[rows], strip.poses.pitch[rows])
                parts.append(
                    self._between(parts[-1][0], poses, chain[2 * place : 2 * place + 2], gap, step_m)
                )
                parts.append(_added(_spaced(poses, step_m), gap))
            back = self._own(gap + 1, gap + 2)[0]
            parts.append(self._between(parts[-1][0], back, chain[-2:], gap, step_m))
            last = gap + 1
        parts.append(self._own(last, len(self.path)))
        whole = [
            np.concatenate([getattr(part[0], name) for part in parts])
            for name in ("positions", "yaw", "pitch")
        ]
        origin, added = (np.concatenate([part[at] for part in parts]) for at in (1, 2))
        return Extended(Flown(whole[0], np.unwrap(whole[1]), whole[2]), origin, added)

    def _own(self, first: int, stop: int) -> tuple[Flown, Ints, Bools]:
        path, chosen = self.path, slice(first, stop)
        poses = Flown(path.positions[chosen], path.yaw[chosen], path.pitch[chosen])
        return poses, np.arange(first, stop), np.zeros(stop - first, bool)

    def _between(
        self, before: Flown, after: Flown, ends: Sequence[Floats], gap: int, step_m: float
    ) -> tuple[Flown, Ints, Bools]:
        """The stations of a transit, without its ends, as the camera turns from one to the other."""
        line = self._transit(*ends)
        line = np.stack(list(ends)) if line is None else line  # it was free before
        along = arc_length(line)
        yaw = before.yaw[-1] + np.array([0.0, float(wrapped(after.yaw[0] - before.yaw[-1]))])
        pitch, share = np.array([before.pitch[-1], after.pitch[0]]), along / max(float(along[-1]), 1e-9)
        poses = Flown(line, np.interp(share, [0, 1], yaw), np.interp(share, [0, 1], pitch))
        spaced = _spaced(poses, step_m)
        inner = Flown(spaced.positions[1:-1], spaced.yaw[1:-1], spaced.pitch[1:-1])
        return _added(inner, gap)


def _added(poses: Flown, gap: int) -> tuple[Flown, Ints, Bools]:
    return poses, np.full(len(poses), gap), np.ones(len(poses), bool)


def _spaced(poses: Flown, step_m: float) -> Flown:
    """Poses with stations about so far apart; none on a way of no length but its ends."""
    along = arc_length(poses.positions)
    number = max(int(np.ceil(along[-1] / step_m)), 1)
    at = np.linspace(0, along[-1], number + 1)
    angles = interpolated(at, along, np.column_stack([poses.yaw, poses.pitch]))
    return Flown(interpolated(at, along, poses.positions), *angles.T)
