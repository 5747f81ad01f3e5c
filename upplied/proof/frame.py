"""By what shift and turn of a log's frame its path comes to lie on its plan, and whether that is its error.

Only what lies across the plan's path is asked: along it, pace and frame cannot be told apart. An error of the
frame is the same over the whole flight: it is believed where it takes away most of what lies across, in
nearly every stretch. How a vehicle strays, or a stand-off that is larger all round, has no such shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.polylines import interpolated
from upplied.proof.matching import projected
from upplied.records import Bools, Floats, Record, Trajectory

_BLOCK_S = 20.0  # stretches that are left out in turn: longer than errors of position hang together
_FEWEST = 4  # stretches that an error of the frame is told from
_SIGMAS = 3.0
_LEAST_M, _LEAST_DEG = 0.1, 0.3  # less than vehicles drift: nothing is corrected
_LEFT = 0.6  # of what lay across the path, that may be left after a correction, in the median
_BETTER = 0.85  # of the stretches lie nearer then
_ROUNDS = 15
_HUBER_M = 0.3  # residuals beyond count less: gusts, and the ways there and back
_PRIOR_M = 3.0  # one sigma of a shift of what the path does not tell
_TANGENT_S = 0.4


@dataclass(frozen=True, eq=False, repr=False)
class FrameError(Record):
    """A turn about the vertical through a place, then a shift, that bring a log onto its plan."""

    middle: Floats  # (3,) m
    shift_m: Floats  # (3,)
    turn_rad: float
    place_error_m: float  # one sigma of the shift
    believed: bool  # it has the shape of an error of the frame

    def moved(self, positions: Floats) -> Floats:
        """Positions (N, 3) after it."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray((positions - self.middle) @ turn.T + self.middle + self.shift_m)


def frame_error(plan: Trajectory, log: Trajectory, moment: Floats, near_m: float) -> FrameError:
    """The error of a log's frame, told by where its poses lie beside the plan.

    Parameters
    ----------
    plan, log : Trajectory
    moment : array, shape (N,), s
        Of the plan, that each pose corresponds to, to a second.
    near_m : float
        Poses farther from the plan do not count.
    """
    middle = log.positions.mean(axis=0)
    values, still = np.zeros(4), np.zeros(len(log), bool)
    normal, right = np.empty((0, 4, 4)), np.empty((0, 4))
    prior = np.diag([_PRIOR_M**-2.0] * 3 + [1.0])
    for _ in range(_ROUNDS):
        found = FrameError(middle, values[:3], float(values[3]), 0.0, False)
        across, jacobian, still = _across(plan, log, found, moment, near_m)
        size = np.linalg.norm(across, axis=1)
        weight = still * np.minimum(1.0, _HUBER_M / np.maximum(size, 1e-9))
        normal = np.einsum("nki,nkj,n->nij", jacobian, jacobian, weight)
        right = np.einsum("nki,nk,n->ni", jacobian, across, weight)
        change = np.linalg.solve(normal.sum(axis=0) + prior, right.sum(axis=0) - prior @ values)
        values = values + change
        if np.abs(change).max() < 1e-4:
            break
    block = (log.t_s // _BLOCK_S).astype(int)
    names = np.unique(block[still])
    if len(names) < _FEWEST:
        return FrameError(middle, values[:3], float(values[3]), float("inf"), False)
    whole, told = normal.sum(axis=0) + prior, right.sum(axis=0) - prior @ values
    left = [np.linalg.solve(whole - normal[out].sum(axis=0), told - right[out].sum(axis=0))
            for out in (block == name for name in names)]  # fmt: skip
    spread = np.asarray(left) - np.mean(left, axis=0)
    error = np.sqrt((len(left) - 1) / len(left) * (spread**2).sum(axis=0))
    for part, least in ((slice(3), _LEAST_M), (slice(3, 4), np.radians(_LEAST_DEG))):
        if not np.linalg.norm(values[part]) > max(_SIGMAS * np.linalg.norm(error[part]), least):
            values[part] = 0.0
    found = FrameError(middle, values[:3], float(values[3]), float(np.linalg.norm(error[:3])), False)
    shaped = bool(values.any()) and _shaped(plan, log, found, moment, near_m)
    return FrameError(middle, values[:3], float(values[3]), found.place_error_m, shaped)


def _shaped(plan: Trajectory, log: Trajectory, found: FrameError, moment: Floats, near_m: float) -> bool:
    """Whether most of what lies across the path goes with it, and in nearly every stretch some of it."""
    none = FrameError(found.middle, np.zeros(3), 0.0, 0.0, False)
    before, _, near = _across(plan, log, none, moment, near_m)
    after, _, _ = _across(plan, log, found, moment, near_m)
    block = (log.t_s // _BLOCK_S).astype(int)
    sizes = [np.linalg.norm(each, axis=1) for each in (before, after)]
    middles = np.array(
        [[np.median(size[near & (block == name)]) for size in sizes] for name in np.unique(block[near])]
    )
    was, now = np.sqrt(np.mean(middles**2, axis=0))
    return bool(now <= _LEFT * was and np.mean(middles[:, 1] < middles[:, 0]) >= _BETTER)


def _across(
    plan: Trajectory, log: Trajectory, error: FrameError, moment: Floats, near_m: float
) -> tuple[Floats, Floats, Bools]:
    """What lies across the path (N, 3) at each pose, how it changes with shift and turn, and which count."""
    moved = error.moved(log.positions)
    on = projected(plan, moved, moment)
    gap = on.place - moved
    inside = (on.moment > plan.t_s[0]) & (on.moment < plan.t_s[-1])
    ahead, behind = (interpolated(on.moment + d, plan.t_s, plan.positions) for d in (_TANGENT_S, -_TANGENT_S))
    step = ahead - behind
    length = np.linalg.norm(step, axis=1, keepdims=True)
    along = np.where(length > 1e-3, step / np.maximum(length, 1e-12), 0.0)
    flat = np.eye(3) - along[:, :, None] * along[:, None, :]
    arm = moved - error.middle
    jacobian = np.zeros((len(log), 3, 4))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, 0, 3], jacobian[:, 1, 3] = -arm[:, 1], arm[:, 0]
    near = inside & (np.linalg.norm(gap, axis=1) < near_m)
    return np.einsum("nij,nj->ni", flat, gap), flat @ jacobian, near
