"""A flown log aligned with its plan: the moment of the plan of each pose, and the errors of the log's frame.

Corrected are a constant shift and turn of the frame where the deviation has that shape (`frame`), a constant
turn of the camera, and position jumps that no vehicle flies. No log shows whether a constant shift is its own
or the vehicle's: the stated error is never less than the correction, and views and clearance are judged by
the path as logged and by the path as corrected.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated
from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.proof.frame import FrameError, camera_offset, frame_error
from upplied.proof.matching import Matched, matched, projected
from upplied.records import Bools, Floats, Record, Trajectory

SILENT_S, SILENT_STEPS = 1.0, 3.0  # between two poses, and so many usual steps: nothing is known
_JUMP_M, _JUMP_MPS2 = 0.3, 20.0  # a step of the position that no vehicle flies: twice the force of gravity
_JUMP_NOISES = 6.0  # times what the positions usually differ by from their neighbours
_NEAR_M = 4.0  # from the plan, within which a pose belongs to it
_FAR_M = 6.0  # before the frame is corrected
_SIGMAS = 3.0
_LARGEST_M, _LARGEST_DEG = 5.0, 10.0  # of a correction: more is another flight, or another place
_LARGEST_CAMERA_DEG = 5.0  # what a compass or a mount may be off; more is a camera that looked elsewhere
_LEAST_SHARE = 0.3  # of the poses near the plan, after the correction
_FEWEST = 10  # poses that a turn of the camera is estimated from
_EXACT_M, _FINE_M, _MOST_FINE = 0.02, 0.01, 2_000_000
_IN_TIME_S, _IN_TIME_PCT = 2.0, 90  # of the poses, within which of one another clock and plan go together
_REMEDY = "state in a side-car where the structure stands"


@dataclass(frozen=True, eq=False, repr=False)
class Alignment(Record):
    """A log on its plan, and its corrections."""

    flown: Trajectory  # in the frame of the plan; times are the log's, from 0
    planned_s: Floats  # (N,) moment of the plan that each pose corresponds to; NaN where to none
    across_m: Floats  # (N,) of each pose from the plan
    clock_s: float  # the log's time at which the plan begins; NaN where it was not flown in its times
    clock_error_s: float  # one sigma
    shift_m: Floats  # (3,) added to the logged positions, at their middle
    heading_deg: float  # turn of the log's frame about the vertical that was applied
    place_error_m: float  # how far off the corrected positions may be: never less than they were moved
    camera_yaw_deg: float  # added to the logged heading of the camera
    camera_pitch_deg: float
    jumps: tuple[tuple[float, float], ...] = ()  # removed: time of the log, s, and size, m
    beside_m: float = 0.0  # of its plan, where that is more than the log's stated accuracy: not corrected
    backwards: float = 0.0  # share of the poses at which the plan was flown against its order

    @property
    def on_plan(self) -> Bools:
        """(N,) poses that belong to the plan."""
        return np.isfinite(self.planned_s)

    @property
    def corrected(self) -> bool:
        """Whether anything but the log's own poses is judged."""
        turned = self.heading_deg or self.camera_yaw_deg or self.camera_pitch_deg
        return bool(self.shift_m.any() or turned or self.jumps)

    @property
    def residual_p95_m(self) -> float:
        """Distance of the poses from the plan, 95th percentile, m."""
        return float(np.percentile(self.across_m[self.on_plan], 95))


def align(plan: Trajectory, log: Trajectory, accuracy_m: float | None = None) -> Alignment:
    """Lay a log on its plan, both in the frame of one structure; the clocks have nothing in common.

    No more is corrected than the stated accuracy of the logged positions, such as of RTK. A log is refused
    of which too few poses come near the plan, or only by a correction that is no small one.
    """
    whole, jumps = without_jumps(log)
    if accuracy_m is not None and any(size > accuracy_m for _, size in jumps):
        whole, jumps = log, ()
    on = matched(plan, whole, silence_s(log))
    error = frame_error(plan, whole, on.moment, _FAR_M)
    if error.believed:  # the match again, from where it lies now
        on = matched(plan, replace(whole, positions=error.moved(whole.positions)), silence_s(log))
        error = frame_error(plan, whole, on.moment, _FAR_M)
    moved_m = error.moved(whole.positions) - whole.positions
    most = float(np.linalg.norm(moved_m, axis=1).max())
    beside = most if error.believed and accuracy_m is not None and most > accuracy_m else 0.0
    used = error.believed and not beside
    on_plan = whole.positions
    if error.believed:  # where it belongs, whether the log or the vehicle was beside it
        _check_small(error)
        on_plan = whole.positions + moved_m
    positions = on_plan if used else whole.positions
    place = projected(plan, on_plan, on.moment)
    inside = (place.moment >= plan.t_s[0]) & (place.moment <= plan.t_s[-1])
    near = inside & (np.linalg.norm(place.place - on_plan, axis=1) < _NEAR_M)
    if near.mean() < _LEAST_SHARE:
        share = f"{100 * float(near.mean()):.0f} % of its poses come within {_NEAR_M:g} m"
        rule, remedy = f"{100 * _LEAST_SHARE:.0f} % at least", "name the plan that was flown, or"
        raise RefusedError("the log", f"does not lie on the plan: {share}", rule, f"{remedy} {_REMEDY}")
    yaw, pitch = yaw_pitch(log.quat_xyzw)
    yaw = yaw + (error.turn_rad if used else 0.0)
    bias = [0.0, 0.0]
    if near.sum() > _FEWEST:
        turned = replace(log, t_s=place.moment, quat_xyzw=from_yaw_pitch(yaw, pitch)).take(near)
        offsets = camera_offset(plan, turned)
        if max(abs(offset) for offset, _ in offsets) <= np.radians(_LARGEST_CAMERA_DEG):
            # One that is turned farther looked elsewhere: what it missed was not seen.
            bias = [offset if abs(offset) > _SIGMAS * sigma else 0.0 for offset, sigma in offsets]
    corrected = used or any(bias)
    turned_to = from_yaw_pitch(yaw + bias[0], np.clip(pitch + bias[1], -np.pi / 2, np.pi / 2))
    clock, clock_error = _clock(log, place.moment, near, on)
    moved = whole.positions - log.positions, positions - log.positions
    jumped, off = (float(np.linalg.norm(each, axis=1).max()) for each in moved)
    place_error = jumped + error.error_m
    if accuracy_m is not None:  # two sigma of what the log states
        place_error = min(place_error, 2 * accuracy_m + off)
    return Alignment(
        flown=replace(log, positions=positions, quat_xyzw=turned_to if corrected else log.quat_xyzw),
        planned_s=np.where(near, place.moment, np.nan),
        across_m=np.linalg.norm(place.place - positions, axis=1),
        clock_s=clock,
        clock_error_s=clock_error,
        shift_m=error.shift_m if used else np.zeros(3),
        heading_deg=float(np.degrees(error.turn_rad)) if used else 0.0,
        place_error_m=place_error,
        camera_yaw_deg=float(np.degrees(bias[0])),
        camera_pitch_deg=float(np.degrees(bias[1])),
        jumps=jumps,
        beside_m=beside,
        backwards=float(on.backwards[near].mean()),
    )


def as_simulated(plan: Trajectory, flown: Trajectory) -> Alignment:
    """A flight whose path and clock are those of its plan, as a simulated one's are."""
    there = np.clip(flown.t_s, plan.t_s[0], plan.t_s[-1])
    off = np.linalg.norm(flown.positions - interpolate(plan, there).positions, axis=1)
    return Alignment(flown, there, off, 0.0, 0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0)


def follows_exactly(path: Trajectory, aligned: Alignment) -> bool:
    """Whether the poses of a log lie on a path to 2 cm, as no vehicle flies."""
    along = arc_length(path.positions)
    fine = np.append(np.arange(0.0, along[-1], max(_FINE_M, along[-1] / _MOST_FINE)), along[-1])
    own = aligned.flown.positions[aligned.on_plan]
    off = cKDTree(interpolated(fine, along, path.positions)).query(own)[0]
    return bool(np.percentile(off, 95) < _EXACT_M)


def silence_s(flown: Trajectory) -> float:
    """How long a log may say nothing, s, before nothing is known of what the camera saw meanwhile."""
    step = float(np.median(np.diff(flown.t_s))) if len(flown) > 1 else 0.0
    return max(SILENT_S, SILENT_STEPS * step)


def silences(flown: Trajectory) -> list[tuple[float, float]]:
    """Beginning and length, s, of each silence of a log."""
    step = np.diff(flown.t_s)
    return [(float(flown.t_s[at]), float(step[at])) for at in np.flatnonzero(step > silence_s(flown))]


def without_jumps(log: Trajectory) -> tuple[Trajectory, tuple[tuple[float, float], ...]]:
    """The log without position jumps that no vehicle can fly, and when and how far they went.

    The rest is moved back, so that the path continues. A step within a silence, or one larger than any
    correction, is no jump: what was flown stays where it was logged.
    """
    step, gap = np.diff(log.positions, axis=0), np.diff(log.t_s)
    if len(step) < 3:
        return log, ()
    pace = step / gap[:, None]
    usual = np.empty_like(pace)
    usual[1:-1], usual[0], usual[-1] = (pace[:-2] + pace[2:]) / 2, pace[1], pace[-2]
    beyond = (pace - usual) * gap[:, None]
    size = np.linalg.norm(beyond, axis=1)
    least = np.maximum(np.maximum(_JUMP_M, _JUMP_MPS2 * gap**2), _JUMP_NOISES * np.median(size))
    jump = (size > least) & (size <= _LARGEST_M) & (gap <= SILENT_STEPS * np.median(gap))
    peak = size >= np.maximum(np.append(size[1:], 0), np.insert(size[:-1], 0, 0))  # its neighbours echo it
    at = np.flatnonzero(jump & peak)
    if not len(at):
        return log, ()
    back = np.zeros_like(log.positions)
    for index in at:
        back[index + 1 :] -= beyond[index]
    if np.linalg.norm(back, axis=1).max() > _LARGEST_M:
        return log, ()
    jumps = tuple((float(log.t_s[index + 1]), float(size[index])) for index in at)
    return replace(log, positions=log.positions + back), jumps


def _check_small(error: FrameError) -> None:
    shift, turn_deg = float(np.linalg.norm(error.shift_m)), float(np.degrees(error.turn_rad))
    if shift > _LARGEST_M or abs(turn_deg) > _LARGEST_DEG:
        fault = f"lies on the plan only if it is moved by {shift:.1f} m and turned by {turn_deg:.1f} deg"
        rule = f"{_LARGEST_M:g} m and {_LARGEST_DEG:g} deg at most"
        raise RefusedError("the log", fault, rule, f"{_REMEDY} in the log's frame")


def _clock(log: Trajectory, moment: Floats, near: Bools, on: Matched) -> tuple[float, float]:
    """The log's time at which the plan begins, and one sigma; NaN where it was flown at another pace."""
    late = (log.t_s - moment)[near]
    if near.sum() < _FEWEST or on.backwards[near].any():
        return float("nan"), float("nan")
    middle = float(np.median(late))
    if np.percentile(np.abs(late - middle), _IN_TIME_PCT) > _IN_TIME_S:
        return float("nan"), float("nan")
    parts = np.array([np.median(each) for each in np.array_split(late, 10)])
    spread = 1.4826 * float(np.median(np.abs(parts - np.median(parts))))
    return middle, max(spread / np.sqrt(len(parts)), 0.01)
