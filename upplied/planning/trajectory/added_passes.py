"""Further passes in the expert's manner, where the demonstrated ones cannot show all from as near.

Passes run beside the demonstrated ones on lanes of the surface (`lanes`), over the length on which they are
needed (`arrangement`). Each is flown where the transits to it and on from it are shortest: once more round
after the flight, back along it, or out and back within it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
_PRICES = (0.8, 0.27, 0.09, 0.03)  # of what a second shows in the mean, that a second must: few passes first
_SHARES = (
    np.inf,
    1.0,
    0.9,
    0.8,
    0.7,
    0.6,
    0.5,
    0.4,
    0.3,
    0.2,
)  # of the time that is left, in which a part of a pass is flown


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
    most: int  # passes to each side

    def seconds(self, path: Flown, origin: Ints) -> Floats:
        """About how long each leg (M - 1,) takes."""
        speed = np.maximum(np.minimum(self.speed_mps[origin][1:], self.speed_mps[origin][:-1]), 0.1)
        turned = np.hypot(np.cos(path.pitch[1:]) * wrapped(np.diff(path.yaw)), np.diff(path.pitch))
        return np.maximum(leg_lengths(path.positions) / speed, turned / self.pan_radps)


def with_added_passes(path: Flown, view: View, ways: Ways, pace: Pace, half_rad: float) -> Extended | None:
    """The path with passes beside it, as many as show what is needed; None where it is enough alone.

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
    needed = np.flatnonzero(view.need > 0)
    few = needed[:: max(1, len(needed) // _NEEDED)]
    lanes = lanes_beside(path, view, ways.planning, half_rad, few) if len(few) else None
    if lanes is None or len(lanes.station) < 2:
        return None
    cover = Cover.of(lanes, view.need[few] / view.need[few].sum())
    spent = cumulated(pace.seconds(path, np.arange(len(path))))
    seconds, spare_s = np.gradient(spent[lanes.station]), pace.allowed_s - float(spent[-1])
    best, most = None, 0.0
    for times in _PRICES if spare_s > 0 else ():
        passes = arranged(cover, seconds, times / pace.allowed_s, pace.most)
        tour = _Tour(path, lanes, ways, pace)
        worth = _put_in(tour, passes, cover, seconds, spare_s)
        if worth > most:
            best, most = tour, worth
    return None if best is None else best.flown()


def _put_in(tour: _Tour, passes: list[Pass], cover: Cover, seconds: Floats, spare_s: float) -> float:
    """Put passes into a tour, those first that show most a second; what they show more than they must."""
    worth = 0.0
    flown = np.zeros((cover.stations, 2 * STEPS + 1), bool)
    flown[:, STEPS] = True
    while passes:
        before = cover.before(flown)
        gains = [cover.before(one.flown_with(flown)) - before for one in passes]
        rates = [
            gain.sum() / max(seconds[one.rows].sum(), 1e-9) for gain, one in zip(gains, passes, strict=True)
        ]
        best = int(np.argmax(rates))
        one, gain = passes.pop(best), gains[best]
        for share in _SHARES:
            part = one.within(gain, seconds, share * spare_s)
            more = float((cover.before(part.flown_with(flown)) - before).sum())
            if more < _LEAST:
                break
            if (taken_s := tour.put_in(part, spare_s)) > 0:
                flown, worth, spare_s = part.flown_with(flown), worth + more - _LEAST, spare_s - taken_s
                break
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


class _Tour:
    """A path, and the passes that are put into it."""

    def __init__(self, path: Flown, lanes: Lanes, ways: Ways, pace: Pace) -> None:
        self.lanes, self.ways, self.pace = lanes, ways, pace
        self.step_m = max(float(np.median(leg_lengths(path.positions))), 0.05)
        self.pieces = [_Piece(path, np.arange(len(path)), False)]
        self.own = np.full(len(lanes.station), STEPS)  # the lane of the demonstrated pass

    def put_in(self, one: Pass, spare_s: float) -> float:
        """Seconds that a pass takes, put where it makes the way least longer; 0 where it is not put in."""
        free = self.lanes.free[one.rows, one.lane]
        if free.sum() < 2:
            return 0.0
        poses = self.lanes.poses[one.rows[free], one.lane[free]]
        origin = self.lanes.station[one.rows[free]]
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
        if seconds > spare_s or any(self._transit(*leg) is None for leg in legs):
            return 0.0
        self.pieces[piece : piece + 1] = [before, _spaced(_Piece(path, origin, True), self.step_m), *rest]
        self.own[one.rows] = one.own
        return seconds

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
