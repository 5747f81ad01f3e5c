"""The moment of a plan that each pose of a log corresponds to, at any pace, with pauses and in any order.

First in coarse steps: of all ways to follow the plan, forwards or backwards, the one whose positions and
directions are nearest, where 0.8 to 1.25 times the plan's pace costs nothing, pauses and haste a little, and
jumps and reversals much (a shortest path; Viterbi 1967). Then the nearest place of the plan at that time.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from upplied.geometry.poses import interpolate, optical_axis
from upplied.records import Bools, Floats, Ints, Record, Trajectory

SLOWEST, FASTEST = 0.8, 1.25  # of the plan's pace, that cost nothing
_POSES = 600  # of each path, at most, that are compared with those of the other
_STEP_S = 0.25  # between them, at least
_FAR_M = 6.0  # beyond which a pose says nothing more against a moment
_ASIDE_M = 1.5  # what a look to the opposite side costs
_PAUSE_M, _HASTE_M, _ELSEWHERE_M = 0.1, 0.1, 12.0  # a step of standing, a step too many, going on elsewhere


@dataclass(frozen=True, eq=False, repr=False)
class Matched(Record):
    """A log's poses on a plan."""

    moment: Floats  # (N,) s, of the plan
    place: Floats  # (N, 3) m, of the plan at that moment
    backwards: Bools  # (N,) whether the plan was flown against its order then


def matched(plan: Trajectory, log: Trajectory, silent_s: float) -> Matched:
    """The log's poses on a plan, both in one frame, to a few metres.

    A step of the log that is longer than `silent_s` leaves open what was flown meanwhile.
    """
    span, planned = float(log.t_s[-1] - log.t_s[0]), float(plan.t_s[-1] - plan.t_s[0])
    beat = max(span / _POSES, _STEP_S)
    few = np.unique(np.searchsorted(log.t_s, np.arange(log.t_s[0], log.t_s[-1], beat)))
    moments = np.linspace(plan.t_s[0], plan.t_s[-1], int(np.clip(planned / _STEP_S, 2, _POSES)))
    there = interpolate(plan, moments)
    coarse = log.take(few)
    paces = np.diff(coarse.t_s)
    ways = [np.ascontiguousarray(each) for each in (coarse.positions, there.positions)]
    looks = [np.ascontiguousarray(optical_axis(each.quat_xyzw)) for each in (coarse, there)]
    pairs, back = _followed(*ways, *looks, paces, moments, silent_s + beat, beat)
    at = np.clip(np.searchsorted(coarse.t_s, log.t_s, side="right") - 1, 0, len(few) - 1)
    guess = np.interp(log.t_s, coarse.t_s, moments[pairs])
    after = np.minimum(at + 1, len(few) - 1)
    apart = np.abs(moments[pairs[after]] - moments[pairs[at]]) > 3 * FASTEST * max(beat, silent_s)
    nearer = np.where(log.t_s - coarse.t_s[at] <= coarse.t_s[after] - log.t_s, at, after)
    guess = np.where(apart, moments[pairs[nearer]], guess)
    reach = 2 * max(beat, float(moments[1] - moments[0])) + 1.0
    return replace(projected(plan, log.positions, guess, reach), backwards=back[at])


def projected(plan: Trajectory, positions: Floats, around_s: Floats, reach_s: float = 1.0) -> Matched:
    """The same for positions (N, 3) whose moments (N,) are known to some seconds."""
    where, path = np.ascontiguousarray(positions), np.ascontiguousarray(plan.positions)
    moment, place = _nearest(where, around_s, plan.t_s, path, reach_s)
    return Matched(moment, place, np.zeros(len(where), bool))


@njit(cache=True)
def _nearest(
    positions: Floats, around_s: Floats, t_s: Floats, path: Floats, reach_s: float
) -> tuple[Floats, Floats]:
    """Moment (N,) and place (N, 3) of a path nearest to each position, of those within reach of a moment."""
    moment, place = around_s.copy(), np.empty((len(positions), 3))
    for i in range(len(positions)):
        low, high = max(around_s[i] - reach_s, t_s[0]), min(around_s[i] + reach_s, t_s[-1])
        leg = max(min(np.searchsorted(t_s, low) - 1, len(t_s) - 2), 0)
        best = np.inf
        while leg < len(t_s) - 1 and (t_s[leg] <= high or best == np.inf):
            span = t_s[leg + 1] - t_s[leg]
            first, last = (low - t_s[leg]) / span, (high - t_s[leg]) / span
            along, length = 0.0, 0.0
            for axis in range(3):
                step = path[leg + 1, axis] - path[leg, axis]
                along += (positions[i, axis] - path[leg, axis]) * step
                length += step * step
            share = along / length if length > 1e-12 else (around_s[i] - t_s[leg]) / span
            share = min(max(share, max(first, 0.0)), max(min(last, 1.0), 0.0))
            here = t_s[leg] + share * span
            gap = 0.0
            for axis in range(3):
                value = path[leg, axis] + share * (path[leg + 1, axis] - path[leg, axis])
                gap += (positions[i, axis] - value) ** 2
            cost = np.sqrt(gap) + 0.01 * abs(here - around_s[i])  # where a plan stands, the clock decides
            if cost < best:
                best, moment[i] = cost, here
                for axis in range(3):
                    place[i, axis] = path[leg, axis] + share * (path[leg + 1, axis] - path[leg, axis])
            leg += 1
    return moment, place


@njit(cache=True)
def _followed(
    log: Floats, plan: Floats, log_axis: Floats, plan_axis: Floats,
    paces_s: Floats, moments: Floats, silent_s: float, beat_s: float,
) -> tuple[Ints, Bools]:  # fmt: skip
    """For each log position (N, 3) the index of a plan position (M, 3), and whether it went backwards."""
    n, m = len(log), len(plan)
    delta = moments[1] - moments[0]
    total = np.zeros((2, m))
    whence = np.zeros((n, 2, m), np.int32)  # state before: direction * m + index
    now = np.empty((2, m))
    for i in range(n):
        if i:
            pace = paces_s[i - 1]
            silent = pace > silent_s
            farthest = FASTEST * pace + _ELSEWHERE_M / _HASTE_M * beat_s
            reach = min(int(farthest / delta) + 1, m - 1)
            best = 0
            for state in range(2 * m):
                if total[state // m, state % m] < total[best // m, best % m]:
                    best = state
            elsewhere = total[best // m, best % m] + _ELSEWHERE_M
            for way in range(2):
                for j in range(m):
                    least, source = elsewhere, best
                    for k in range(reach + 1):
                        before = j - k if way == 0 else j + k
                        if before < 0 or before >= m:
                            break
                        flown = k * delta
                        cost = total[way, before]
                        if flown > FASTEST * pace:
                            cost += _HASTE_M * (flown - FASTEST * pace) / beat_s
                        elif flown < SLOWEST * pace and not silent:
                            cost += _PAUSE_M * (SLOWEST * pace - flown) / beat_s
                        if cost < least:
                            least, source = cost, way * m + before
                    now[way, j], whence[i, way, j] = least, source
            total[:] = now
        for j in range(m):
            gap, turn = 0.0, 0.0
            for axis in range(3):
                gap += (log[i, axis] - plan[j, axis]) ** 2
                turn += log_axis[i, axis] * plan_axis[j, axis]
            cost = min(np.sqrt(gap), _FAR_M) + _ASIDE_M * (1.0 - turn) / 2
            total[0, j] += cost
            total[1, j] += cost
    pairs, back = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    state = 0
    for other in range(2 * m):
        if total[other // m, other % m] < total[state // m, state % m]:
            state = other
    for i in range(n - 1, -1, -1):
        pairs[i], back[i] = state % m, state >= m
        state = whence[i, state // m, state % m]
    return pairs, back
