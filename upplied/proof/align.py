"""A flown log laid on its plan: jumps of the position taken out, clocks and frames brought together.

What is estimated is small: an offset of the clocks, a shift and a turn about the vertical of the log's frame,
and a constant turn of the logged camera. Each comes with its error, told by leaving out one stretch of the
flight after the other, and is applied only where it exceeds three of it and what vehicles drift by: what is
smaller is how the vehicle flew. Whether a constant shift was the log's or the vehicle's no log can tell; it
is taken as the log's, said, and the clearance is judged with it and without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.errors import RefusedError
from upplied.polylines import interpolated
from upplied.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.proof.camera import LEAST_TURN_DEG, camera_offset
from upplied.proof.matching import Matched, clock_offset, matched_in_order, share_near
from upplied.records import Bools, Floats, Record, Trajectory

_JUMP_M, _JUMP_MPS2 = 0.3, 20.0  # a step of the position that no vehicle flies: twice the force of gravity
_NEAR_M = 3.0  # from the plan, within which a pose belongs to it
_BLOCK_S = 20.0  # stretches that are left out in turn: longer than errors of position hang together
_SIGMAS = 3.0
_LEAST_M, _LEAST_DEG = 0.1, 0.3  # less than vehicles drift: nothing is corrected
_LARGEST_M, _LARGEST_DEG = 5.0, 10.0  # of what is corrected: more is another flight, or another place
_LARGEST_CAMERA_DEG = 5.0  # what a compass or a mount may be off; more is a camera that looked elsewhere
_LEAST_SHARE = 0.3  # of the poses near the plan, after all of it
_LAG_S = 0.1  # one sigma of how differently a vehicle may lag across and upwards
_ROUNDS = 12
_FEWEST = 10  # poses that a turn of the camera is told from
_HUBER_M = 0.3  # residuals beyond count less: gusts, and the ways there and back


@dataclass(frozen=True, eq=False, repr=False)
class Alignment(Record):
    """A log on its plan, and what was done to it."""

    flown: Trajectory  # in the frame of the plan; times are the log's, from 0
    planned_s: Floats  # (N,) moment of the plan that each pose corresponds to; NaN where to none
    clock_s: float  # the log's time at which the plan begins; NaN where it was not flown in its times
    clock_error_s: float  # one sigma
    shift_m: Floats  # (3,) added to the logged positions, at their middle
    heading_deg: float  # turn of the log's frame about the vertical that was applied
    place_error_m: float  # one sigma of the shift
    camera_yaw_deg: float  # added to the logged heading of the camera
    camera_pitch_deg: float
    residual_p95_m: float  # between the poses and the plan, after all of it
    jumps: tuple[tuple[float, float], ...] = ()  # time of the log, s, and size, m, of what was taken out

    @property
    def on_plan(self) -> Bools:
        """(N,) poses that belong to the plan."""
        return np.isfinite(self.planned_s)


def align(plan: Trajectory, log: Trajectory) -> Alignment:
    """Lay a log on its plan.

    Parameters
    ----------
    plan, log : Trajectory
        In the frame of the same structure; the clocks have nothing in common.

    Raises
    ------
    RefusedError
        If the log does not lie on the plan: too few of its poses come near it, or only by a correction
        that is no small one.
    """
    whole, jumps = without_jumps(log)
    found = _in_time(plan, whole)
    spatial = share_near(plan.positions, whole.positions, _NEAR_M)
    timed = found is not None and bool(np.mean(found.near) >= 0.8 * spatial)
    if found is None or not timed:
        found = matched_in_order(plan, whole, _NEAR_M)
    near_pct = 100 * float(np.mean(found.near))
    if near_pct < 100 * _LEAST_SHARE:
        raise RefusedError(
            "the log",
            f"does not lie on the plan: {near_pct:.0f} % of its poses come within {_NEAR_M:g} m",
            f"{100 * _LEAST_SHARE:.0f} % at least",
            "name the plan that was flown, or say in a side-car where the structure stands",
        )
    return _applied(plan, whole, found, timed, jumps)


def as_simulated(plan: Trajectory, flown: Trajectory) -> Alignment:
    """A flight whose path and clock are those of its plan, as a simulated one's are."""
    there = np.clip(flown.t_s, plan.t_s[0], plan.t_s[-1])
    off = np.linalg.norm(flown.positions - interpolate(plan, there).positions, axis=1)
    return Alignment(flown, there, 0.0, 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0, float(np.percentile(off, 95)))


def without_jumps(log: Trajectory) -> tuple[Trajectory, tuple[tuple[float, float], ...]]:
    """The log without steps of its position that no vehicle can fly, and when and how far they went.

    What comes after such a step is moved back, so that the path goes on where it was.
    """
    step, gap = np.diff(log.positions, axis=0), np.diff(log.t_s)
    if len(step) < 3:
        return log, ()
    pace = step / gap[:, None]
    usual = np.empty_like(pace)
    usual[1:-1], usual[0], usual[-1] = (pace[:-2] + pace[2:]) / 2, pace[1], pace[-2]
    beyond = (pace - usual) * gap[:, None]
    size = np.linalg.norm(beyond, axis=1)
    found = (size > _JUMP_M) & (size > _JUMP_MPS2 * gap**2)
    peak = size >= np.maximum(np.append(size[1:], 0), np.insert(size[:-1], 0, 0))  # its neighbours echo it
    at = np.flatnonzero(found & peak)
    if not len(at):
        return log, ()
    back = np.zeros_like(log.positions)
    for index in at:
        back[index + 1 :] -= beyond[index]
    jumps = tuple((float(log.t_s[index + 1]), float(size[index])) for index in at)
    return replace(log, positions=log.positions + back), jumps


def _in_time(plan: Trajectory, log: Trajectory) -> Matched | None:
    """The match of a flight that was flown in the times of its plan."""
    start = clock_offset(plan, log)
    if start is None:
        return None
    params = np.zeros(5)  # clock, shift x y z, turn
    params[0] = start
    middle = log.positions.mean(axis=0)
    params = _settled(plan, log, middle, params, np.ones(5))
    error = _solved(plan, log, middle, params, error=True)[1]
    error[4] = np.hypot(error[4], _LAG_S * _turning_radps(plan, middle))
    params, error[4] = _with_heading(plan, log, middle, params, error)
    moment = log.t_s - params[0]
    gap = np.linalg.norm(_moved(log, middle, params) - _planned(plan, moment), axis=1)
    inside = (moment >= plan.t_s[0] - 1.0) & (moment <= plan.t_s[-1] + 1.0)
    return Matched(moment, inside & (gap < _NEAR_M), params, error, middle)


def _turning_radps(plan: Trajectory, middle: Floats) -> float:
    """How fast a plan goes round a place, on average: round a tower a turn of the frame looks like a lag."""
    off = plan.positions[:, :2] - middle[:2]
    step = np.diff(np.unwrap(np.arctan2(off[:, 1], off[:, 0])))
    return float(abs(step.sum()) / max(plan.t_s[-1] - plan.t_s[0], 1e-9))


def _settled(plan: Trajectory, log: Trajectory, middle: Floats, params: Floats, free: Floats) -> Floats:
    """The parameters (5,) at which the log lies nearest to its plan; those that are not free stay."""
    for _ in range(_ROUNDS):
        change = free * _solved(plan, log, middle, params, error=False)[0]
        params = params + change
        if np.abs(change).max() < 1e-5:
            break
    return params


def _with_heading(
    plan: Trajectory, log: Trajectory, middle: Floats, params: Floats, error: Floats
) -> tuple[Floats, float]:
    """The parameters with the turn as the camera's heading tells it too, and the error of that turn.

    A frame that is turned turns the logged camera by the same angle as the path. Where both tell of a turn,
    the same within their errors, it is the frame's, and the camera says it far more exactly; where they do
    not, a compass or a mount is off, and the path alone counts.
    """
    moment = log.t_s - params[0]
    gap = np.linalg.norm(_moved(log, middle, params) - _planned(plan, moment), axis=1)
    near = (moment >= plan.t_s[0]) & (moment <= plan.t_s[-1]) & (gap < _NEAR_M)
    if near.sum() <= _FEWEST or not np.isfinite(error[4]):
        return params, float(error[4])
    seen, sigma = camera_offset(plan, replace(log.take(near), t_s=moment[near]))[0]
    own = max(float(error[4]), np.radians(LEAST_TURN_DEG))
    told = abs(params[4]) > _SIGMAS * own and abs(seen) > _SIGMAS * sigma
    if not told or abs(seen - params[4]) > _SIGMAS * np.hypot(own, sigma):
        return params, float(error[4])
    weight = np.array([max(float(error[4]), 1e-6), sigma]) ** -2.0
    params = params.copy()
    params[4] = float(weight @ [params[4], seen] / weight.sum())
    return _settled(plan, log, middle, params, np.array([1.0, 1.0, 1.0, 1.0, 0.0])), float(
        weight.sum() ** -0.5
    )


def _moved(log: Trajectory, middle: Floats, params: Floats) -> Floats:
    cos, sin = np.cos(params[4]), np.sin(params[4])
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((log.positions - middle) @ turn.T + middle + params[1:4])


def _planned(plan: Trajectory, moment: Floats) -> Floats:
    return interpolated(moment, plan.t_s, plan.positions)


def _solved(
    plan: Trajectory, log: Trajectory, middle: Floats, params: Floats, error: bool
) -> tuple[Floats, Floats]:
    """One step of reweighted least squares for the five parameters, and their errors (one sigma)."""
    moment = log.t_s - params[0]
    gap = _moved(log, middle, params) - _planned(plan, moment)
    pace = (_planned(plan, moment + 0.05) - _planned(plan, moment - 0.05)) / 0.1
    size = np.linalg.norm(gap, axis=1)
    inside = (moment > plan.t_s[0]) & (moment < plan.t_s[-1]) & (size < _NEAR_M)
    weight = inside * np.minimum(1.0, _HUBER_M / np.maximum(size, 1e-9))
    arm = log.positions - middle
    jacobian = np.zeros((len(log), 3, 5))
    jacobian[:, :, 0] = pace
    jacobian[:, :, 1:4] = np.eye(3)
    jacobian[:, 0, 4], jacobian[:, 1, 4] = -arm[:, 1], arm[:, 0]
    weighted = jacobian * weight[:, None, None]
    normal = np.einsum("nki,nkj->nij", weighted, jacobian)
    right = -np.einsum("nki,nk->ni", weighted, gap)
    ridge = np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-3])  # of what the path does not tell: stays as it is
    whole, sum_right = normal.sum(axis=0) + ridge, right.sum(axis=0)
    change = np.linalg.solve(whole, sum_right)
    if not error:
        return change, np.full(5, np.nan)
    block = (log.t_s // _BLOCK_S).astype(int)
    left = []
    for name in np.unique(block[inside]):
        out = block == name
        left.append(np.linalg.solve(whole - normal[out].sum(axis=0), sum_right - right[out].sum(axis=0)))
    count = len(left)
    if count < 3:
        return change, np.full(5, np.inf)
    spread = np.asarray(left) - np.mean(left, axis=0)
    return change, np.sqrt((count - 1) / count * (spread**2).sum(axis=0))


def _applied(
    plan: Trajectory,
    log: Trajectory,
    found: Matched,
    timed: bool,
    jumps: tuple[tuple[float, float], ...],
) -> Alignment:
    """The log with those corrections that are told from how the vehicle flew."""
    params, error = found.params.copy(), found.error
    place_error = float(np.linalg.norm(error[1:4]))
    if not np.linalg.norm(params[1:4]) > max(_SIGMAS * place_error, _LEAST_M):
        params[1:4] = 0.0
    if not abs(params[4]) > max(_SIGMAS * error[4], np.radians(_LEAST_DEG)):
        params[4] = 0.0
    shift, turn_deg = float(np.linalg.norm(params[1:4])), float(np.degrees(params[4]))
    if shift > _LARGEST_M or abs(turn_deg) > _LARGEST_DEG:
        raise RefusedError(
            "the log",
            f"lies on the plan only if it is moved by {shift:.1f} m and turned by {turn_deg:.1f} deg",
            f"{_LARGEST_M:g} m and {_LARGEST_DEG:g} deg at most",
            "say in a side-car where the structure stands in the log's frame",
        )
    positions = _moved(log, found.middle, params) if params[1:].any() else log.positions
    yaw, pitch = yaw_pitch(log.quat_xyzw)
    yaw = yaw + params[4]
    bias = [0.0, 0.0]
    if found.near.sum() > _FEWEST:
        turned = replace(log, t_s=found.moment, quat_xyzw=from_yaw_pitch(yaw, pitch)).take(found.near)
        bias = [_bias(*each) for each in camera_offset(plan, turned)]
    quats = from_yaw_pitch(yaw + bias[0], np.clip(pitch + bias[1], -np.pi / 2, np.pi / 2))
    gap = np.linalg.norm(positions - _planned(plan, found.moment), axis=1)
    return Alignment(
        flown=replace(log, positions=positions, quat_xyzw=quats),
        planned_s=np.where(found.near, found.moment, np.nan),
        clock_s=float(params[0]) if timed else float("nan"),
        clock_error_s=float(error[0]) if timed else float("nan"),
        shift_m=params[1:4],
        heading_deg=turn_deg,
        place_error_m=place_error,
        camera_yaw_deg=float(np.degrees(bias[0])),
        camera_pitch_deg=float(np.degrees(bias[1])),
        residual_p95_m=float(np.percentile(gap[found.near], 95)),
        jumps=jumps,
    )


def _bias(offset: float, error: float) -> float:
    """A constant turn, rad: where it is small and beyond three errors; else 0."""
    if not abs(offset) <= np.radians(_LARGEST_CAMERA_DEG):
        return 0.0  # taken as it was logged: what it did not look at was not seen
    return offset if abs(offset) > _SIGMAS * error else 0.0
