"""Which moment of a plan each pose of a log corresponds to: by the clock, or by the order of the places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.polylines import interpolated
from upplied.poses import interpolate
from upplied.records import Bools, Floats, Ints, Record, Trajectory

_POSES = 600  # of each path, at most, that are compared with those of the other
_STEP_S = 0.5  # between the offsets of the clocks that are tried
_FAR_M = 5.0  # beyond which a pose says nothing more against an offset


@dataclass(frozen=True, eq=False, repr=False)
class Matched(Record):
    """A log's poses on a plan."""

    moment: Floats  # (N,) s, of the plan
    near: Bools  # (N,) whether the pose belongs to the plan
    params: Floats  # (5,) clock, s; shift x y z, m; turn, rad
    error: Floats  # (5,) one sigma of each
    middle: Floats  # (3,) m, about which it is turned


def share_near(plan: Floats, log: Floats, near_m: float) -> float:
    """Share of a log's positions (N, 3) that come near a plan's (M, 3), whenever."""
    step = np.diff(plan, axis=0)
    dense = np.concatenate([*(plan[:-1] + step * part for part in (0, 0.25, 0.5, 0.75)), plan[-1:]])
    return float(np.mean(cKDTree(dense).query(log)[0] < near_m))


def clock_offset(plan: Trajectory, log: Trajectory) -> float | None:
    """The log's time at which the plan begins, to half a second; None where the flights have no time."""
    if len(plan) < 2 or len(log) < 2:
        return None
    some = _thinned(log)
    offsets = np.arange(-plan.t_s[-1], log.t_s[-1], _STEP_S)
    costs = [_cost(plan, some, offset) for offset in offsets]
    best = float(offsets[int(np.argmin(costs))])
    fine = best + np.arange(-1, 1.01, 0.1)
    return float(fine[int(np.argmin([_cost(plan, some, offset) for offset in fine]))])


def _cost(plan: Trajectory, log: Trajectory, offset: float) -> float:
    moment = log.t_s - offset
    there = interpolated(moment, plan.t_s, plan.positions)
    gap = np.minimum(np.linalg.norm(log.positions - there, axis=1), _FAR_M)
    outside = (moment < plan.t_s[0] - _STEP_S) | (moment > plan.t_s[-1] + _STEP_S)
    return float(np.mean(np.where(outside, _FAR_M, gap)))


def matched_in_order(plan: Trajectory, log: Trajectory, near_m: float) -> Matched:
    """The match of a flight that was not flown in the times of its plan: places in the same order.

    Only the shift is estimated, from the median of what is left; there is no clock to compare.
    """
    few, there = _thinned(log), _thinned(plan)
    shift, gap = np.zeros(3), np.empty(0)
    moment = np.empty(0)
    for _ in range(3):
        moved = np.ascontiguousarray(few.positions + shift)
        pairs = _in_order(moved, np.ascontiguousarray(there.positions), _FAR_M)
        moment = np.interp(log.t_s, few.t_s, there.t_s[pairs])
        wanted = interpolate(plan, moment).positions
        gap = wanted - log.positions
        close = np.linalg.norm(gap - shift, axis=1) < near_m
        if not close.any():
            break
        shift = np.median(gap[close], axis=0)
    near = np.linalg.norm(gap - shift, axis=1) < near_m
    spread = 1.4826 * np.median(np.abs(gap[near] - shift), axis=0) if near.any() else np.full(3, np.inf)
    blocks = max(1, len(np.unique(log.t_s[near] // 10.0)))
    params = np.concatenate([[0.0], shift, [0.0]])
    error = np.concatenate([[np.inf], spread / np.sqrt(blocks), [np.inf]])
    return Matched(moment, near, params, error, log.positions.mean(axis=0))


def _thinned(path: Trajectory) -> Trajectory:
    return interpolate(path, np.linspace(path.t_s[0], path.t_s[-1], min(_POSES, 4 * len(path))))


@njit(cache=True)
def _in_order(log: Floats, plan: Floats, far_m: float) -> Ints:
    """For each log position (N, 3) the index of a plan position (M, 3), never decreasing, that is near.

    Of all such choices the one with the least sum of distances, none counted as more than `far_m`.
    """
    n, m = len(log), len(plan)
    cost, back = np.zeros(m), np.zeros((n, m), np.int32)
    for i in range(n):
        best, whence = cost[0], 0
        now = np.empty(m)
        for j in range(m):
            if cost[j] <= best:  # the last that is as good: a plan that stands still goes on
                best, whence = cost[j], j
            gap = 0.0
            for axis in range(3):
                gap += (log[i, axis] - plan[j, axis]) ** 2
            now[j] = best + min(np.sqrt(gap), far_m)
            back[i, j] = whence
        cost = now
    pairs = np.zeros(n, np.int64)
    j = int(np.argmin(cost))
    for i in range(n - 1, -1, -1):
        pairs[i] = j
        j = back[i, j]
    return pairs
