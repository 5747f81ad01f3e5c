"""The errors of a log's frame and of its camera, as a plan that was flown shows them.

Of the frame they are a shift and a turn. Only the deviation across the plan's path counts: along it, pace and
frame cannot be distinguished. An error of the frame is the same over the whole flight: it is believed if it
removes most of the deviation in nearly every stretch. A vehicle that strays, or a larger stand-off all round,
has no such shape.

The stated error is that of the worst position, moved or not: the correction, and two sigma of the fit in its
weakest direction. A ring round a tower determines no turn about its axis, a straight leg no shift along it:
there the usual errors of frames are assumed.

A constant turn of the camera is estimated together with its lag. A camera that follows its plan is late by
its lag times its rate: round a tower, where it turns one way all the time, that looks like a rotated mount.
"""

from dataclasses import dataclass, replace

import numpy as np

from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import interpolate, yaw_pitch
from upplied.proof.matching import projected
from upplied.records import Bools, Floats, Ints, Record, Trajectory

_BLOCK_S = (8.0, 20.0)  # stretches that are left out in turn: longer than errors of position correlate
_BLOCKS = 6  # of a short flight
_FEWEST = 4  # stretches that an error of the frame is estimated from
_SIGMAS = 3.0
_LEAST_M, _LEAST_DEG = 0.1, 0.3  # less than vehicles drift: nothing is corrected
_LEFT = 0.6  # share of the median deviation that may be left after a correction
_BETTER, _LITTLE_M = 0.85, 0.05  # share of stretches that come nearer then, or hardly farther
_ROUNDS = 15
_HUBER_M = 0.3  # residuals beyond count less: gusts, and the ways there and back
_PRIOR_M, _PRIOR_DEG = 3.0, 3.0  # one sigma of a shift and of a turn that the path does not determine
_PRIOR = np.diag([_PRIOR_M**-2] * 3 + [np.radians(_PRIOR_DEG) ** -2])
_STRAY_M = 0.1  # one sigma of how vehicles stray from their path over a stretch, at least
_TANGENT_S = 0.4
LEAST_TURN_DEG = 0.1  # one sigma of a turn, at least: a gimbal is no better
_TURN_BLOCK_S = 20.0  # stretches whose errors hang together, and count as one
_LAG_S = 0.3  # one sigma of what a gimbal or a heading may lag by, beyond what the position does
_HALF_S = 0.25  # to both sides, over which the planned rate is taken
_HUBER_DEG = 1.0  # residuals beyond count less
_TURN_ROUNDS = 8


@dataclass(frozen=True, eq=False, repr=False)
class FrameError(Record):
    """A turn about the vertical through a place, then a shift, that bring a log onto its plan."""

    middle: Floats  # (3,) m
    shift_m: Floats  # (3,)
    turn_rad: float
    error_m: float = 0.0  # how far off the positions may be, whether they are moved or not
    believed: bool = False  # it has the shape of an error of the frame

    def moved(self, positions: Floats) -> Floats:
        """Positions (N, 3) after it."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray((positions - self.middle) @ turn.T + self.middle + self.shift_m)


def frame_error(plan: Trajectory, log: Trajectory, moment: Floats, near_m: float) -> FrameError:
    """The error of a log's frame, estimated from the deviation of its poses across the plan.

    Each pose corresponds to a moment (N,) of the plan, to a second; those farther from it do not count.
    """
    beside, middle = _Beside(plan, log, moment, near_m), log.positions.mean(axis=0)
    values, still = np.zeros(4), np.zeros(len(log), bool)
    normal, right = np.empty((0, 4, 4)), np.empty((0, 4))
    for _ in range(_ROUNDS):
        across, jacobian, still = beside.across(FrameError(middle, values[:3], float(values[3])))
        size = np.linalg.norm(across, axis=1)
        weight = still * np.minimum(1.0, _HUBER_M / np.maximum(size, 1e-9))
        normal = np.einsum("nki,nkj,n->nij", jacobian, jacobian, weight)
        right = np.einsum("nki,nk,n->ni", jacobian, across, weight)
        change = np.linalg.solve(normal.sum(axis=0) + _PRIOR, right.sum(axis=0) - _PRIOR @ values)
        values = values + change
        if np.abs(change).max() < 1e-4:
            break
    names = np.unique(beside.block[still])
    scatter, sigma = np.zeros((4, 4)), np.full(4, np.inf)
    if len(names) >= _FEWEST:
        whole, right_sum = normal.sum(axis=0) + _PRIOR, right.sum(axis=0) - _PRIOR @ values
        left = [np.linalg.solve(whole - normal[out].sum(axis=0), right_sum - right[out].sum(axis=0))
                for out in (beside.block == name for name in names)]  # fmt: skip
        spread = np.asarray(left) - np.mean(left, axis=0)
        scatter = (len(left) - 1) / len(left) * spread.T @ spread
        sigma = np.sqrt(np.diag(scatter))
    error_m = beside.may_be_off_m(FrameError(middle, values[:3], float(values[3])), scatter)
    values = values.copy()
    for part, least in ((slice(3), _LEAST_M), (slice(3, 4), np.radians(_LEAST_DEG))):
        if not np.linalg.norm(values[part]) > max(_SIGMAS * np.linalg.norm(sigma[part]), least):
            values[part] = 0.0
    error = FrameError(middle, values[:3], float(values[3]), error_m)
    return replace(error, believed=bool(values.any()) and beside.shaped(error))


class _Beside:
    def __init__(self, plan: Trajectory, log: Trajectory, moment: Floats, near_m: float) -> None:
        self.plan, self.log, self.moment, self.near_m = plan, log, moment, near_m
        since = log.t_s - log.t_s[0]
        #: (N,) the stretch that each pose belongs to
        self.block = np.asarray(since // np.clip(since[-1] / _BLOCKS, *_BLOCK_S), np.int64)

    def across(self, error: FrameError) -> tuple[Floats, Floats, Bools]:
        """The deviation across the path (N, 3) at each pose, its Jacobian by shift and turn, which count."""
        plan, moved = self.plan, error.moved(self.log.positions)
        on = projected(plan, moved, self.moment)
        gap = on.place - moved
        inside = (on.moment > plan.t_s[0]) & (on.moment < plan.t_s[-1])
        ends = (on.moment + _TANGENT_S, on.moment - _TANGENT_S)
        ahead, behind = (interpolated(end, plan.t_s, plan.positions) for end in ends)
        step = ahead - behind
        length = np.linalg.norm(step, axis=1, keepdims=True)
        along = np.where(length > 1e-3, step / np.maximum(length, 1e-12), 0.0)
        flat = np.eye(3) - along[:, :, None] * along[:, None, :]
        near = inside & (np.linalg.norm(gap, axis=1) < self.near_m)
        return np.einsum("nij,nj->ni", flat, gap), flat @ _motion(moved - error.middle), near

    def may_be_off_m(self, fit: FrameError, scatter: Floats) -> float:
        """The correction of the worst position, and two sigma of the fit in its weakest direction, m.

        Each stretch counts once; `scatter` (4, 4) is that of fits without one of them.
        """
        across, jacobian, near = self.across(fit)
        _, of = np.unique(self.block, return_inverse=True)
        share = near / np.maximum(np.bincount(of, near), 1)[of]
        normal = np.einsum("nki,nkj,n->ij", jacobian, jacobian, share)
        stray_m = max(np.sqrt(np.mean(across[near] ** 2)) if near.any() else 0.0, _STRAY_M)
        covariance = np.linalg.inv(normal / stray_m**2 + _PRIOR) + scatter
        moved = fit.moved(self.log.positions)
        motion = _motion(moved - fit.middle)
        sigma_m = np.sqrt(np.linalg.eigvalsh(motion @ covariance @ motion.transpose(0, 2, 1))[:, -1])
        return float((np.linalg.norm(moved - self.log.positions, axis=1) + 2 * sigma_m).max())

    def shaped(self, error: FrameError) -> bool:
        """Whether a correction removes most of the deviation, and in nearly every stretch some of it."""
        before, _, near = self.across(FrameError(error.middle, np.zeros(3), 0.0))
        sizes = [np.linalg.norm(each, axis=1) for each in (before, self.across(error)[0])]
        stretches = [near & (self.block == name) for name in np.unique(self.block[near])]
        middles = np.array([[np.median(size[some]) for size in sizes] for some in stretches])
        was, now = np.sqrt(np.mean(middles**2, axis=0))
        return bool(now <= _LEFT * was and np.mean(middles[:, 1] < middles[:, 0] + _LITTLE_M) >= _BETTER)


def _motion(arm: Floats) -> Floats:
    """How places (N, 3) at some arm from the middle move with shift and turn, (N, 3, 4)."""
    motion = np.zeros((len(arm), 3, 4))
    motion[:, :, :3] = np.eye(3)
    motion[:, 0, 3], motion[:, 1, 3] = -arm[:, 1], arm[:, 0]
    return motion


def camera_offset(plan: Trajectory, flown: Trajectory) -> tuple[tuple[float, float], tuple[float, float]]:
    """A constant turn of the camera, rad, that is to be added to what was flown, and one sigma of it.

    Of the heading, and of the pitch; the error is infinite where the flight is too short to tell. What was
    flown has the moments of the plan that it corresponds to as its times.
    """
    low, high = plan.t_s[0], plan.t_s[-1]
    moments = [np.clip(flown.t_s + off, low, high) for off in (-_HALF_S, 0.0, _HALF_S)]
    before, now, after = (yaw_pitch(interpolate(plan, at).quat_xyzw) for at in moments)
    span = np.maximum(moments[2] - moments[0], 1e-9)
    block = (flown.t_s // _TURN_BLOCK_S).astype(int)
    is_so = yaw_pitch(flown.quat_xyzw)
    rates = [_turned(last - first) / span for first, last in zip(before, after, strict=True)]
    offs = [_turned(plan - mine) for plan, mine in zip(now, is_so, strict=True)]
    yaw, pitch = (_constant(off, rate, block) for off, rate in zip(offs, rates, strict=True))
    return yaw, pitch


def _turned(angle_rad: Floats) -> Floats:
    return np.asarray(np.angle(np.exp(1j * angle_rad)))


def _constant(off_rad: Floats, rate_radps: Floats, block: Ints) -> tuple[float, float]:
    """The constant part of ``off = turn + lag * rate``, and one sigma of it, each stretch counting once."""
    names, of = np.unique(block, return_inverse=True)
    if len(names) < 3:
        return 0.0, float("inf")
    shape = np.column_stack([np.ones(len(off_rad)), rate_radps])
    share = 1.0 / np.bincount(of)[of]
    values = np.array([np.median(off_rad), 0.0])
    spread, least = np.radians(_HUBER_DEG), float(np.radians(LEAST_TURN_DEG))
    prior = np.diag([0.0, _LAG_S**-2])
    for _ in range(_TURN_ROUNDS):
        left = off_rad - shape @ values
        weight = share * np.minimum(1.0, np.radians(_HUBER_DEG) / np.maximum(np.abs(left), 1e-12))
        normal = (shape * weight[:, None]).T @ shape / spread**2 + prior
        values = np.linalg.solve(normal, (shape * weight[:, None]).T @ off_rad / spread**2)
        left = off_rad - shape @ values
        middles = np.array([np.median(left[of == name]) for name in range(len(names))])
        spread = max(1.4826 * float(np.median(np.abs(middles - np.median(middles)))), least)
    normal = (shape * weight[:, None]).T @ shape / spread**2 + prior
    return float(values[0]), max(float(np.sqrt(np.linalg.inv(normal)[0, 0])), least)
