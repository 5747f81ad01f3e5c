"""The result of a flight: what it inspected as planned and saw (`looks`), and its deviation from the plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.config import InspectionSettings
from upplied.geometry.polylines import arc_length, chosen_evenly
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.geometry.frechet import frechet
from upplied.proof.align import Alignment, silence_s, silences
from upplied.proof.findings import PASSED_S, findings, without_photo
from upplied.proof.inspected import CORRECTED_RIM_DEG, planned_looks, views_from
from upplied.proof.looks import Looks, certain_looks, looks_of, pieces, recorded
from upplied.proof.matching import projected
from upplied.records import Bools, Camera, Cloud, Floats, Record, Trajectory

_NEARLY_M = 0.5  # beyond the nearest pose: there the path may bend nearer still
_FRECHET_POSES = 800  # of each path


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
    plan: Trajectory,
    viewpoint_s: Floats,
    aligned: Alignment,
    logged: Trajectory,
    surface: Cloud,
    camera: Camera,
    scene: Scene,
    photo_s: Floats | None = None,
    planned_with: Camera | None = None,
    rule: InspectionSettings | None = None,
) -> AsFlown:
    """What a flight inspected and saw of a surface, and how it differs from its plan.

    Parameters
    ----------
    plan : Trajectory
    viewpoint_s : array, shape (K,), s
        Moments of the plan's viewpoints.
    aligned : Alignment
        Of the log on the plan.
    logged : Trajectory
        The path as it was logged; its clearance counts as well.
    surface : Cloud
        N samples with normals.
    camera : Camera
    scene : Scene
    photo_s : array, shape (F,), s, optional
        Times of the photos, by the log's clock from its first pose; without them the camera is taken to
        see all the time.
    planned_with : Camera, optional
        Of the plan; else the flight's own.
    rule : InspectionSettings, optional
        When a look is sharp and frontal, as the plan's settings have it.
    """
    flown = aligned.flown
    near = aligned.on_plan
    passed = _passed(viewpoint_s, aligned)
    planned_photos = None if photo_s is None else viewpoint_s
    wanted = planned_looks(
        plan, surface, planned_with or camera, scene, rule or InspectionSettings(), planned_photos
    )
    if aligned.corrected:
        wanted = replace(wanted, rim_deg=CORRECTED_RIM_DEG)
    looks = looks_of(flown, surface, camera, scene, photo_s, passed, wanted=wanted)
    if aligned.corrected:
        looks = certain_looks(looks, looks_of(logged, surface, camera, scene, photo_s, passed, wanted=wanted))
    covered = np.sort(aligned.planned_s[near])
    share = _flown_share(plan, covered, silence_s(flown))
    unphotographed, photos = 0, "no photo times are known: the camera counts as recording all the time"
    if photo_s is not None:
        bare_s, count = without_photo(viewpoint_s, aligned, photo_s)
        lost = views_from(interpolate(plan, bare_s), surface.at(~looks.seen), camera, scene).seen
        unphotographed = int(lost.any(axis=1).sum())
        text = f"{unphotographed} of {count} viewpoints show surface that no photo shows"
        photos = text if unphotographed else ""
    return AsFlown(
        looks=looks,
        flown_pct=share,
        clearance_m=_clearance(scene, aligned, logged),
        silent_s=float(sum(length for _, length in silences(flown))),
        cross_track_p95_m=_cross_track(plan, logged, aligned),
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
    ends = np.interp(np.clip(covered, plan.t_s[0], plan.t_s[-1]), plan.t_s, along)
    gaps = np.diff(ends)
    return 100 * float(gaps[np.diff(covered) <= silence].sum() / along[-1])


def _cross_track(plan: Trajectory, logged: Trajectory, aligned: Alignment) -> float:
    """95th percentile of the distance of the log as it came from the planned path, m."""
    on = aligned.on_plan
    place = projected(plan, logged.positions[on], aligned.planned_s[on]).place
    return float(np.percentile(np.linalg.norm(logged.positions[on] - place, axis=1), 95))


def _frechet(plan: Trajectory, flown: Trajectory, near: Bools, covered: Floats) -> float:
    if near.sum() < 2:
        return float("nan")
    span = np.linspace(max(covered[0], plan.t_s[0]), min(covered[-1], plan.t_s[-1]), _FRECHET_POSES)
    own = flown.positions[near]
    own = own[chosen_evenly(len(own), _FRECHET_POSES)]
    return frechet(interpolate(plan, span).positions, own, 1e-4)
