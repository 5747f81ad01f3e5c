"""A plan as a person changed it: viewpoints moved, turned or left out, boxes forbidden, more clearance.

Unchanged legs are flown as planned. Where a viewpoint was moved or left out, or a box is in the way, a safe
way joins the rest. Viewpoints too near the structure only for the larger clearance are moved just far enough.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from upplied.config import RetimeSettings
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length
from upplied.geometry.poses import fov_at, from_yaw_pitch, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, way
from upplied.planning.airspace.rules import pushed_out
from upplied.planning.trajectory.retime import retime
from upplied.records import Bools, Floats, Ints, Rows, Trajectory, Waypoints

SAME_M, _SAME_DEG = 1e-3, 0.05  # of what a file keeps of a pose: less is no change
_APART_M = 1e-6


@dataclass(frozen=True)
class Viewpoint:
    """Where a person wants a viewpoint: m, structure frame; degrees."""

    position: tuple[float, float, float]
    yaw_deg: float
    pitch_deg: float


@dataclass(frozen=True)
class Edit:
    """What a person changed, by the number of the viewpoint, from 0 in the order of flight."""

    deleted: tuple[int, ...] = ()
    changed: Mapping[int, Viewpoint] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """What was changed, in words."""
        words = [f"viewpoint {number} left out" for number in self.deleted]
        return ", ".join(words + [f"viewpoint {number} changed" for number in sorted(self.changed)])


@dataclass(frozen=True)
class AirspaceLimits:
    """What a person forbids in the airspace of a plan."""

    boxes: tuple[tuple[float, ...], ...] = ()  # of six numbers each: two corners, m, structure frame
    clearance_m: float | None = None  # more than the plan's

    @property
    def words(self) -> str:
        """The limits, in words."""
        boxes = "a box forbidden" if len(self.boxes) == 1 else f"{len(self.boxes)} boxes forbidden"
        clearance = "" if self.clearance_m is None else f"{self.clearance_m:g} m of clearance"
        return ", ".join(filter(None, (boxes if self.boxes else "", clearance)))


@dataclass(frozen=True, eq=False, repr=False)
class _Piece(Rows):
    positions: Floats  # (K, 3) m
    yaw: Floats  # (K,) rad
    pitch: Floats  # (K,) rad
    t_s: Floats  # (K,) s, of the plan
    is_viewpoint: Bools  # (K,)


def viewpoints_of(plan: Trajectory, is_viewpoint: Bools) -> list[Viewpoint]:
    """The viewpoints of a plan, in the order of flight."""
    yaw, pitch = yaw_pitch(plan.quat_xyzw[is_viewpoint])
    places = plan.positions[is_viewpoint].tolist()
    angles = zip(np.degrees(yaw).tolist(), np.degrees(pitch).tolist(), strict=True)
    return [Viewpoint((x, y, z), *turn) for (x, y, z), turn in zip(places, angles, strict=True)]


def edit_of(before: Sequence[Viewpoint], after: Mapping[int, Viewpoint]) -> Edit:
    """What differs between the viewpoints of a plan and those that a person wants, by their numbers."""
    deleted = tuple(number for number in range(len(before)) if number not in after)
    return Edit(deleted, {n: new for n, new in sorted(after.items()) if not _same(before[n], new)})


def _same(one: Viewpoint, other: Viewpoint) -> bool:
    turn = max(abs((one.yaw_deg - other.yaw_deg + 180) % 360 - 180), abs(one.pitch_deg - other.pitch_deg))
    return apart_m(one, other) < SAME_M and turn < _SAME_DEG


def apart_m(one: Viewpoint, other: Viewpoint) -> float:
    """How far two viewpoints are from each other, m."""
    return float(np.linalg.norm(np.subtract(one.position, other.position)))


def edited(
    plan: Trajectory, is_viewpoint: Bools, edit: Edit, graph: Roadmap, limits: RetimeSettings
) -> tuple[Trajectory, Bools]:
    """The plan as it was changed, with times under the limits of the vehicle; the roadmap has the new ones.

    It is refused if nothing is left, a viewpoint breaks a rule of the airspace, or no safe way joins two.
    """
    index = np.flatnonzero(is_viewpoint)
    left = [number for number in range(len(index)) if number not in edit.deleted]
    if len(left) < 2:
        raise RefusedError("the plan", f"has {len(left)} viewpoints left", "at least two")
    yaw, pitch = yaw_pitch(plan.quat_xyzw)
    whole = _Piece(plan.positions, np.unwrap(yaw), pitch, plan.t_s, np.asarray(is_viewpoint, bool))
    stops = {number: _stop(whole, int(index[number]), edit.changed.get(number)) for number in left}
    airspace = graph.airspace
    for number, stop in stops.items():
        lack = airspace.clearance_m - float(airspace.scene.distance(stop.positions)[0])
        if number not in edit.changed and lack > 0:  # as far as required; its camera looks as before
            stops[number] = stop = replace(stop, positions=pushed_out(stop.positions, airspace))
        if why := airspace.why(stop.positions[0]):
            raise RefusedError(f"viewpoint {number}", why, "", "move it, or leave it out")
    first, last = left[0], left[-1]
    parts = []
    if first == 0 and first not in edit.changed:
        parts.append(whole.rows(slice(0, int(index[first]))))
    parts.append(stops[first])
    for one, other in pairwise(left):
        parts += _between(whole, index, (one, other), stops, edit, graph)
        parts.append(stops[other])
    if last == len(index) - 1 and last not in edit.changed:
        parts.append(whole.rows(slice(int(index[last]) + 1, None)))
    whole = _joined(parts, graph)
    quats = from_yaw_pitch(whole.yaw, whole.pitch)
    path = Waypoints(whole.positions, quats, whole.t_s, whole.is_viewpoint)
    timed, flags, demonstrated_s, _ = retime(path, plan, limits)
    return replace(timed, fov_deg=fov_at(plan, demonstrated_s)), flags


def _stop(whole: _Piece, at: int, goal: Viewpoint | None) -> _Piece:
    """A viewpoint as it was, or as it is wanted; its heading turns the short way from what it was."""
    own = whole.rows(slice(at, at + 1))
    if goal is None:
        return own
    turn = np.angle(np.exp(1j * (np.radians(goal.yaw_deg) - own.yaw)))
    place, pitch = np.array([goal.position], float), np.radians([goal.pitch_deg])
    return _Piece(place, own.yaw + turn, pitch, own.t_s, own.is_viewpoint)


def _between(
    whole: _Piece, index: Ints, pair: tuple[int, int], stops: Mapping[int, _Piece], edit: Edit, graph: Roadmap
) -> list[_Piece]:
    """What is flown between two viewpoints: as it was where nothing was touched, else a safe way."""
    one, other = pair
    start, stop = int(index[one]), int(index[other])
    moved = [not np.array_equal(stops[n].positions[0], whole.positions[int(index[n])]) for n in pair]
    untouched = other == one + 1 and not any(moved) and one not in edit.changed and other not in edit.changed
    if untouched and not graph.airspace.broken(whole.positions[start : stop + 1]).any():
        return [whole.rows(slice(start + 1, stop))]
    a, b = stops[one], stops[other]
    line = way(graph, a.positions[0], b.positions[0])
    if line is None:
        fault = f"has no safe leg from viewpoint {one}"
        raise RefusedError(f"viewpoint {other}", fault, "", "move one of them")
    along = arc_length(line)
    share = (along / max(along[-1], _APART_M))[1:-1]
    ends = (a.yaw, b.yaw), (a.pitch, b.pitch), (a.t_s, b.t_s)
    yaw, pitch, t_s = (start + share * (end - start) for start, end in ends)
    return [_Piece(line[1:-1], yaw, pitch, t_s, np.zeros(len(share), bool))]


def _joined(parts: list[_Piece], graph: Roadmap) -> _Piece:
    """All pieces in order; before the first viewpoint and after the last nothing forbidden is flown."""
    for end, outer in ((0, slice(2)), (-1, slice(-2, None))):
        while not parts[end].is_viewpoint.any():
            if not graph.airspace.broken(np.concatenate([part.positions for part in parts[outer]])).any():
                break
            del parts[end]
    return _Piece.stacked(parts)
