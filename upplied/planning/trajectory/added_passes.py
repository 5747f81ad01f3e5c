"""Passes that are added where the demonstrated ones cannot show all as finely as the expert did.

A larger target is flown round from as near as the source, so the passes leave strips between and beside them.
An added pass is a stretch of the carried flight flown beside itself, along such a strip, in the expert's
direction or back, and optimised for what is missed near it. It is as long as pays: the surface that it
shows is weighed against its time, at a share of the rate at which the expert showed it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from upplied.config import Settings
from upplied.errors import RefusedError
from upplied.planning.airspace.detours import Ways, airspace_of
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.carried import Carried, Goal
from upplied.planning.carry.standoff import Standoff
from upplied.planning.constants import LEAST_PART
from upplied.planning.demonstration.repetition import Take, steady_radps
from upplied.planning.trajectory.complete import completed, view_of
from upplied.planning.trajectory.retime import demonstrated_speed
from upplied.planning.trajectory.view import View
from upplied.planning.visibility.pictures import FLAT_DEG
from upplied.polylines import chosen_evenly, cumulated, leg_lengths
from upplied.poses import fov_at, optical_axis
from upplied.records import Bools, Floats, Ints, Record, Trajectory, Visibility, Waypoints

_POSES = 240  # of the path, and of each pass, that are asked what they show
_MOST = 6  # passes
_FEWEST = 4  # stations of a pass, that it is a curve
_SAMPLES, _ROUNDS = 800, 2  # of the optimisation of a pass: it is short, and shows a strip
_LITTLE = 1e-2  # of what a station must show: how much the flight itself counts where nothing is missed


@dataclass(frozen=True, eq=False, repr=False)
class _Pass(Record):
    """A stretch of the carried flight, flown beside it."""

    station: Ints  # (K,) of the flight, in the order in which the pass is flown
    positions: Floats  # (K, 3) m
    time_s: Floats  # (K,) as fast as the expert flew there, and no faster than the camera may turn

    def cut(self, within: slice) -> _Pass:
        """A stretch of it, or all of it backwards."""
        return _Pass(self.station[within], self.positions[within], self.time_s[within])


@dataclass(frozen=True, eq=False, repr=False)
class _Missed(Record):
    """What no pass shows yet, and what a second is worth."""

    sample: Ints  # (m,) of the view
    left: Floats  # (m,) share of all that is inspected; 0: shown
    price: float  # of a second: the share that it must show
    speed_mps: Floats  # (M,) at which the expert flew each station
    picture_m: float  # its smaller side on the surface, from the usual stand-off
    time_s: Floats  # (M,) least time to turn the camera as the flight does, up to each station

    @property
    def some(self) -> Ints:
        """The rows of what is missed."""
        return np.flatnonzero(self.left > 0)


def with_added(carried: Carried, path: Waypoints, settings: Settings) -> list[tuple[Carried, Waypoints]]:
    """The passes to be added to a completed path, in the order of flight, each with its completed path.

    Parameters
    ----------
    carried : Carried
    path : Waypoints
        The carried flight, completed.
    settings : Settings

    Returns
    -------
    list of (Carried, Waypoints)
        Each a take of a stretch of the flight, its need what is missed; empty where the path shows 99 %, or
        no pass shows enough for its time.
    """
    goal, take = carried.goal, carried.take
    if goal is None or not goal.inspected.projected or goal.height_m is not None or len(path) < _FEWEST:
        return []
    view = view_of(take, goal, settings)
    airspace = Ways(airspace_of(take.pair, settings), take.pair.obstacle).planning
    missed = _missed(carried, path, view, goal.standoff.usual_m, settings)
    few = replace(settings, optimise=replace(settings.optimise, samples=_SAMPLES, rounds=_ROUNDS))
    ends, passes = [path.positions[-1]], list[tuple[Carried, Waypoints]]()
    while len(passes) < _MOST and float(missed.left.sum()) > LEAST_PART:
        for one in _candidates(carried, view, airspace, missed, ends):
            added = _taken(carried, one, view, missed.sample[missed.some])
            if (flown := _flown(added, view, missed, ends, few)) is not None:
                break
        else:
            break
        passes.append((added, flown))
        shown = _shown(view, added.take, flown, missed.sample)
        missed = replace(missed, left=np.where(shown, 0.0, missed.left))
        ends += [flown.positions[0], flown.positions[-1]]
    return passes


def _flown(
    added: Carried, view: View, missed: _Missed, ends: Sequence[Floats], settings: Settings
) -> Waypoints | None:
    """An added pass completed, from where to where it pays; None where it does not, or is not safe."""
    goal, flight = added.goal, added.take.inspection.flight
    assert goal is not None
    try:
        path = completed(added, goal, settings, float(missed.left.sum()))
    except RefusedError:
        return None
    shown = np.flatnonzero(_shown(view, added.take, path, missed.sample) & (missed.left > 0))
    at = cKDTree(_aims(path, goal)).query(view.cloud.points[missed.sample[shown]])[1]
    dense = _evened(np.bincount(at, missed.left[shown], len(path)), path, missed.picture_m / 4)
    speed = demonstrated_speed(path.t_s, flight)
    time_s = cumulated(2 * leg_lengths(path.positions) / (speed[1:] + speed[:-1]))
    within = _paying(dense, time_s, missed.price)
    flown, spent = path.rows(within), float(np.ptp(time_s[within]))
    seconds = spent + _way_s(flown.positions, ends, view).min()
    return flown if len(flown) >= _FEWEST and dense[within].sum() > missed.price * seconds else None


def _way_s(positions: Floats, ends: Sequence[Floats], view: View) -> Floats:
    """How long the way to each end of a pass is (2,), s, from the nearest end of what is flown anyway."""
    return np.asarray(cKDTree(ends).query(positions[[0, -1]])[0] / view.limits.transit_speed_mps)


def _missed(carried: Carried, path: Waypoints, view: View, usual_m: float, settings: Settings) -> _Missed:
    """What a completed path leaves, and the expert's pace."""
    take, flight = carried.take, carried.take.inspection.flight
    asked = np.flatnonzero(view.inspected & (view.need > 0))
    left = view.need[asked] / max(float(view.need[asked].sum()), 1e-12)
    left[_shown(view, take, path, asked)] = 0.0
    axis = optical_axis(carried.path.quat_xyzw)
    turned = np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1.0, 1.0))
    pan = min(np.radians(settings.retime.max_yaw_rate_degps), steady_radps([take], settings.inspection))
    return _Missed(
        sample=asked,
        left=left,
        price=settings.refine.least_rate
        / (max(float(np.ptp(flight.t_s)), 1e-9) * max(carried.area_ratio, 1.0)),
        speed_mps=demonstrated_speed(flight.t_s, flight, take.inspection.breaks),
        picture_m=2
        * usual_m
        * float(np.tan(np.radians(min(view.camera.hfov_deg, view.camera.vfov_deg, FLAT_DEG)) / 2)),
        time_s=cumulated(turned / pan),
    )


def _shown(view: View, take: Take, path: Waypoints, asked: Ints) -> Bools:
    """Which of the samples a path shows, that is completed."""
    few = path.rows(chosen_evenly(len(path), _POSES))
    zoomed = replace(view, fov_deg=fov_at(take.inspection.flight, few.t_s))
    return zoomed.shown(few.positions, few.quat_xyzw, asked)


def _candidates(
    carried: Carried, view: View, airspace: Airspace, missed: _Missed, ends: Sequence[Floats]
) -> list[_Pass]:
    """Passes that may pay, from their nearer ends, the one that pays most as it is before the others."""
    found, some = [], missed.some
    for one in _beside(carried, view, missed):
        free = np.flatnonzero(airspace.allowed(one.positions))
        if len(one.station) < _FEWEST or len(free) < len(one.station) / 2:
            continue
        few = free[chosen_evenly(len(free), _POSES)]
        quats = carried.path.quat_xyzw[one.station[few]]
        at = view if view.fov_deg is None else replace(view, fov_deg=view.fov_deg[one.station[few]])
        shows = at.shown(one.positions[few], quats, missed.sample[some])
        ahead = _way_s(one.positions, ends, view)
        seconds = float(np.ptp(one.time_s)) + float(ahead.min())
        shown, price = float(missed.left[some[shows]].sum()), missed.price * seconds
        if shown > price / 2:  # optimised it may show twice as much
            found.append((price - shown, one if ahead[0] <= ahead[1] else one.cut(slice(None, None, -1))))
    return [one for _, one in sorted(found, key=lambda each: each[0])]


def _beside(carried: Carried, view: View, missed: _Missed) -> Iterator[_Pass]:
    """Stretches of the flight beside what is missed: for all of it, and for what lies to each side."""
    path, goal, left = carried.path, carried.goal, missed.left[missed.some]
    assert goal is not None
    points, aims = view.cloud.points[missed.sample[missed.some]], _aims(path, goal)
    at = cKDTree(aims).query(points)[1]
    across = np.cross(optical_axis(path.quat_xyzw), np.gradient(path.positions, axis=0))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    side = np.einsum("kj,kj->k", points - aims[at], across[at])
    rightly = np.clip(0.5 + 2 * side / missed.picture_m, 0.0, 1.0)
    little = _LITTLE * missed.price * float(np.ptp(carried.take.inspection.flight.t_s)) / len(path)
    speed = (missed.speed_mps[1:] + missed.speed_mps[:-1]) / 2
    for share in (rightly, 1 - rightly, np.ones(len(left))):
        mass, moment = (np.bincount(at, share * left * of, len(path)) for of in (1.0, side))
        off = _evened(moment, path, 3 * missed.picture_m) / (
            _evened(mass, path, 3 * missed.picture_m) + little
        )
        positions = path.positions + off[:, None] * across
        time_s = cumulated(np.maximum(leg_lengths(positions) / speed, np.diff(missed.time_s)))
        within = _paying(_evened(mass, path, missed.picture_m / 4), time_s, missed.price)
        yield _Pass(np.arange(len(path)), positions, time_s).cut(within)


def _aims(path: Waypoints, goal: Goal) -> Floats:
    """What is in the middle of each picture, (M, 3), m, about."""
    return path.positions + goal.standoff.usual_m * optical_axis(path.quat_xyzw)


def _evened(values: Floats | Ints, path: Waypoints, over_m: float) -> Floats:
    """Values (M,) averaged along a path."""
    apart = max(float(leg_lengths(path.positions).mean()), 1e-9)
    return np.asarray(gaussian_filter1d(values, max(over_m / apart, 1.0), mode="constant"))


def _paying(shown: Floats, time_s: Floats, price: float) -> slice:
    """The stretch of K stations that shows most beyond the price of its time."""
    whole = cumulated(shown)  # before each station, and behind the last
    before, behind = whole[:-1] - price * time_s, whole[1:] - price * time_s
    last = int(np.argmax(behind - np.minimum.accumulate(before)))
    return slice(int(np.argmin(before[: last + 1])), last + 1)


def _taken(carried: Carried, one: _Pass, view: View, missed: Ints) -> Carried:
    """An added pass as a take of its stretch, that is to show what is missed."""
    take, goal, station = carried.take, carried.goal, one.station
    assert goal is not None
    inspection, path = take.inspection, carried.path.rows(station)
    flight = inspection.flight.take(station)
    since_s = np.abs(flight.t_s - flight.t_s[0])  # a stretch that is flown back takes as long
    need = np.zeros(len(goal.inspected.need))
    need[missed] = goal.inspected.need[missed]
    sub = replace(
        inspection,
        flight=Trajectory(since_s, flight.positions, flight.quat_xyzw, flight.fov_deg),
        visibility=Visibility(inspection.visibility.seen[station]),
        breaks=np.empty(0, np.int64),
    )
    usual = goal.standoff.usual_m
    aim = one.positions + usual * optical_axis(path.quat_xyzw)
    asked = replace(
        goal,
        inspected=replace(goal.inspected, need=need, without=0.0),
        seen=np.zeros(len(need)),
        flown=one.positions,
        standoff=Standoff(np.arange(len(station)), aim[:, None], np.full(len(station), usual)),
        reference=one.positions,
    )
    moved = replace(path, positions=one.positions, t_s=since_s)
    return Carried(replace(take, inspection=sub), moved, asked)
