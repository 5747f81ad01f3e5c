"""The result of a flight: what it inspected and saw, how it differs from its plan, and what is odd of it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import InspectionSettings
from upplied.geometry.polylines import arc_length, chosen_evenly
from upplied.geometry.poses import interpolate, optical_axis
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.geometry.frechet import frechet
from upplied.proof.align import SILENT_S, Alignment, silence_s, silences
from upplied.proof.inspected import CORRECTED_RIM_DEG, planned_looks, views_from
from upplied.proof.looks import Looks, certain_looks, looks_of, pieces, recorded
from upplied.proof.matching import projected
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

_NEARLY_M = 0.5  # beyond the nearest pose: there the path may bend nearer still
_FRECHET_POSES = 800  # of each path
#: How findings begin after which it is not known what was seen.
SILENT, STOOD, LOOKED = "the log is silent", "the camera stood", "the camera looked"
_WHOLE_PCT = 98.0  # of the plan's length: less is a flight that was broken off
_PAUSE_S = 5.0  # longer than the plan takes between two places: the flight was resumed, or waited
_STUCK_S, _STUCK_DEG, _TURNED_DEG = 5.0, 0.3, 5.0  # a camera that stands while its plan turns
_WAITS = 0.2  # of its pace, less is a wait
_BEAT_S = 0.5  # between checks whether the camera turned
PASSED_S = 1.0  # of a viewpoint, within which it was passed
_PHOTO_S = 1.0  # of a viewpoint, within which a photo is its own


@dataclass(frozen=True, eq=False, repr=False)
class AsFlown(Record):
    """The result of a flight."""

    looks: Looks
    flown_pct: float  # of the plan's length, the share that was flown
    clearance_m: float  # certain while it was recorded, of the path as logged and as corrected
    silent_s: float  # how long nothing is known of it
    cross_track_p95_m: float  # from the planned path, of the poses that belong to it
    frechet_m: float  # from the flown path to the flown part of the plan
    photos_missing: int  # viewpoints that show what no photo shows; 0 where no photos are known
    findings: tuple[str, ...]


def as_flown(
    plan: Trajectory, viewpoint_s: Floats, aligned: Alignment, logged: Trajectory, surface: Cloud,
    camera: Camera, scene: Scene, photo_s: Floats | None = None, planned_with: Camera | None = None,
    rule: InspectionSettings | None = None,
) -> AsFlown:  # fmt: skip
    """What a flight inspected and saw of a surface, and how it differs from its plan.

    The plan's viewpoints are at moments `viewpoint_s` (K,) of it, s. The clearance of the path as it was
    `logged` counts as well. Photos were taken at `photo_s` (F,), s, by the log's clock from its first pose;
    without them the camera is taken to see all the time. The plan's camera is `planned_with`, else the
    flight's own; its settings' `rule` says when a look is sharp and frontal.
    """
    flown = aligned.flown
    near = aligned.on_plan
    passed = _passed(viewpoint_s, aligned)
    planned_s, rule = None if photo_s is None else viewpoint_s, rule or InspectionSettings()
    goal = planned_looks(plan, surface, planned_with or camera, scene, rule, planned_s)
    if aligned.corrected:
        goal = replace(goal, rim_deg=CORRECTED_RIM_DEG)
    how = surface, camera, scene, photo_s, passed, (), goal
    looks = looks_of(flown, *how)
    if aligned.corrected:
        looks = certain_looks(looks, looks_of(logged, *how))
    covered = np.sort(aligned.planned_s[near])
    share = _flown_share(plan, covered, silence_s(flown))
    unphotographed, photos = 0, "no photo times are known: the camera counts as recording all the time"
    if photo_s is not None:
        bare_s, count = without_photo(viewpoint_s, aligned, photo_s)
        lost = views_from(interpolate(plan, bare_s), surface.at(~looks.seen), camera, scene).seen
        unphotographed = int(lost.any(axis=1).sum())
        text = f"{unphotographed} of {count} viewpoints show surface that no photo shows"
        photos = text if unphotographed else ""
    beside = logged.positions[near] - projected(plan, logged.positions[near], aligned.planned_s[near]).place
    return AsFlown(
        looks=looks,
        flown_pct=share,
        clearance_m=_clearance(scene, aligned, logged),
        silent_s=float(sum(length for _, length in silences(flown))),
        cross_track_p95_m=float(np.percentile(np.linalg.norm(beside, axis=1), 95)),
        frechet_m=_frechet(plan, flown, near, covered),
        photos_missing=unphotographed,
        findings=(*findings(plan, aligned, share), *filter(None, [photos])),
    )


def _clearance(scene: Scene, aligned: Alignment, logged: Trajectory) -> float:
    """The lesser of both paths, less what the error that is stated may add to how far they lie apart."""
    flown = aligned.flown
    least = flown_clearance(scene, replace(flown, positions=logged.positions))
    moved_m = float(np.linalg.norm(flown.positions - logged.positions, axis=1).max())
    if moved_m:
        least = min(least, flown_clearance(scene, flown))
    return max(least - max(aligned.place_error_m - moved_m, 0.0), 0.0)


def flown_clearance(scene: Scene, flown: Trajectory) -> float:
    """The least distance of a path from the structure, m, while it was recorded.

    Between two poses it may bend away from their chord by an eighth of how it bends around them, which is
    taken off, and as much again for the noise of the poses. What was flown in a silence is not known: its
    chord does not count.
    """
    least = np.inf
    for part in pieces(flown):
        path = flown.positions[part]
        bend = np.zeros(len(path))
        bend[1:-1] = np.linalg.norm(np.diff(path, 2, axis=0), axis=1) / 4
        nearest = path_clearance(scene, path)
        near = scene.distance(path) <= nearest.distance_m + _NEARLY_M
        least = min(least, nearest.certain_m - float(bend[near].max(initial=0.0)))
    return max(float(least), 0.0)


def _passed(viewpoint_s: Floats, aligned: Alignment) -> Floats:
    """The times of the log at which viewpoints of the plan were passed."""
    on = np.flatnonzero(aligned.on_plan)
    if not len(on) or not len(viewpoint_s):
        return np.empty(0)
    gap, at = cKDTree(aligned.planned_s[on, None]).query(viewpoint_s[:, None])
    return recorded(aligned.flown, np.sort(aligned.flown.t_s[on[at[gap <= PASSED_S]]]))


def _flown_share(plan: Trajectory, covered: Floats, silence: float) -> float:
    """Share of the plan's length, %, between moments that some pose corresponds to."""
    along = arc_length(plan.positions)
    if len(covered) < 2 or along[-1] == 0:
        return 0.0
    gaps = np.diff(np.interp(np.clip(covered, plan.t_s[0], plan.t_s[-1]), plan.t_s, along))
    return 100 * float(gaps[np.diff(covered) <= silence].sum() / along[-1])


def _frechet(plan: Trajectory, flown: Trajectory, near: Bools, covered: Floats) -> float:
    if near.sum() < 2:
        return float("nan")
    span = np.linspace(max(covered[0], plan.t_s[0]), min(covered[-1], plan.t_s[-1]), _FRECHET_POSES)
    own = flown.positions[near]
    own = own[chosen_evenly(len(own), _FRECHET_POSES)]
    return frechet(interpolate(plan, span).positions, own, 1e-4)


def findings(plan: Trajectory, aligned: Alignment, flown_pct: float) -> tuple[str, ...]:
    """What was done to a log so that it lies on its plan, and what is odd about the flight."""
    of_flight = (*_missing(plan, aligned, flown_pct), *_aside(plan, aligned), *_stuck(plan, aligned))
    return (*_corrected(aligned), *of_flight)


def without_photo(viewpoint_s: Floats, aligned: Alignment, photo_s: Floats) -> tuple[Floats, int]:
    """The moments (K,) of the plan's viewpoints that were passed without a photo, and how many were passed.

    Photos have times by the log's clock, from its first pose.
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
        yield f"{SILENT} for {length:.0f} s at {when:.0f} s: views and clearance are unknown for that time"


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
        when, length = beats[start], float(beats[min(end, len(beats) - 1)] - beats[start])
        if length >= _STUCK_S and turned > _TURNED_DEG:
            yield f"{STOOD} for {length:.0f} s at {when:.0f} s; its plan turned {turned:.0f} deg"


def _angle_deg(cosine: Floats) -> Floats:
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _near(moments: Floats, others: Floats, reach_s: float = _PHOTO_S) -> Bools:
    """Which moments (K,) have another within reach."""
    if not len(others) or not len(moments):
        return np.zeros(len(moments), bool)
    return np.asarray(cKDTree(others[:, None]).query(moments[:, None])[0] <= reach_s, bool)
