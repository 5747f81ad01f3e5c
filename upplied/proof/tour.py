"""A short safe flight by some of many poses that together see every sample, in the times of a vehicle.

Poses are inserted where they cost least for what they see, until every sample is seen. The path is shortened
by reversing stretches (2-opt), exchanging poses for others that show what they alone show, and dropping those
that are not needed. Then some are removed, at random or all about one, and replaced where that costs least;
the shorter path remains (iterated local search; Lourenco, Martin and Stuetzle 2003). The same poses give the
same path. Safe legs join them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numba import njit
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from upplied.config import RetimeSettings
from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, leg_lengths
from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.planning.airspace.roadmap import Roadmap, way
from upplied.planning.trajectory.retime import retime
from upplied.proof.bound import bound_m
from upplied.records import Bools, Floats, Ints, Record, Trajectory, Waypoints

_TRIALS = 120  # of leaving some out: beyond, ways of the sample fleet hardly became shorter
_LEFT_OUT = 6  # poses at a time, at most
_WORTH = 1.15  # times the shortest so far, up to which a trial is shortened further
_NOISE = 0.5  # on the costs by which every second trial chooses
_LITTLE_M = 1e-6
_LINKS = 20  # places of the roadmap that a pose is joined to
_SLOWEST_MPS = 0.3
STANDING_M = 1e-6  # of a leg: the vehicle stands


def short_tour(apart: Floats, seen: Bools) -> Ints:
    """Poses (K,) in the order of a short open way that together see every sample.

    Legs between poses are so long (P, P), m; which sees which sample (P, S), each is seen by one at least.
    """
    rng = np.random.default_rng(0)
    nothing, exact = np.zeros(0, np.int64), np.ones(len(apart))
    best = _better(apart, seen, _seen_again(apart, seen, nothing, exact))
    least = _length(apart, best)
    for _ in range(_TRIALS if len(best) > 1 else 0):
        count = int(rng.integers(1, max(2, min(_LEFT_OUT, len(best)))))
        if rng.random() < 0.5:  # neighbours, or any
            out = np.argsort(apart[best[int(rng.integers(len(best)))], best], kind="stable")[:count]
        else:
            out = rng.choice(len(best), count, replace=False)
        noise = rng.uniform(1, 1 + _NOISE * rng.integers(2), len(apart))
        trial = _needed(apart, seen, _seen_again(apart, seen, np.delete(best, out), noise))
        if _length(apart, trial) < _WORTH * least:
            trial = _better(apart, seen, trial)
            if _length(apart, trial) < least - _LITTLE_M:
                best, least = trial, _length(apart, trial)
    return best


def _better(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour uncrossed, exchanged and thinned out while that shortens it."""
    while True:
        before = _length(apart, tour)
        tour = _needed(apart, seen, _exchanged(apart, seen, _uncrossed(apart, tour.copy())))
        if _length(apart, tour) > before - _LITTLE_M:
            return tour


def _length(apart: Floats, tour: Ints) -> float:
    return float(apart[tour[:-1], tour[1:]].sum())


def _seen_again(apart: Floats, seen: Bools, tour: Ints, noise: Floats) -> Ints:
    """The tour with poses put in where they cost least for what they see that it does not."""
    left = ~seen[tour].any(axis=0)
    while left.any():
        gain = seen[:, left].sum(axis=1)
        new = np.flatnonzero(gain)
        cost, at = _detours(apart, tour, new)
        choice = int(((cost + _LITTLE_M) / gain[new] * noise[new]).argmin())
        tour = np.insert(tour, int(at[choice]), new[choice])
        left &= ~seen[new[choice]]
    return tour


def _detours(apart: Floats, tour: Ints, new: Ints) -> tuple[Floats, Ints]:
    """By how much each new pose (K,) lengthens a tour, m, and before which of its poses it does so least."""
    if not len(tour):
        return np.zeros(len(new)), np.zeros(len(new), np.int64)
    way = apart[np.ix_(new, tour)]
    inside = way[:, :-1] + way[:, 1:] - apart[tour[:-1], tour[1:]]
    every = np.concatenate([way[:, :1], inside, way[:, -1:]], axis=1)
    at = every.argmin(axis=1)
    return every[np.arange(len(new)), at], at


def _needed(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour without poses that alone see nothing, those first that save most."""
    while len(tour) > 1:
        once = seen[tour].sum(axis=0) == 1
        spare = np.flatnonzero(~(seen[tour] & once).any(axis=1))
        if not len(spare):
            break
        without = [_length(apart, np.delete(tour, at)) for at in spare]
        tour = np.delete(tour, spare[int(np.argmin(without))])
    return tour


def _exchanged(apart: Floats, seen: Bools, tour: Ints) -> Ints:
    """The tour with each pose exchanged for the one that shows what it alone shows on the shortest way."""
    for at in range(len(tour)):
        alone = ~seen[np.delete(tour, at)].any(axis=0)
        fit = np.flatnonzero(seen[:, alone].all(axis=1))
        ends = tour[[end for end in (at - 1, at + 1) if 0 <= end < len(tour)]]
        tour[at] = fit[apart[np.ix_(fit, ends)].sum(axis=1).argmin()]
    return tour


@njit(cache=True)
def _uncrossed(apart: Floats, tour: Ints) -> Ints:
    """The open tour with stretches turned round while that shortens it."""
    better = True
    while better:
        better = False
        for i in range(len(tour) - 1):
            for j in range(i + 1, len(tour)):
                gain = 0.0
                if i > 0:
                    gain += apart[tour[i - 1], tour[i]] - apart[tour[i - 1], tour[j]]
                if j < len(tour) - 1:
                    gain += apart[tour[j], tour[j + 1]] - apart[tour[i], tour[j + 1]]
                if gain > 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                    better = True
    return tour


@dataclass(frozen=True, eq=False, repr=False)
class Toured(Record):
    """A short safe flight by some of many poses."""

    trajectory: Trajectory
    is_viewpoint: Bools  # (N,)
    covered: Bools  # (L,) what poses see that safe legs join: all of it is seen
    length_m: float
    legs_m: Floats  # (P, P) between the poses
    seen: Bools  # (P, K) which of the poses see what is covered

    @cached_property
    def bound_m(self) -> float:
        """A length that no way by those poses and the known safe legs that sees the same is below, m."""
        return min(bound_m(self.legs_m, self.seen, self.length_m), self.length_m)


def toured(
    poses: Trajectory, seen: Bools, graph: Roadmap, plan: Trajectory, limits: RetimeSettings,
    most_mps: Callable[[Trajectory], Floats] | None = None,
) -> Toured:  # fmt: skip
    """A short safe flight by poses (P,) that together see all that poses see which safe legs join.

    Which pose sees what is (P, L); it is no faster than the plan usually is, nor than some poses may be
    passed, m/s. Refused if no safe way joins the poses.
    """
    apart = safe_lengths(graph, poses.positions)
    joined = np.isfinite(apart) & seen.any(axis=1)  # of poses that see something, as many as can be
    seen = seen & joined[joined.sum(axis=1).argmax()][:, None]
    covered = np.asarray(seen.any(axis=0), bool)
    chosen = short_tour(apart, seen[:, covered])
    line, at = _way_by(poses, chosen, graph)
    pace = None if most_mps is None else most_mps(poses.take(chosen))
    path, is_viewpoint = _timed(poses, chosen, line, at, plan, limits, pace)
    length = float(leg_lengths(path.positions).sum())
    return Toured(path, is_viewpoint, covered, length, apart, seen[:, covered])


def safe_lengths(graph: Roadmap, places: Floats) -> Floats:
    """Lengths (P, P), m, of the shortest ways by known safe legs between places; inf where there is none."""
    count, known = len(places), len(graph.places)
    near = np.zeros((count, 0), np.int64)
    if known:
        near = cKDTree(graph.places).query(places, k=min(_LINKS, known))[1].reshape(count, -1)
    first, second = np.triu_indices(count, 1)
    ends = np.concatenate([np.repeat(np.arange(count), near.shape[1]), first]) + known
    others = np.concatenate([near.ravel(), second + known])
    nodes = np.concatenate([graph.places, places])
    free = ~graph.airspace.broken_legs(nodes[ends], nodes[others])
    ends, others = np.concatenate([graph.first, ends[free]]), np.concatenate([graph.second, others[free]])
    length = np.maximum(np.linalg.norm(nodes[ends] - nodes[others], axis=1), 1e-9)
    matrix = csr_matrix((length, (ends, others)), shape=(len(nodes), len(nodes)))
    return np.asarray(dijkstra(matrix, directed=False, indices=np.arange(known, known + count))[:, known:])


def _way_by(poses: Trajectory, chosen: Ints, graph: Roadmap) -> tuple[Floats, Ints]:
    """The safe way (K, 3) by the chosen poses, and at which of its corners each of them is."""
    line, at = [poses.positions[chosen[0]][None]], [0]
    for start, goal in pairwise(chosen):
        leg = way(graph, poses.positions[start], poses.positions[goal])
        if leg is None:
            place = poses.positions[goal].round(1).tolist()
            raise RefusedError("the gap", f"has no safe leg to {place} m", "", "plan the structure again")
        line.append(leg[1:])
        at.append(at[-1] + len(leg) - 1)
    return np.concatenate(line), np.array(at, np.int64)


def _timed(
    poses: Trajectory, chosen: Ints, line: Floats, at: Ints, plan: Trajectory, limits: RetimeSettings,
    most_mps: Floats | None = None,
) -> tuple[Trajectory, Bools]:  # fmt: skip
    """Times under the vehicle's limits, no faster than the plan usually was, nor `most_mps` (K,) by each."""
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
    pace = (steps / np.diff(plan.t_s))[steps > STANDING_M]
    usual = max(float(np.median(pace)) if len(pace) else 0.0, _SLOWEST_MPS)
    pace = np.full(len(along) - 1, usual)
    if most_mps is not None:
        leg = np.clip(np.searchsorted(at, np.arange(len(pace)), side="right") - 1, 0, len(at) - 2)
        pace = np.minimum(pace, np.minimum(most_mps[leg], most_mps[leg + 1]))
    times = np.append(0.0, np.cumsum(np.diff(along) / pace)) + np.arange(len(along)) * 1e-6
    path = Waypoints(line, quats, times, shown)
    timed, is_viewpoint, *_ = retime(path, Trajectory(times, line, quats), limits)
    return timed, is_viewpoint
