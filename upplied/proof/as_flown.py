"""What a flight inspected as asked and what it saw, sample by sample, and how far it kept to its plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.config import InspectionSettings
from upplied.planning.airspace.clearance import path_clearance
from upplied.planning.geometry.frechet import frechet
from upplied.planning.visibility.moments import moments
from upplied.planning.visibility.observations import stations
from upplied.polylines import arc_length, chosen_evenly, interpolated
from upplied.poses import in_a_row, interpolate
from upplied.proof.align import Alignment, silence_s, silences
from upplied.proof.findings import PASSED_S, findings, without_photo
from upplied.proof.inspected import PlannedLooks, looks_at, planned_looks, views_from
from upplied.proof.matching import projected
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory
from upplied.scene import Scene

_NEARLY_M = 0.5  # beyond the nearest pose: there the path may bend nearer still
_FRECHET_POSES = 800  # of each path


@dataclass(frozen=True, eq=False, repr=False)
class Looks(Record):
    """How each of N samples of a surface was seen, by the nearest look; NaN where it was not seen.

    Of a log that was corrected, a sample is seen for certain where its path as logged and as corrected both
    see it, and distance, incidence and pictures are those of the lesser look.
    """

    seen: Bools  # (N,) for certain
    distance_m: Floats  # (N,)
    incidence_deg: Floats  # (N,)
    speed_mps: Floats  # (N,) of the camera then
    t_s: Floats  # (N,) of the flight
    pictures: Ints  # (N,) that show it: photos, or viewpoints that were passed where no photos are known
    # Distance and incidence (N,) of the most frontal look: of all, then within each distance asked for.
    frontal: tuple[tuple[Floats, Floats], ...] = ()
    assumed: Bools | None = None  # (N,) seen if the correction of the log is right, and only then
    inspected: Bools | None = None  # (N,) for certain as the plan asks; None: nothing was asked
    inspected_if_corrected: Bools | None = None  # (N,) the same, if the correction of the log is right

    def __len__(self) -> int:
        return len(self.seen)

    @property
    def values(self) -> dict[str, Floats]:
        """What the catalog keeps of them, by name, (N,) each."""
        names = ("distance_m", "incidence_deg", "speed_mps", "t_s")
        distance, incidence = self.frontal[0]
        kept = {name: getattr(self, name) for name in names}
        return kept | {"frontal_distance_m": distance, "frontal_incidence_deg": incidence}


@dataclass(frozen=True, eq=False, repr=False)
class AsFlown(Record):
    """What came of a flight."""

    looks: Looks
    flown_pct: float  # of the plan's length, the share that was flown
    clearance_m: float  # that the path kept for certain while it was recorded, as logged and as corrected
    silent_s: float  # how long nothing is known of it
    cross_track_p95_m: float  # from the planned path, of the poses that belong to it
    frechet_m: float  # between the flown path and the part of the plan that was flown
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
    found : Alignment
        Of the log on the plan.
    logged : Trajectory
        The path as it was logged, of which the clearance is asked as well.
    surface : Cloud
        N samples with normals.
    camera : Camera
    scene : Scene
    photo_s : array, shape (F,), s, optional
        Times of the photos, by the log's clock from its first pose; without them the camera is taken to
        see all the time.
    planned_with : Camera, optional
        That the plan was made for; else the flight's own.
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
    looks = looks_of(flown, surface, camera, scene, photo_s, passed, wanted=wanted)
    if aligned.corrected:
        looks = _certain(looks, looks_of(logged, surface, camera, scene, photo_s, passed, wanted=wanted))
    covered = np.sort(aligned.planned_s[near])
    share = _flown_share(plan, covered, silence_s(flown))
    unphotographed, photos = 0, "no photo times are known: the camera is taken to see all the time"
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
    """The lesser of both paths; where positions were corrected, less what the correction may be off by."""
    flown = aligned.flown
    kept = clearance_kept(scene, replace(flown, positions=logged.positions))
    moved_m = float(np.linalg.norm(flown.positions - logged.positions, axis=1).max())
    if not moved_m:
        return kept
    return max(min(kept, clearance_kept(scene, flown)) - (aligned.place_error_m - moved_m), 0.0)


def clearance_kept(scene: Scene, flown: Trajectory) -> float:
    """The distance from the structure, m, that a path kept while it was recorded.

    Between two poses it may bend away from their chord by an eighth of how it bends around them, which is
    taken off, and as much again for the noise of the poses. What was flown in a silence is not known: its
    chord does not count.
    """
    kept = np.inf
    for part in _pieces(flown):
        path = flown.positions[part]
        bend = np.zeros(len(path))
        bend[1:-1] = np.linalg.norm(np.diff(path, 2, axis=0), axis=1) / 4
        nearest = path_clearance(scene, path)
        near = scene.distance(path) <= nearest.distance_m + _NEARLY_M
        kept = min(kept, nearest.certain_m - float(bend[near].max(initial=0.0)))
    return max(float(kept), 0.0)


def looks_of(
    flown: Trajectory,
    surface: Cloud,
    camera: Camera,
    scene: Scene,
    photo_s: Floats | None = None,
    picture_s: Floats | None = None,
    within_m: Sequence[float] = (),
    wanted: PlannedLooks | None = None,
) -> Looks:
    """How a flight sees each sample of a surface: in view and range, nothing in between, not too obliquely.

    Nothing is seen while the log is silent: a path is not made up there. Where no photos are known, a sample
    counts as shown in a picture at each moment of `picture_s`, and in one picture at least where it is seen.
    The nearest look is not always the most frontal: that one is told too, of all looks and of those within
    each distance of `within_m`. Which of them match the looks of a plan is told where those are `wanted`.
    """
    shown = views_from(_looking(flown, photo_s), surface, camera, scene)
    poses, seen = shown.stations, shown.seen
    pictures = np.asarray(seen.sum(axis=0) if photo_s is not None else seen.any(axis=0), np.int64)
    if photo_s is None and picture_s is not None and len(picture_s):
        passed = views_from(interpolate(flown, picture_s), surface, camera, scene).seen
        pictures = np.asarray(np.maximum(pictures, passed.sum(axis=0)), np.int64)
    where = [np.ascontiguousarray(each) for each in (poses.positions, surface.points, surface.outward)]
    nearest = _best(*where, seen, np.inf, False)
    frontal = [_look(poses, surface, _best(*where, seen, far, True)) for far in (np.inf, *within_m)]
    there: Bools = np.asarray(nearest >= 0, bool)
    near, level = _look(poses, surface, nearest)
    when = np.full(len(there), np.nan)
    when[there] = poses.t_s[nearest[there]]
    pace = np.interp(when, flown.t_s, _speeds(flown))
    inspected = None
    if wanted is not None:
        breaks = np.array([part[0] for part in _pieces(flown)], np.int64)
        steps = moments(flown, breaks) if photo_s is None else looks_at(flown, poses.t_s, breaks)
        inspected = (
            wanted.matched(shown, steps, surface, camera) if len(poses) else np.zeros(len(seen.T), bool)
        )
    return Looks(there, near, level, pace, when, pictures, tuple(frontal), None, inspected)


def _certain(corrected: Looks, logged: Looks) -> Looks:
    """What the path as corrected and the path as logged both see, by the lesser look of the two."""
    both: Bools = np.asarray(corrected.seen & logged.seen, bool)

    def lesser(first: Floats, second: Floats) -> Floats:
        return np.where(both, np.maximum(first, second), first)

    pairs = list(zip(corrected.frontal, logged.frontal, strict=True))
    return replace(
        corrected,
        seen=both,
        assumed=corrected.seen & ~logged.seen,
        inspected_if_corrected=corrected.inspected,
        inspected=None
        if corrected.inspected is None or logged.inspected is None
        else corrected.inspected & logged.inspected,
        distance_m=lesser(corrected.distance_m, logged.distance_m),
        incidence_deg=lesser(corrected.incidence_deg, logged.incidence_deg),
        pictures=np.where(both, np.minimum(corrected.pictures, logged.pictures), corrected.pictures),
        frontal=tuple((lesser(one[0], other[0]), lesser(one[1], other[1])) for one, other in pairs),
    )


def _look(poses: Trajectory, surface: Cloud, pose: Ints) -> tuple[Floats, Floats]:
    """Distance, m, and incidence, deg, (N,) of each sample from its pose; NaN where it has none."""
    there, at = pose >= 0, np.maximum(pose, 0)
    ray = poses.positions[at] - surface.points if len(poses) else np.full((len(surface), 3), np.nan)
    distance = np.linalg.norm(ray, axis=1)
    cosine = (ray * surface.outward).sum(axis=1) / np.maximum(distance, 1e-12)
    incidence = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return np.where(there, distance, np.nan), np.where(there, incidence, np.nan)


def _passed(viewpoint_s: Floats, aligned: Alignment) -> Floats:
    """The times of the log at which viewpoints of the plan were passed."""
    on = np.flatnonzero(aligned.on_plan)
    if not len(on) or not len(viewpoint_s):
        return np.empty(0)
    gap, at = cKDTree(aligned.planned_s[on, None]).query(viewpoint_s[:, None])
    return _recorded(aligned.flown, np.sort(aligned.flown.t_s[on[at[gap <= PASSED_S]]]))


def _looking(flown: Trajectory, photo_s: Floats | None) -> Trajectory:
    """The poses at which the camera sees: of the photos, or closely spaced along all that was recorded."""
    if photo_s is not None:
        inside = photo_s[(photo_s >= flown.t_s[0]) & (photo_s <= flown.t_s[-1])]
        return interpolate(flown, _recorded(flown, np.sort(inside)))
    return in_a_row([stations(flown.take(part)) for part in _pieces(flown)])


def _pieces(flown: Trajectory) -> list[Ints]:
    """The poses between silences."""
    ends = np.flatnonzero(np.diff(flown.t_s) > silence_s(flown)) + 1
    return np.split(np.arange(len(flown)), ends)


def _recorded(flown: Trajectory, moments: Floats) -> Floats:
    """Those of the moments at which the log is not silent."""
    after = np.clip(np.searchsorted(flown.t_s, moments), 1, len(flown) - 1)
    return moments[flown.t_s[after] - flown.t_s[after - 1] <= silence_s(flown)]


@njit(cache=True)
def _best(
    positions: Floats, points: Floats, normals: Floats, seen: Bools, farthest_m: float, frontal: bool
) -> Ints:
    """For each point the pose that sees it from nearest, or most frontally, within a distance; or -1."""
    best, found = np.full(len(points), np.inf), np.full(len(points), -1, np.int64)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if seen[pose, index]:
                gap, along = 0.0, 0.0
                for axis in range(3):
                    ray = positions[pose, axis] - points[index, axis]
                    gap += ray * ray
                    along += ray * normals[index, axis]
                if gap > farthest_m * farthest_m:
                    continue
                cost = -along / np.sqrt(max(gap, 1e-24)) if frontal else gap
                if cost < best[index]:
                    best[index], found[index] = cost, pose
    return found


def _speeds(flown: Trajectory) -> Floats:
    """Speed (N,) at each pose, m/s, over a second around it."""
    half = 0.5
    ahead, behind = (interpolated(flown.t_s + offset, flown.t_s, flown.positions) for offset in (half, -half))
    span = np.minimum(flown.t_s + half, flown.t_s[-1]) - np.maximum(flown.t_s - half, flown.t_s[0])
    return np.asarray(np.linalg.norm(ahead - behind, axis=1) / np.maximum(span, 1e-9))


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
