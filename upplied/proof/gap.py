"""The shortest safe flight that shows what a flight left out, from viewpoints of its own plan.

Viewpoints are chosen among the poses of the plan, so that the gap is shown from as near and in the manner
that was planned, and put in the order of a short way (`tour`). Safe legs join them. Zone surface that those
poses do not show as it is asked for has poses of its own (`zone_gap`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree

from upplied.config import RetimeSettings
from upplied.errors import RefusedError
from upplied.planning.airspace.roadmap import Roadmap, way
from upplied.planning.trajectory.retime import retime
from upplied.planning.visibility.path_views import stations
from upplied.polylines import arc_length, leg_lengths
from upplied.poses import from_yaw_pitch, yaw_pitch
from upplied.proof.tour import short_tour
from upplied.proof.zone_gap import Part, ZoneGap, joined, poses_for
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory, Waypoints

_STATIONS = 500  # poses of the plan, at most, that viewpoints are chosen from
_BOUND_PATCHES = 60  # samples, at most, that the bound on the length is told by
_BOUND_CHOICES = 12  # that are tried: 25 times as many raised it by 4 % at most, of ways of 2 m by a fourth
_SHUFFLED = 0.6  # how far their order departs from fewest first
_PRICED, _COOLED = 150, 0.97  # rounds of prices, and how each is smaller than the one before
_SLOWEST_MPS, _STANDING_M = 0.3, 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class GapFlight(Record):
    """A flight that shows what was left out."""

    trajectory: Trajectory
    is_viewpoint: Bools  # (N,)
    shows: Bools  # (S,) of the samples, those that are missing and that it shows
    unattainable: Bools  # (S,) of the samples, those that are missing and that no pose of the plan shows
    length_m: float
    bound_m: float  # no way by the poses it was chosen from that shows the same is shorter
    zones: tuple[tuple[Bools, Bools], ...] = ()  # (M,) of each zone's samples: shown, and unattainable


def gap_flight(
    plan: Trajectory,
    surface: Cloud,
    missing: Bools,
    camera: Camera,
    graph: Roadmap,
    limits: RetimeSettings,
    zones: Sequence[ZoneGap] = (),
) -> GapFlight:
    """The flight that shows the missing samples, and what is missing of zones.

    Parameters
    ----------
    plan : Trajectory
        That was to show them.
    surface : Cloud
        S samples with normals.
    missing : array of bool, shape (S,)
    camera : Camera
    graph : Roadmap
        Of the structure, with the plan's clearance.
    limits : RetimeSettings
        Of the vehicle.
    zones : sequence of ZoneGap
        What no flight shows of zones as they ask for it, whether the plan shows it or not.

    Raises
    ------
    RefusedError
        If nothing is missing, no safe pose shows any of it, or no safe way joins the poses.
    """
    if not missing.any() and not zones:
        raise RefusedError("the gap", "is empty: the flight showed all that was required")
    poses = stations(plan, _STATIONS)
    free = graph.airspace.allowed(poses.positions)
    poses = poses.take(free)
    part = np.flatnonzero(missing)
    parts = [Part(Cloud(surface.points[part], surface.outward[part]), camera)]
    parts += [zone.part(camera) for zone in zones]
    usual_m = float(np.median(graph.airspace.scene.distance(poses.positions))) if zones and len(poses) else 0
    shown = parts[0].well(poses, graph)
    for one in parts[1:]:
        poses = joined(poses, poses_for(one, poses, graph, limits, usual_m))
    others = np.zeros((len(poses) - len(shown), len(part)), bool)  # what was planned is shown as planned
    seen = np.concatenate(
        [np.vstack([shown, others]), *(one.well(poses, graph) for one in parts[1:])], axis=1
    )
    can = seen.any(axis=0)
    if not can.any():
        raise RefusedError(
            "the gap",
            "can be seen from no pose that is safe now" + "".join(f"; {_none_of(zone)}" for zone in zones),
            "",
            "plan the structure again, or ask less of the zone" if zones else "plan the structure again",
        )
    seen = seen[:, can]
    chosen = short_tour(poses.positions, seen)
    line, at = _way(poses, chosen, graph)
    trajectory, is_viewpoint = _timed(poses, chosen, line, at, plan, limits)
    shows, unattainable = np.zeros(len(missing), bool), np.zeros(len(missing), bool)
    along = stations(trajectory)
    flown = [np.asarray(one.seen(along, graph).any(axis=0), bool) for one in parts]
    cannot = np.split(~can, np.cumsum([len(one.cloud) for one in parts])[:-1])
    both = [(done, none & ~done) for done, none in zip(flown, cannot, strict=True)]
    shows[part], unattainable[part] = both[0]
    length = float(leg_lengths(trajectory.positions).sum())
    shortest = bound_m(poses.positions, seen)
    return GapFlight(trajectory, is_viewpoint, shows, unattainable, length, shortest, tuple(both[1:]))


def _none_of(zone: ZoneGap) -> str:
    return f"{square_metres(zone.cloud, np.ones(len(zone.cloud), bool)):.1f} m2 of zone {zone.zone}"


def square_metres(cloud: Cloud, part: Bools) -> float:
    """Area of some samples of a cloud, m2."""
    return float(cloud.areas[part].sum())


def _way(poses: Trajectory, chosen: Ints, graph: Roadmap) -> tuple[Floats, Ints]:
    """The safe way (K, 3) by the chosen poses, and at which of its corners each of them is."""
    line, at = [poses.positions[chosen[0]][None]], [0]
    for start, goal in pairwise(chosen):
        leg = way(graph, poses.positions[start], poses.positions[goal])
        if leg is None:
            place = poses.positions[goal].round(1).tolist()
            raise RefusedError("the gap", f"has no safe way to {place} m", "", "plan the structure again")
        line.append(leg[1:])
        at.append(at[-1] + len(leg) - 1)
    return np.concatenate(line), np.array(at, np.int64)


def _timed(
    poses: Trajectory, chosen: Ints, line: Floats, at: Ints, plan: Trajectory, limits: RetimeSettings
) -> tuple[Trajectory, Bools]:
    """Times under the vehicle's limits, no faster than the plan usually was; cameras turn on the way."""
    if len(line) == 1:  # one look: to hover for a second is enough
        once = np.repeat(line, 2, axis=0), poses.quat_xyzw[chosen[[0, 0]]]
        return Trajectory(np.array([0.0, 1.0]), *once), np.array([True, True])
    yaw, pitch = yaw_pitch(poses.quat_xyzw[chosen])
    along = arc_length(line)
    turning = np.interp(along, along[at], np.unwrap(yaw)), np.interp(along, along[at], pitch)
    quats = from_yaw_pitch(*turning)
    shown = np.zeros(len(line), bool)
    shown[at] = True
    steps = leg_lengths(plan.positions)
    pace = (steps / np.diff(plan.t_s))[steps > _STANDING_M]
    usual = max(float(np.median(pace)) if len(pace) else 0.0, _SLOWEST_MPS)
    times = along / usual + np.arange(len(along)) * 1e-6
    path = Waypoints(line, quats, times, shown)
    timed, is_viewpoint, _ = retime(path, Trajectory(times, line, quats), limits)
    return timed, is_viewpoint


def bound_m(places: Floats, seen: Bools) -> float:
    """A length, m, below which no way by some of these poses shows every sample.

    Of samples whose poses have none in common, each must be seen from a place of its own. A way through them
    joins them one after the other, each leg no shorter than the gap between any two of their places; the
    least such way is bounded from below by trees whose nodes carry prices (Held and Karp 1970). Several such
    choices of samples are tried, since each gives a bound.
    """
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    rng = np.random.default_rng(0)
    few = seen.sum(axis=0)
    best = 0.0
    for choice in range(_BOUND_CHOICES):
        order = np.argsort(few * (1 + _SHUFFLED * (choice > 0) * rng.random(len(few))), kind="stable")
        best = max(best, _bound_by(apart, seen, order))
    return best


def _bound_by(apart: Floats, seen: Bools, order: Ints) -> float:
    """The bound by samples without a pose in common, chosen in an order."""
    kept: list[int] = []
    used = np.zeros(len(apart), bool)
    for sample in order:
        if not (seen[:, sample] & used).any():
            kept.append(int(sample))
            used |= seen[:, sample]
        if len(kept) == _BOUND_PATCHES:
            break
    if len(kept) < 2:
        return 0.0
    gap = np.zeros((len(kept), len(kept)))
    for i, one in enumerate(kept):
        nearest = apart[seen[:, one]].min(axis=0)
        for j in range(i):
            gap[i, j] = max(nearest[seen[:, kept[j]]].min(), 1e-9)
    return _least_way(gap + gap.T)


def _least_way(gap: Floats) -> float:
    """A lower bound of the open ways by all nodes with these distances (K, K).

    With a price on each node, a way costs its length and each price as often as it has neighbours there:
    twice, but once at both ends. So the least tree with prices, less all of them twice, plus the two
    smallest, bounds it.
    """
    count, best = len(gap), 0.0
    price = np.zeros(count)
    step = float(gap.max()) / count
    for _ in range(_PRICED):
        costs = gap + price[:, None] + price[None]
        shift = 1.0 - float(costs.min())  # the library takes no cost for no edge
        tree = minimum_spanning_tree(np.triu(costs + shift, 1)).tocoo()
        length = float(tree.data.sum()) - (count - 1) * shift
        best = max(best, length - 2 * float(price.sum()) + float(np.sort(price)[:2].sum()))
        neighbours = np.bincount(np.concatenate([tree.row, tree.col]), minlength=count)
        price = price + step * (neighbours - 2)
        step *= _COOLED
    return best
