"""Passes that are added where the demonstrated ones cannot show all as finely as the expert did.

A larger target is flown round from as near as the source, so the passes leave strips between and beside them.
An added pass is a stretch of the carried flight moved along the surface onto such a strip: in the expert's
direction or back, as near as the resolution asks, looking from his side as far as the strip allows. The one
that shows most per second of its time comes first, and each is made safe, optimised and timed as a take.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.carried import Carried
from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.view import View
from upplied.polylines import chosen_evenly, leg_lengths
from upplied.poses import from_yaw_pitch, optical_axis
from upplied.records import Bools, Floats, Ints, Record, Trajectory, Visibility, Waypoints

_SAMPLES = 1000  # of what is to be shown, at most, that stand for all while passes are chosen
_POSES = 240  # of the path, and of each pass, that are asked what they show
_GAIN = 0.01  # share of the need that a pass must show, so that none hangs on a sample or two
_TIME = 1.25  # times the demonstrated time and the ratio of the inspected areas: all passes together
_MOST = 6  # passes
_STRIP = 0.35  # stand-offs, over which it is counted what is missed, and over which a pass is evened out
_PARALLEL = 3.0  # stand-offs, over which a pass beside the flight keeps its distance from it
_WITHIN = 0.85  # of the farthest from which the strip is shown finely enough: where the pass is flown
_FARTHEST = 1.5  # stand-offs of the demonstration, beyond which no pass is flown
_PART = 0.25  # of its stretch's time, that a pass takes at least: it turns with the camera as the stretch did
_LEANING = (0.0, 0.5)  # of the expert's line of sight, added to the strip's normal
_SPARSE = 0.2  # of the densest missed stretch: less is no part of a pass


@dataclass(frozen=True, eq=False, repr=False)
class _Pass(Record):
    """A stretch of the carried flight, moved."""

    station: Ints  # (K,) of the flight, in the order in which the pass is flown
    positions: Floats  # (K, 3) m
    aim: Floats  # (K, 3) m
    seconds: float


def with_added(carried: Carried, path: Waypoints, view: View, airspace: Airspace) -> list[Carried]:
    """The passes to be added to a completed path, in the order of flight.

    Parameters
    ----------
    carried : Carried
    path : Waypoints
        The carried flight, completed.
    view : View
        What it is to show.
    airspace : Airspace
        Whose rules the passes keep.

    Returns
    -------
    list of Carried
        Each a take of a stretch of the flight, its need what none before it shows; empty where all but a
        hundredth of what is to be shown is shown.
    """
    goal = carried.goal
    if goal is None or goal.height_m is not None or goal.standoff.usual_m <= 0:
        return []
    asked = np.flatnonzero(view.inspected & (view.need > 0))[:_SAMPLES]
    left = np.array(view.need[asked])
    if not left.sum() > 0:
        return []
    left /= left.sum()
    seen = chosen_evenly(len(path), _POSES)
    left[view.shown(path.positions[seen], path.quat_xyzw[seen], asked)] = 0.0
    end, passes = path.positions[-1], list[tuple[_Pass, Bools]]()
    time_left = _time_left(carried, path)
    while len(passes) < _MOST and left.sum() >= _GAIN:
        best = _best(carried, view, airspace, asked, left, end, time_left)
        if best is None:
            break
        chosen, shows = best
        time_left -= chosen.seconds
        passes.append((chosen, shows & (left > 0)))
        left[shows] = 0.0
        end = chosen.positions[-1]
    return [_taken(carried, one, view, asked[shows]) for one, shows in passes]


def time_allowed_s(carried: Carried) -> float:
    """How long a plan may take with added passes: more than demonstrated where there is more to show."""
    return float(np.ptp(carried.take.inspection.flight.t_s)) * _TIME * max(carried.area_ratio, 1.0)


def _time_left(carried: Carried, path: Waypoints) -> float:
    """Seconds of those that a path leaves, flown as fast as the demonstration, no shorter than it."""
    flight = carried.take.inspection.flight
    longer = float(leg_lengths(path.positions).sum() / max(leg_lengths(flight.positions).sum(), 1e-9))
    return time_allowed_s(carried) - float(np.ptp(flight.t_s)) * max(longer, 1.0)


def _best(
    carried: Carried,
    view: View,
    airspace: Airspace,
    asked: Ints,
    left: Floats,
    end: Floats,
    time_left: float,
) -> tuple[_Pass, Bools] | None:
    """The pass that shows most of what is left per second, and which samples it shows; None for none."""
    best, worth = None, 0.0
    missed = left > 0
    for one in _candidates(carried, view, asked[missed], left[missed]):
        free = airspace.allowed(one.positions)
        if free.mean() < 0.5:
            continue
        ahead = np.linalg.norm(one.positions[[0, -1]] - end, axis=1)
        if ahead[1] < ahead[0]:
            one = _Pass(one.station[::-1], one.positions[::-1], one.aim[::-1], one.seconds)
        some = np.flatnonzero(free)[chosen_evenly(int(free.sum()), _POSES)]
        shows = np.zeros(len(asked), bool)
        quats = _looking(one.aim[some] - one.positions[some], view)
        shows[missed] = _at(view, one.station[some]).shown(one.positions[some], quats, asked[missed])
        gain = float(left[shows].sum())
        seconds = one.seconds + float(ahead.min()) / view.limits.transit_speed_mps
        if gain >= _GAIN and seconds <= time_left and gain / seconds > worth:
            best, worth = (replace(one, seconds=seconds), shows), gain / seconds
    return best


def _candidates(carried: Carried, view: View, missed: Ints, left: Floats) -> Iterator[_Pass]:
    """Stretches of the flight moved onto what is missed (K,): all of it, and what lies to each side."""
    path, goal = carried.path, carried.goal
    assert goal is not None
    usual = goal.standoff.usual_m
    points, normals = view.cloud.points[missed], view.cloud.outward[missed]
    axis = optical_axis(path.quat_xyzw)
    aims = path.positions + usual * axis
    at = cKDTree(aims).query(points)[1]
    forward = np.gradient(path.positions, axis=0) if len(path) > 1 else np.zeros_like(axis)
    across = np.cross(axis, forward)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    side = np.einsum("kj,kj->k", points - aims[at], across[at])
    sigma = _STRIP * usual / max(float(leg_lengths(path.positions).mean()) if len(path) > 1 else usual, 1e-6)
    farthest = np.minimum(view.farthest_m[missed], _FARTHEST * usual)
    for group in (side >= 0, side < 0, np.ones(len(missed), bool)):
        if left[group].sum() < _GAIN:
            continue
        columns = np.column_stack([points, normals, farthest])[group] * left[group, None]
        sums = np.zeros((len(path), 8))
        np.add.at(sums, at[group], np.column_stack([columns, left[group]]))
        sums = gaussian_filter1d(sums, max(sigma, 1.0), axis=0, mode="constant")
        dense = np.flatnonzero(sums[:, 7] > _SPARSE * sums[:, 7].max())
        runs = np.split(dense, np.flatnonzero(np.diff(dense) > max(2 * sigma, 2)) + 1)
        spans = {(int(run[0]), int(run[-1])) for run in [*runs, dense]}
        for (first, last), leaning in itertools.product(sorted(spans), _LEANING):
            if last - first < 3:
                first, last = max(first - 2, 0), min(last + 2, len(path) - 1)
            yield _moved(carried, sums, first, last, -leaning * axis, view)
        off = np.zeros((len(path), 2))
        np.add.at(off, at[group], np.column_stack([side[group] * left[group], left[group]]))
        off = gaussian_filter1d(off, max(_PARALLEL / _STRIP * sigma, 1.0), axis=0, mode="constant")
        beside = path.positions + (off[:, :1] / np.maximum(off[:, 1:], 1e-12)) * across
        for first, last in sorted(spans):
            within = slice(first, last + 1)
            yield _Pass(
                np.arange(first, last + 1),
                beside[within],
                beside[within] + usual * axis[within],
                _seconds(carried, within, beside[within]),
            )


def _moved(carried: Carried, sums: Floats, first: int, last: int, lean: Floats, view: View) -> _Pass:
    """A stretch over the strip whose weighted sums (M, 8) along the flight are given."""
    within = slice(first, last + 1)
    own = sums[within]
    dense = own[:, 7] > 1e-9
    index, known = np.arange(len(own)), np.flatnonzero(dense)
    mean = own[known] / own[known, 7:]
    strip = np.column_stack([np.interp(index, known, column) for column in mean.T])
    away = strip[:, 3:6] / np.maximum(np.linalg.norm(strip[:, 3:6], axis=1, keepdims=True), 1e-9)
    away = away + lean[within]
    away = -optical_axis(_looking(-away, view))
    positions = strip[:, :3] + _WITHIN * strip[:, 6:7] * away
    seconds = _seconds(carried, within, positions)
    return _Pass(np.arange(first, last + 1), positions, strip[:, :3], seconds)


def _seconds(carried: Carried, within: slice, positions: Floats) -> float:
    """How long a pass over a stretch of the flight takes, as fast as the expert flew it."""
    flight = carried.take.inspection.flight.take(within)
    spent, flown = float(np.ptp(flight.t_s)), float(leg_lengths(flight.positions).sum())
    return spent * max(float(leg_lengths(positions).sum()) / max(flown, 1e-6), _PART)


def _looking(towards: Floats, view: View) -> Floats:
    """Cameras (K, 4) that look along these ways as far as the gimbal allows."""
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    yaw = np.unwrap(np.arctan2(towards[:, 1], towards[:, 0]))
    pitch = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    return from_yaw_pitch(yaw, np.clip(pitch, low, high))


def _at(view: View, station: Ints) -> View:
    """The view of some stations alone: each with its zoom."""
    return view if view.fov_deg is None else replace(view, fov_deg=view.fov_deg[station])


def _taken(carried: Carried, one: _Pass, view: View, shows: Ints) -> Carried:
    """An added pass as a take of its stretch, that is to show some samples and those round them."""
    take, goal = carried.take, carried.goal
    assert goal is not None
    inspection, path, station = take.inspection, carried.path, one.station
    flight = inspection.flight.take(station)
    since_s = np.abs(flight.t_s - flight.t_s[0])  # a stretch that is flown back takes as long
    flight = Trajectory(since_s, flight.positions, flight.quat_xyzw, flight.fov_deg)
    pose = _looking(one.aim - one.positions, view)
    moved = Waypoints(one.positions, pose, since_s, path.is_viewpoint[station])
    near = cKDTree(view.cloud.points[shows]).query(view.cloud.points)[0] <= np.sqrt(
        view.cloud.areas[shows].sum() / max(len(shows), 1)
    )
    need = np.where(near, goal.inspected.need, 0.0)
    sub = replace(
        inspection,
        flight=flight,
        visibility=Visibility(inspection.visibility.seen[station]),
        breaks=np.empty(0, np.int64),
    )
    standoff = np.linalg.norm(one.aim - one.positions, axis=1)
    asked = replace(
        goal,
        inspected=replace(goal.inspected, need=need, without=0.0),
        seen=np.zeros(len(need)),
        flown=one.positions,
        standoff=Standoff(np.arange(len(flight)), one.aim[:, None], np.maximum(standoff, 1e-3)),
        reference=one.positions,
    )
    return Carried(replace(take, inspection=sub), moved, asked)
