"""The shortest safe flight that shows what a flight left out, from viewpoints of its own plan.

Viewpoints are chosen among the poses of the plan, so that the gap is shown from as near and in the manner
that was planned: greedily, and then fewer where some are not needed. They are put in the order of a short
way, by 2-opt, and each is exchanged for another pose of the plan that shows the same where that shortens the
way. Safe legs join them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import minimum_spanning_tree

from upplied.config import RetimeSettings
from upplied.errors import RefusedError
from upplied.planning.airspace.roadmap import Roadmap, way
from upplied.planning.trajectory.retime import retime
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.path_views import TRULY, stations
from upplied.poses import from_yaw_pitch, yaw_pitch
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory, Waypoints

_STATIONS = 500  # poses of the plan, at most, that viewpoints are chosen from
_SWEEPS = 6  # of the exchange of viewpoints
_BOUND_PATCHES = 60  # samples, at most, that the bound on the length is told by
_PRICED, _COOLED = 150, 0.97  # rounds of prices, and how each is smaller than the one before
_SLOWEST_MPS, _STANDING_M = 0.3, 1e-6
_MARGIN_DEG = 4.0  # of the picture, at each rim, that a flight in wind may lose


@dataclass(frozen=True, eq=False, repr=False)
class GapFlight(Record):
    """A flight that shows what was left out."""

    trajectory: Trajectory
    is_viewpoint: Bools  # (N,)
    shows: Bools  # (S,) of the samples, those that are missing and that it shows
    unattainable: Bools  # (S,) of the samples, those that are missing and that no pose of the plan shows
    length_m: float
    bound_m: float  # no way by poses of the plan that shows the same is shorter


def gap_flight(
    plan: Trajectory,
    surface: Cloud,
    missing: Bools,
    camera: Camera,
    graph: Roadmap,
    limits: RetimeSettings,
) -> GapFlight:
    """The flight that shows the missing samples.

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

    Raises
    ------
    RefusedError
        If nothing is missing, no pose of the plan shows any of it, or no safe way joins the poses.
    """
    if not missing.any():
        raise RefusedError("the gap", "is empty: the flight showed all that was required")
    poses = stations(plan, _STATIONS)
    free = graph.airspace.allowed(poses.positions)
    poses = poses.take(free)
    part = np.flatnonzero(missing)
    assert surface.normals is not None
    cloud = Cloud(surface.points[part], surface.normals[part])
    seen = _shown(poses, cloud, camera, graph)
    can = seen.any(axis=0)
    if not can.any():
        raise RefusedError(
            "the gap", "can be seen from no pose of the plan that is safe now", "", "plan the structure again"
        )
    seen = seen[:, can]
    chosen = _order(poses.positions, _cover(seen))
    chosen = _exchanged(poses.positions, seen, chosen)
    line, at = _way(poses, chosen, graph)
    trajectory, is_viewpoint = _timed(poses, chosen, line, at, plan, limits)
    shows, unattainable = np.zeros(len(missing), bool), np.zeros(len(missing), bool)
    flown = visible(*_along(trajectory), cloud, camera, TRULY, graph.airspace.scene).seen.any(axis=0)
    shows[part], unattainable[part] = flown, ~can & ~flown
    length = float(np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1).sum())
    return GapFlight(trajectory, is_viewpoint, shows, unattainable, length, bound_m(poses.positions, seen))


def _shown(poses: Trajectory, cloud: Cloud, camera: Camera, graph: Roadmap) -> Bools:
    """Which poses (P, M) show each sample well inside the picture; at its rim what is nowhere else."""
    narrow = replace(
        camera,
        hfov_deg=max(camera.hfov_deg - 2 * _MARGIN_DEG, camera.hfov_deg / 2),
        vfov_deg=max(camera.vfov_deg - 2 * _MARGIN_DEG, camera.vfov_deg / 2),
    )
    where = (poses.positions, poses.quat_xyzw, cloud)
    well = visible(*where, narrow, TRULY, graph.airspace.scene).seen
    if not (rim := ~well.any(axis=0)).any():
        return well
    return well | (visible(*where, camera, TRULY, graph.airspace.scene).seen & rim)


def _along(trajectory: Trajectory) -> tuple[Floats, Floats]:
    asked = stations(trajectory)
    return asked.positions, asked.quat_xyzw


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


def _order(places: Floats, chosen: Ints) -> Ints:
    """The chosen poses in the order of a short open way: nearest first from an end, then 2-opt."""
    if len(chosen) < 3:
        return chosen
    gap = np.linalg.norm(places[chosen][:, None] - places[chosen][None], axis=2)
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


def _exchanged(places: Floats, seen: Bools, chosen: Ints) -> Ints:
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
                cost += np.linalg.norm(places[fit] - places[end], axis=1)
            best = int(fit[int(cost.argmin())])
            own = sum(float(np.linalg.norm(places[chosen[at]] - places[end])) for end in ends)
            if cost.min() < own - 1e-6:
                chosen[at], changed = best, True
            at += 1
        if not changed:
            break
        chosen = _order(places, chosen)
    return chosen


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
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    turning = np.interp(along, along[at], np.unwrap(yaw)), np.interp(along, along[at], pitch)
    quats = from_yaw_pitch(*turning)
    shown = np.zeros(len(line), bool)
    shown[at] = True
    steps = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1)
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
    least such way is bounded from below by trees whose nodes carry prices (Held and Karp 1970).
    """
    few = np.argsort(seen.sum(axis=0), kind="stable")
    kept: list[int] = []
    used = np.zeros(len(places), bool)
    for sample in few:
        if not (seen[:, sample] & used).any():
            kept.append(int(sample))
            used |= seen[:, sample]
        if len(kept) == _BOUND_PATCHES:
            break
    if len(kept) < 2:
        return 0.0
    gap = np.zeros((len(kept), len(kept)))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    for i, one in enumerate(kept):
        for j in range(i):
            gap[i, j] = max(apart[np.ix_(seen[:, one], seen[:, kept[j]])].min(), 1e-9)
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
