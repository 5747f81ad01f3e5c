"""Further passes in the expert's manner, where the demonstrated ones cannot show all from as near.

Passes run beside the demonstrated ones on lanes of the surface (`lanes`), over the length on which they are
needed (`arrangement`). They are flown after the flight, once more round or back along it.
"""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import arc_length, cumulated, interpolated, leg_lengths
from upplied.geometry.poses import wrapped
from upplied.planning.airspace.detours import Ways
from upplied.planning.airspace.roadmap import way
from upplied.planning.trajectory.lanes import Cover, Lanes, Pass, arranged, lanes_beside
from upplied.planning.trajectory.optimise import as_good
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import ALIKE, View
from upplied.records import Bools, Floats, Ints, Record, Rows

_NEEDED = 600  # samples, at most, that stand for all that is needed
_PIECES = 8  # of a pass, of which as many are flown as there is time for: a second seldom moves an end
_TURN_S = 2.0  # to slow down and turn at each end of a pass
_PRICE = 0.05  # of what a second of the flight shows in the mean, that a second of a pass must


def pays(gain: float, taken_s: float, own_s: float) -> bool:
    """Whether what shows so much more of the need pays for the time it takes, beside a flight of `own_s`."""
    return gain >= ALIKE and gain * own_s >= _PRICE * taken_s


@dataclass(frozen=True, eq=False, repr=False)
class Extended(Record):
    """A path with passes added to it, at M' stations."""

    path: Flown
    origin: Ints  # (M',) the station of the path before, whose moment of the demonstration each has
    added: Bools  # (M',)
    passes_s: float = 0.0  # that the passes take at the pace of the flight

    @classmethod
    def alone(cls, path: Flown) -> "Extended":
        """A path without passes."""
        return cls(path, np.arange(len(path)), np.zeros(len(path), bool))


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
    def of(
        cls, path: Flown, view: View, missed: Ints, ways: Ways, pace: Pace, half_rad: float, most: int
    ) -> "Beside | None":
        """The lanes beside a path (`lanes.lanes_beside`); None where they show too little of what is missed.

        `missed` are the samples of the view that the optimised flight misses without passes. Transits to a
        pass and on from it lead round what stands in their `ways`.
        """
        few, lacking = np.flatnonzero(view.need > 0)[:_NEEDED], missed[:_NEEDED]  # each spread evenly
        samples = np.concatenate([few, lacking])
        lanes = lanes_beside(path, view, ways.planning, half_rad, samples, most) if len(few) else None
        if lanes is None or len(lanes.station) < 2:
            return None
        shown = lanes.shows[:, :, len(few) :].any(axis=(0, 1))
        share = view.need[lacking][shown].sum() / max(view.need[lacking].sum(), 1e-12)
        if share * view.need[missed].sum() < ALIKE:
            return None
        lanes = replace(lanes, points=lanes.points[: len(few)], shows=lanes.shows[:, :, : len(few)])
        cover = Cover.of(lanes, view.need[few] / view.need[few].sum())
        spent = cumulated(pace.seconds(path, np.arange(len(path))))
        return cls(path, lanes, cover, np.gradient(spent[lanes.station]), float(spent[-1]), ways, pace)

    def with_passes(self, spare_s: float) -> Extended | None:
        """The path with as many passes as show what is needed in a time.

        Those that show most come first, of those that show as much the nearest to the flight. None where
        the path is enough alone, or there is no time.
        """
        if spare_s <= 0:
            return None
        tour, cover = _Tour(self.path, self.lanes, self.ways, self.pace), self.cover
        price = _PRICE / self.own_s
        passes = arranged(cover, self.seconds, price)
        flown = np.zeros(self.lanes.free.shape, bool)
        flown[:, self.lanes.middle] = True
        while passes:
            before = cover.before(flown)
            gains = [float((cover.before(one.flown_with(flown)) - before).sum()) for one in passes]
            part, taken_s = tour.longest(passes.pop(as_good(gains)[0]), spare_s - tour.passes_s)
            shown = part.flown_with(flown)
            gain = float((cover.before(shown) - before).sum())
            if tour.passes_s + taken_s <= spare_s and pays(gain, taken_s, self.own_s):
                tour.append(part, taken_s)
                flown = shown
        return tour.flown() if tour.passes_s > 0 else None


@dataclass(frozen=True, eq=False, repr=False)
class _Piece(Rows):
    """What is flown without a transit."""

    path: Flown
    origin: Ints  # of each of its stations
    added: Bools


class _Tour:
    """A path, and the passes that are put into it."""

    def __init__(self, path: Flown, lanes: Lanes, ways: Ways, pace: Pace) -> None:
        self.lanes, self.ways, self.pace = lanes, ways, pace
        self.step_m = max(float(np.median(leg_lengths(path.positions))), 0.05)
        self.pieces = [_Piece(path, np.arange(len(path)), np.zeros(len(path), bool))]
        self.passes_s = 0.0

    def longest(self, whole: Pass, spare_s: float) -> tuple[Pass, float]:
        """A pass from where it begins, as far as there is time for it, and the seconds that it takes."""
        whole = self._onward(whole)
        way_s = self._way_s(whole)
        for eighths in range(_PIECES, 0, -1):
            part = whole.rows(slice(len(whole) * eighths // _PIECES))
            taken_s = way_s + self._seconds(part)
            if taken_s <= spare_s:
                break
        return part, taken_s

    def append(self, one: Pass, taken_s: float) -> None:
        """Fly a pass after what is there."""
        self.passes_s += taken_s
        self.pieces.append(_spaced(self._flown_piece(one), self.step_m))

    def _onward(self, one: Pass) -> Pass:
        """A pass the way the flight goes, or back where it begins much nearer so."""
        one = one.rows(self.lanes.free[one.row, one.lane])
        if len(one) < 2:
            return one
        ends = self.lanes.poses[one.row[[0, -1]], one.lane[[0, -1]], :3]
        ahead_m, back_m = np.linalg.norm(ends - self.pieces[-1].path.positions[-1], axis=1)
        nearer = back_m < ahead_m - 0.5 * np.linalg.norm(ends[1] - ends[0])
        return one.rows(slice(None, None, -1)) if nearer else one

    def _flown_piece(self, one: Pass) -> _Piece:
        poses, origin = self.lanes.poses[one.row, one.lane], self.lanes.station[one.row]
        path = Flown(poses[:, :3], np.unwrap(poses[:, 3]), poses[:, 4])
        return _Piece(path, origin, np.ones(len(path), bool))

    def _seconds(self, one: Pass) -> float:
        """How long a pass takes without the way to it; infinite where nothing is left of it."""
        piece = self._flown_piece(one)
        return float(self.pace.seconds(piece.path, piece.origin).sum()) if len(one) > 1 else np.inf

    def _way_s(self, one: Pass) -> float:
        """How long the way to a pass takes, and turning at its ends; infinite where there is none."""
        if len(one) < 2:
            return np.inf
        piece = self._flown_piece(one)
        line = self._transit(self.pieces[-1].path.positions[-1], piece.path.positions[0])
        if line is None:
            return np.inf
        speed = max(float(np.median(self.pace.speed_mps[piece.origin])), 0.1)
        return float(leg_lengths(line).sum()) / speed + 2 * _TURN_S

    def _transit(self, start: Floats, stop: Floats) -> Floats | None:
        """A safe way (K, 3) from one place to another, both included."""
        both = np.stack([start, stop])
        return both if not self.ways.planning.broken(both)[0] else way(self.ways.graph, start, stop)

    def flown(self) -> Extended:
        """The path, with the passes and the transits."""
        parts = self.pieces[:1]
        for piece in self.pieces[1:]:
            parts += [self._between(parts[-1], piece), piece]
        whole = _Piece.stacked(parts)
        path = replace(whole.path, yaw=np.unwrap(whole.path.yaw))
        return Extended(path, whole.origin, whole.added, self.passes_s)

    def _between(self, before: _Piece, after: _Piece) -> _Piece:
        """The stations of a transit, without its ends, as the camera turns from one to the other."""
        ends = before.path.positions[-1], after.path.positions[0]
        line = self._transit(*ends)
        assert line is not None  # `longest` has found one
        share = arc_length(line)
        share = share / max(float(share[-1]), 1e-9)
        yaw = before.path.yaw[-1] + np.array([0.0, float(wrapped(after.path.yaw[0] - before.path.yaw[-1]))])
        pitch = np.array([before.path.pitch[-1], after.path.pitch[0]])
        poses = Flown(line, np.interp(share, [0, 1], yaw), np.interp(share, [0, 1], pitch))
        whole = _Piece(poses, np.full(len(line), before.origin[-1]), np.ones(len(line), bool))
        return _spaced(whole, self.step_m).rows(slice(1, -1))


def _spaced(piece: _Piece, step_m: float) -> _Piece:
    """The same with stations about so far apart; on a way of no length its ends alone."""
    along = arc_length(piece.path.positions)
    at = np.linspace(0, along[-1], max(int(np.ceil(along[-1] / step_m)), 1) + 1)
    poses = interpolated(at, along, piece.path.columns)
    near = np.searchsorted(along, at).clip(0, len(along) - 1)
    return _Piece(Flown(poses[:, :3], poses[:, 3], poses[:, 4]), piece.origin[near], piece.added[near])
