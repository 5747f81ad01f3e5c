"""What a person should know of a flight, in words: broken off, resumed, silent, stuck, without photos."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.poses import interpolate, optical_axis
from upplied.proof.align import SILENT_S, Alignment, silences
from upplied.records import Bools, Floats, Ints, Trajectory

#: How findings begin after which it is not known what was seen.
SILENT, STOOD, LOOKED = "the log is silent", "the camera stood", "the camera looked"
_WHOLE_PCT = 98.0  # of the plan's length: less is a flight that was broken off
_PAUSE_S = 5.0  # longer than the plan takes between two places: the flight was resumed, or waited
_STUCK_S, _STUCK_DEG, _TURNED_DEG = 5.0, 0.3, 5.0  # a camera that stands while its plan turns
_WAITS = 0.2  # of its pace, less is a wait
_BEAT_S = 0.5  # between checks whether the camera turned
PASSED_S = 1.0  # of a viewpoint, within which it was passed
_PHOTO_S = 1.0  # of a viewpoint, within which a photo is its own


def findings(plan: Trajectory, aligned: Alignment, flown_pct: float) -> tuple[str, ...]:
    """What was done to a log so that it lies on its plan, and what is odd about the flight."""
    of_flight = (*_missing(plan, aligned, flown_pct), *_aside(plan, aligned), *_stuck(plan, aligned))
    return (*_corrected(aligned), *of_flight)


def without_photo(viewpoint_s: Floats, aligned: Alignment, photo_s: Floats) -> tuple[Floats, int]:
    """The moments (K,) of the plan's viewpoints that were passed without a photo, and how many were passed.

    Parameters
    ----------
    viewpoint_s : array, shape (V,), s
        Moments of the plan's viewpoints.
    aligned : Alignment
    photo_s : array, shape (F,), s
        Times of the photos by the log's clock, from its first pose.
    """
    flown, planned = aligned.flown.t_s[aligned.on_plan], aligned.planned_s[aligned.on_plan]
    passed = viewpoint_s[_near(viewpoint_s, planned)]
    taken = np.interp(photo_s, flown, planned, left=np.nan, right=np.nan)
    return passed[~_near(passed, taken[np.isfinite(taken)])], len(passed)


def _corrected(aligned: Alignment) -> Iterator[str]:
    for when, size in aligned.jumps:
        yield f"the position jumps by {size:.2f} m at {when:.0f} s: removed as an error of the log"
    if np.linalg.norm(aligned.shift_m) > 0:
        shift = ", ".join(f"{value:+.2f}" for value in aligned.shift_m)
        yield f"the log was moved by {shift} m onto its plan; if it is right, the flight was beside its plan"
    if aligned.heading_deg:
        yield f"the log was turned by {aligned.heading_deg:+.2f} deg onto its plan"
    if aligned.beside_m:
        beside = f"it flew {aligned.beside_m:.2f} m beside its plan"
        yield f"{beside}, more than its stated accuracy: left as logged"
    if aligned.camera_yaw_deg or aligned.camera_pitch_deg:
        turn = f"{aligned.camera_yaw_deg:+.1f} deg of heading, {aligned.camera_pitch_deg:+.1f} deg of pitch"
        yield f"the logged camera was turned by {turn}"
    if aligned.backwards > 0.02:
        yield f"{100 * aligned.backwards:.0f} % of it was flown against the order of its plan"
    elif not np.isfinite(aligned.clock_s):
        yield "it was not flown at the times of its plan"


def _missing(plan: Trajectory, aligned: Alignment, flown_pct: float) -> Iterator[str]:
    """Where the flight, or its log, lacks a part of the plan."""
    planned = aligned.planned_s[aligned.on_plan]
    left_s, before_s = plan.t_s[-1] - planned.max(), planned.min() - plan.t_s[0]
    if flown_pct < _WHOLE_PCT and left_s > _PAUSE_S:
        yield f"aborted, or the log is cut: it ends {left_s:.0f} s before its plan"
    if flown_pct < _WHOLE_PCT and before_s > _PAUSE_S:
        yield f"started late, or the log is cut: it starts {before_s:.0f} s after its plan"
    for when, length in _waits(aligned):
        yield f"waited for {length:.0f} s at {when:.0f} s"
    usual_s = float(np.median(np.diff(aligned.flown.t_s)))
    if usual_s > SILENT_S:
        yield f"its poses are {usual_s:.1f} s apart: the clearance between them is unknown"
    for when, length in silences(aligned.flown):
        what = "views and clearance are unknown for that time"
        yield f"{SILENT} for {length:.0f} s at {when:.0f} s: {what}"


def _waits(aligned: Alignment) -> Iterator[tuple[float, float]]:
    """Beginning and length, s, of each time in which the flight did not go on in its plan."""
    on, whole = aligned.on_plan, int(_PAUSE_S / _BEAT_S)
    beats = np.arange(aligned.flown.t_s[on][0], aligned.flown.t_s[on][-1], _BEAT_S)
    planned = np.interp(beats, aligned.flown.t_s[on], aligned.planned_s[on])
    if len(beats) <= whole:
        return
    waits = np.abs(planned[whole:] - planned[:-whole]) < _WAITS * _PAUSE_S
    for start, end in _stretches(waits):
        yield float(beats[start]), float((end - 1 - start) * _BEAT_S + _PAUSE_S)


def _stretches(flags: Bools) -> Ints:
    """Where flags (N,) begin and end to be set, (K, 2), the ends exclusive."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).reshape(-1, 2)


def _aside(plan: Trajectory, aligned: Alignment) -> Iterator[str]:
    """A camera that most of the time looked elsewhere than planned; it is used as logged."""
    on = aligned.on_plan
    if on.sum() < 2:
        return
    moments = np.clip(aligned.planned_s[on], plan.t_s[0], plan.t_s[-1])
    axis = optical_axis(aligned.flown.quat_xyzw[on])
    planned_axis = optical_axis(interpolate(plan, moments).quat_xyzw)
    off = float(np.median(_angle_deg((axis * planned_axis).sum(axis=1))))
    if off > _TURNED_DEG:
        yield f"{LOOKED} {off:.0f} deg aside of its plan, in the median: used as logged"


def _stuck(plan: Trajectory, aligned: Alignment) -> Iterator[str]:
    """Stretches in which the camera stood though its plan turned it."""
    on, flown = np.flatnonzero(aligned.on_plan), aligned.flown
    if len(on) < 2:
        return
    beats = np.arange(flown.t_s[on[0]], flown.t_s[on[-1]], _BEAT_S)
    axis = optical_axis(interpolate(flown, beats).quat_xyzw)
    moments = np.interp(beats, flown.t_s[on], aligned.planned_s[on])
    planned_axis = optical_axis(interpolate(plan, np.clip(moments, plan.t_s[0], plan.t_s[-1])).quat_xyzw)
    stands = _angle_deg((axis[:-1] * axis[1:]).sum(axis=1)) < _STUCK_DEG
    for start, end in _stretches(stands):
        turned = float(_angle_deg(planned_axis[start : end + 1] @ planned_axis[start]).max())
        length = float(beats[end] - beats[start]) if end < len(beats) else float(beats[-1] - beats[start])
        if length >= _STUCK_S and turned > _TURNED_DEG:
            when = beats[start]
            yield f"{STOOD} for {length:.0f} s at {when:.0f} s; its plan turned {turned:.0f} deg"


def _angle_deg(cosine: Floats) -> Floats:
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _near(moments: Floats, others: Floats, reach_s: float = _PHOTO_S) -> Bools:
    """Which moments (K,) have another within reach."""
    if not len(others) or not len(moments):
        return np.zeros(len(moments), bool)
    return np.asarray(cKDTree(others[:, None]).query(moments[:, None])[0] <= reach_s, bool)
