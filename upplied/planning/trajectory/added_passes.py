"""Further passes in the expert's manner, where the demonstrated ones cannot show all from as near.

Passes run beside the demonstrated ones on lanes of the surface (`lanes`), over the length on which they are
needed (`arrangement`). Each is flown where the transits to it and on from it are shortest: once more round
after the flight, back along it, or out and back within it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, cumulated, interpolated, leg_lengths
from upplied.geometry.poses import wrapped
from upplied.planning.airspace.detours import Ways
from upplied.planning.airspace.roadmap import way
from upplied.planning.trajectory.arrangement import Cover, Pass, arranged
from upplied.planning.trajectory.lanes import STEPS, Lanes, lanes_beside
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record

_NEEDED = 600  # samples, at most, that stand for all that is needed
_LEAST = 0.02  # share of the need, that a pass must show
_TURN_S = 2.0  # to slow down and turn at each end of a pass
PRICES = (0.8, 0.27, 0.09, 0.03)  # of what a second shows in the mean, that a second must: few passes first
_AS_GOOD = 0.9  # of what the best of the prices shows: the first of them that shows as much is taken
_HALVINGS = 6  # by which the longest part of a pass is sought for which there is time


@dataclass(frozen=True, eq=False, repr=False)
class Extended(Record):
    """A path with passes added to it, at M' stations."""

    path: Flown
    origin: Ints  # (M',) the station of the path before, whose moment of the demonstration each has
    added: Bools  # (M',)


@dataclass(frozen=True, eq=False, repr=False)
class Pace(Record):
    """How fast a path is flown."""

    speed_mps: Floats  # (M,) at its stations
    pan_radps: float

    def seconds(self, path: Flown, origin: Ints) -> Floats:
        """About how long each leg (M - 1,) takes."""
        speed = np.maximum(np.minimum(self.speed_mps[origin][1:], self.speed_mps[origin][:-1]), 0.1)
        turned = np.hypot(np.cos(path.pitch[1:]) * wrapped(np.diff(path.yaw)), np.diff(path.pitch))
        return np.maximum(leg_lengths(path.positions) / speed, turned / self.pan_radps)


@dataclass(frozen=True, eq=False, repr=False)
class Beside(Record):
    """What passes beside a path can show of what is needed, and how long they take."""

    path: Flown
    lanes: Lanes
    cover: Cover
    seconds: Floats  # (S,) that one pass takes beside each station of the lanes
    own_s: float  # of the path alone
    ways: Ways
    pace: Pace

    @classmethod
    def of(cls, path: Flown, view: View, ways: Ways, pace: Pace, half_rad: float) -> Beside | None:
        """The lanes beside a path; None where nothing is to be shown from them.

        Parameters
        ----------
        path : Flown
            M stations.
        view : View
        ways : Ways
            Of the target: transits to a pass and on from it lead round what stands in their way.
        pace : Pace
        half_rad : float
            See `lanes.lanes_beside`.
        """
        few = np.flatnonzero(view.need > 0)[:_NEEDED]  # every beginning of samples is spread evenly
        lanes = lanes_beside(path, view, ways.planning, half_rad, few) if len(few) else None
        if lanes is None or len(lanes.station) < 2:
            return None
        cover = Cover.of(lanes, view.need[few] / view.need[few].sum())
        spent = cumulated(pace.seconds(path, np.arange(len(path))))
        return cls(path, lanes, cover, np.gradient(spent[lanes.station]), float(spent[-1]), ways, pace)

    def with_passes(
        self, allowed_s: float, most: int, prices: Sequence[float] = PRICES
    ) -> tuple[Extended, Sequence[float]]:
        """The path with as many passes as show what is needed in the time, at most `most` to each side.

        `prices` are tried, and the one that was taken is returned.

        Raises
        ------
        RefusedError
            If the path is enough alone, or there is no time.
        """
        tours, spare_s = [], allowed_s - self.own_s
        for times in prices if spare_s > 0 else ():
            passes = arranged(self.cover, self.seconds, times / allowed_s, most)
            tour = _Tour(self.path, self.lanes, self.ways, self.pace)
            tours.append((self._put_in(tour, passes, spare_s), tour, times))
        best = max((worth for worth, *_ in tours), default=0.0)
        if best <= 0:
            raise RefusedError("added passes", "show nothing more in the time", "some must", "plan without")
        _, tour, price = next(one for one in tours if one[0] >= _AS_GOOD * best)
        return tour.flown(), (price,)

    @property
    def alone(self) -> tuple[Flown, Ints, Bools]:
        """The path without passes."""
        number = len(self.path)
        return self.path, np.arange(number), np.zeros(number, bool)

    def _put_in(self, tour: _Tour, passes: list[Pass], spare_s: float) -> float:
        """Put passes into a tour, those first that show most a second; what they show more than they must."""
        cover, seconds, worth = self.cover, self.seconds, 0.0
        flown = np.zeros((cover.stations, 2 * STEPS + 1), bool)
        flown[:, STEPS] = True
        while passes:
            before = cover.before(flown)
            gains = [cover.before(one.flown_with(flown)) - before for one in passes]
            spent = [max(float(seconds[one.rows].sum()), 1e-9) for one in passes]
            best = int(np.argmax([gain.sum() / each for gain, each in zip(gains, spent, strict=True)]))
            one, gain = passes.pop(best), gains[best]
            part = tour.longest(one, gain, seconds, spare_s)
            if part is None:
                continue
            more = float((cover.before(part.flown_with(flown)) - before).sum())
            if more < _LEAST:
                continue
            spare_s -= tour.put_in(part)
            flown, worth = part.flown_with(flown), worth + more - _LEAST
        return worth


@dataclass(frozen=True, eq=False, repr=False)
class _Piece(Record):
    """What is flown without a transit."""

    path: Flown
    origin: Ints  # of each of its stations
    added: bool

    def cut(self, first: int, stop: int | None) -> _Piece:
        part = slice(first, stop)
        path = Flown(self.path.positions[part], self.path.yaw[part], self.path.pitch[part])
        return _Piece(path, self.origin[part], self.added)


@dataclass(frozen=True, eq=False, repr=False)
class _Insertion(Record):
    """A pass as it would be put into a tour."""

    path: Flown
    origin: Ints
    piece: int  # that it is put into
    before: _Piece  # what of that is flown before it
    rest: Sequence[_Piece]  # and after it
    seconds: float  # that it takes, with the way to it; inf where it cannot be put in


class _Tour:
    """A path, and the passes that are put into it."""

    def __init__(self, path: Flown, lanes: Lanes, ways: Ways, pace: Pace) -> None:
        self.lanes, self.ways, self.pace = lanes, ways, pace
        self.step_m = max(float(np.median(leg_lengths(path.positions))), 0.05)
        self.pieces = [_Piece(path, np.arange(len(path)), False)]
        self.own = np.full(len(lanes.station), STEPS)  # the lane of the demonstrated pass

    def longest(self, whole: Pass, gains: Floats, seconds: Floats, spare_s: float) -> Pass | None:
        """A pass or the longest part of it that can be put in (`Pass.within`); None where there is none."""
        if self._insertion(whole).seconds <= spare_s:
            return whole
        low, high, part = 0.0, 1.0, None
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            tried = whole.within(gains, seconds, middle * spare_s)
            if self._insertion(tried).seconds <= spare_s:
                low, part = middle, tried
            else:
                high = middle
        return part

    def put_in(self, one: Pass) -> float:
        """Seconds that a pass takes, put where it makes the way least longer."""
        found = self._insertion(one)
        added = _spaced(_Piece(found.path, found.origin, True), self.step_m)
        self.pieces[found.piece : found.piece + 1] = [found.before, added, *found.rest]
        self.own[one.rows] = one.own
        return found.seconds

    def _insertion(self, one: Pass) -> _Insertion:
        free = self.lanes.free[one.rows, one.lane]
        poses = self.lanes.poses[one.rows[free], one.lane[free]]
        origin = self.lanes.station[one.rows[free]]
        if len(poses) < 2:
            return _Insertion(self.pieces[0].path, origin, 0, self.pieces[0], [], np.inf)
        piece, at, turned, way_m = self._cheapest(poses[[0, -1], :3])
        if turned:
            poses, origin = poses[::-1], origin[::-1]
        path = Flown(poses[:, :3], np.unwrap(poses[:, 3]), poses[:, 4])
        speed = max(float(np.median(self.pace.speed_mps[origin])), 0.1)
        seconds = float(self.pace.seconds(path, origin).sum()) + way_m / speed + 2 * _TURN_S
        before, after = self.pieces[piece].cut(0, at + 1), self.pieces[piece].cut(at + 1, None)
        rest = [after] if len(after.path) else []
        following = (rest or self.pieces[piece + 1 : piece + 2])[:1]
        legs = [(before.path.positions[-1], path.positions[0])]
        legs += [(path.positions[-1], one.path.positions[0]) for one in following]
        if any(self._transit(*leg) is None for leg in legs):
            seconds = np.inf
        return _Insertion(path, origin, piece, before, rest, seconds)

    def _cheapest(self, ends: Floats) -> tuple[int, int, bool, float]:
        """Piece, and station of it, after which a pass between two ends (2, 3) makes the way least longer.

        Also whether it is flown the other way round, and by how much longer, m. Nothing follows on the last.
        """
        start, stop, place = [], [], []
        for number, piece in enumerate(self.pieces):
            after = (
                self.pieces[number + 1].path.positions[:1] if number + 1 < len(self.pieces) else ends * np.nan
            )
            at = np.arange(len(piece.path))[-1 if piece.added else 0 :]
            start.append(piece.path.positions[at])
            stop.append(np.concatenate([piece.path.positions, after[:1]])[at + 1])
            place += [(number, int(one)) for one in at]
        starts, stops = np.concatenate(start), np.concatenate(stop)
        costs = np.stack(
            [
                np.linalg.norm(ends[a] - starts, axis=1)
                + np.nan_to_num(
                    np.linalg.norm(stops - ends[b], axis=1) - np.linalg.norm(stops - starts, axis=1)
                )
                for a, b in ((0, 1), (1, 0))
            ]
        )
        turned, row = divmod(int(costs.argmin()), len(place))
        return *place[row], bool(turned), float(costs[turned, row])

    def _transit(self, start: Floats, stop: Floats) -> Floats | None:
        """A safe way (K, 3) from one place to another, both included."""
        both = np.stack([start, stop])
        return both if not self.ways.planning.broken(both)[0] else way(self.ways.graph, start, stop)

    def flown(self) -> Extended:
        """The path, moved aside where passes are flown beside it, with those and the transits."""
        parts = [self._aside(self.pieces[0])]
        for piece in self.pieces[1:]:
            piece = piece if piece.added else self._aside(piece)
            parts += [self._between(parts[-1], piece), piece]
        positions, yaw, pitch = (
            np.concatenate([getattr(part.path, name) for part in parts])
            for name in ("positions", "yaw", "pitch")
        )
        added = np.concatenate([np.full(len(part.path), part.added) for part in parts])
        origin = np.concatenate([part.origin for part in parts])
        return Extended(Flown(positions, np.unwrap(yaw), pitch), origin, added)

    def _aside(self, piece: _Piece) -> _Piece:
        """A piece of the demonstrated pass on the lane that it is flown on."""
        poses, row = self.lanes.poses, np.arange(len(self.own))
        off = poses[row, self.own] - poses[:, STEPS]
        off[:, 3] = wrapped(off[:, 3])
        off[~self.lanes.free[row, self.own]] = 0.0
        off = interpolated(piece.origin.astype(float), self.lanes.station.astype(float), off)
        path = piece.path
        path = Flown(path.positions + off[:, :3], path.yaw + off[:, 3], path.pitch + off[:, 4])
        return _Piece(path, piece.origin, False)

    def _between(self, before: _Piece, after: _Piece) -> _Piece:
        """The stations of a transit, without its ends, as the camera turns from one to the other."""
        ends = before.path.positions[-1], after.path.positions[0]
        line = self._transit(*ends)
        line = np.stack(ends) if line is None else line  # it was free before the path was moved aside
        share = arc_length(line)
        share = share / max(float(share[-1]), 1e-9)
        yaw = before.path.yaw[-1] + np.array([0.0, float(wrapped(after.path.yaw[0] - before.path.yaw[-1]))])
        pitch = np.array([before.path.pitch[-1], after.path.pitch[0]])
        poses = Flown(line, np.interp(share, [0, 1], yaw), np.interp(share, [0, 1], pitch))
        whole = _spaced(_Piece(poses, np.full(len(line), before.origin[-1]), True), self.step_m)
        return whole.cut(1, -1)


def _spaced(piece: _Piece, step_m: float) -> _Piece:
    """The same with stations about so far apart; on a way of no length its ends alone."""
    path = piece.path
    along = arc_length(path.positions)
    at = np.linspace(0, along[-1], max(int(np.ceil(along[-1] / step_m)), 1) + 1)
    poses = interpolated(at, along, np.column_stack([path.positions, path.yaw, path.pitch]))
    origin = piece.origin[np.searchsorted(along, at).clip(0, len(along) - 1)]
    return _Piece(Flown(poses[:, :3], poses[:, 3], poses[:, 4]), origin, piece.added)
