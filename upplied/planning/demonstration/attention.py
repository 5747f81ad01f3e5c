"""What surface a demonstration inspected: a weight from 0 to 1 for every sample of it.

Most of what a flight sees it does not mean: behind an engine stand wing and fuselage, near enough to be
sharp. What tells a subject from its background is how completely its part of the skin was gazed at.

1. Parts: where the skin continues (`surface.skin`).
2. Depth of the subject, pose by pose: where the middle of the picture rests.
3. Gaze: the time for which the middle of the picture rested on a sample at the subject's depth, sharply.
4. Completeness of a part: the mean gaze of all its outside samples, over the flight's own.
5. Weight: whether the sample was shown, times how complete its part is.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.config import InspectionSettings
from upplied.geometry.poses import matrices
from upplied.planning.constants import FOVEA, MAJORITY
from upplied.planning.surface.skin import middle_of
from upplied.planning.visibility.observations import Moments, Views, moments, motion_of, sight_to, stations_at
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

_NEAREST = 0.3  # quantile of the depth in the gaze, that is the subject's
_DEPTH = 1.3  # of the subject's depth, up to which a sample or a pose belongs to it: a round body's front
_SOFTENED = 0.1  # to each side of the majority, over which a stretch comes to count: no sample decides
_GAZE_S, _SHOWN_S = 4.0, 1.0  # of gaze, of being shown, after which the weight is 63 %
_CREEP_MPS = 0.1  # that a hovering pose counts as: hovering shows nothing new
_USUAL = 0.95
_LEAST_MOTION, _MOTION_STEP, _MOTION_BINS = 1e-4, 0.02, 600  # rad/s, of its logarithm: up to 16 rad/s


@dataclass(frozen=True, eq=False, repr=False)
class Attention(Record):
    """How much the expert's inspection was about each surface sample."""

    weight: Floats  # (N,) 0 to 1
    part: Ints  # (N,) the stretch of the skin, by the middle one of its divisions
    subject_m: float  # depth at which the flight saw its subject; NaN where it saw nothing
    motion_radps: float = 0.0  # 95th percentile of the motion of its pictures there: the expert's own blur
    incidence_deg: float = 0.0  # 95th percentile of the incidence of its looks


def attention(
    flight: Trajectory,
    breaks: Ints,
    camera: Camera,
    cloud: Cloud,
    shown: Views,
    stretch: Ints,
    settings: InspectionSettings,
    zone: Bools | None = None,
) -> Attention:
    """Weight each surface sample by how much the flight was about it.

    Parameters
    ----------
    flight : Trajectory
        As logged, source frame.
    breaks : array of int
        First pose after each gap in the log.
    cloud : Cloud
        N surface samples of the source with normals and areas.
    shown : Views
        What the flight truly sees of them, in the same time.
    stretch : array of int, shape (J, N)
        The stretch of the skin that each lies on, by several divisions of it (`surface.skin`). A sample of
        which they do not agree is meant by the share of them that mean it.
    zone : array of bool, shape (N,), optional
        What the user says that the flight was about (`inspection.zone_of`): of that, all that it
        shows counts, and of nothing else.
    """
    steps = moments(flight, breaks)
    number, area, part = len(cloud), cloud.areas, middle_of(stretch)
    rows = np.ascontiguousarray(shown.seen[stations_at(shown, steps)])
    positions, points = (np.ascontiguousarray(of) for of in (steps.poses.positions, cloud.points))
    facing = np.ascontiguousarray(cloud.outward * (1.0 if cloud.area_m2 is None else cloud.area_m2[:, None]))
    arguments = positions, np.ascontiguousarray(matrices(steps.poses.quat_xyzw)), points, facing, rows
    moving = [np.ascontiguousarray(of) for of in (steps.step_s, steps.velocity, steps.turn)]
    depth = _depths(*arguments, FOVEA, _NEAREST)
    known = np.isfinite(depth)
    if not known.any():
        return Attention(np.zeros(number), part, float("nan"))
    subject = _subject(steps, depth, known)
    limit = np.full(len(depth), np.inf)
    if zone is None:
        limit = np.where(known & (depth <= _DEPTH * subject), _DEPTH * depth, 0.0)
    optics = camera.width_px, camera.exposure_s
    sharp = np.full(len(steps), settings.sharp_radps(camera.hfov_deg, *optics))
    if steps.poses.fov_deg is not None:
        sharp = np.array([settings.sharp_radps(float(angle), *optics) for angle in steps.poses.fov_deg[:, 0]])
    gaze, time = _gazed(*arguments, limit, *moving, sharp, FOVEA)
    gazed, seen = 1 - np.exp(-gaze / _GAZE_S), 1 - np.exp(-time / _SHOWN_S)
    whole = float((area * gazed).sum())
    if whole <= 0:
        return Attention(np.zeros(number), part, subject)
    subject_share = zone.astype(float) if zone is not None else _completeness(stretch, area * gazed, area)
    weight = subject_share * seen
    looks = _histograms(positions, points, facing / area[:, None], rows, *moving, weight * area)
    if looks[0].sum() <= 0:
        return Attention(weight, part, subject)
    at = [float(np.searchsorted(np.cumsum(of), _USUAL * of.sum())) for of in looks]
    motion = float(_LEAST_MOTION * np.exp((at[0] + 1) * _MOTION_STEP))
    return Attention(weight, part, subject, motion, (at[1] + 1) * 0.5)


def _completeness(stretch: Ints, gazed: Floats, area: Floats) -> Floats:
    """How much (N,) the flight was about each sample by how completely its stretch was gazed at."""
    # The mean over the divisions (J, N) of the skin; of a stretch that is as complete as the flight's own
    # all.
    whole = np.zeros(len(area))
    for part in stretch:
        complete = np.bincount(part, gazed) / np.maximum(np.bincount(part, area), 1e-300)
        complete /= float(gazed @ complete[part]) / float(gazed.sum())
        share = np.clip((complete - MAJORITY) / (2 * _SOFTENED) + 0.5, 0, 1)
        whole += (share**2 * (3 - 2 * share))[part] / len(stretch)
    return whole


@njit(cache=True)
def _histograms(
    positions: Floats,
    points: Floats,
    normals: Floats,
    seen: Bools,
    step_s: Floats,
    velocity: Floats,
    turn: Floats,
    weight: Floats,
) -> tuple[Floats, Floats]:
    motion, incidence = np.zeros(_MOTION_BINS), np.zeros(180)
    ray = np.empty(3)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if not seen[pose, index] or weight[index] <= 0:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            moved = motion_of(ray, distance, velocity[pose], turn[pose])
            place = int(np.log(max(moved, 1e-12) / _LEAST_MOTION) / _MOTION_STEP)
            motion[min(max(place, 0), _MOTION_BINS - 1)] += weight[index] * step_s[pose]
            angle = np.degrees(np.arccos(min(max(cosine, 0.0), 1.0)))
            incidence[min(int(2 * angle), 179)] += weight[index] * step_s[pose]
    return motion, incidence


def _subject(steps: Moments, depth: Floats, known: Bools) -> float:
    """Depth of the flight's subject, m: the median over the way flown, in pictures' widths."""
    way = np.linalg.norm(steps.velocity, axis=1) * steps.step_s + _CREEP_MPS * steps.step_s
    values, weights = depth[known], (way / np.where(known, depth, 1.0) ** 2)[known]
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


@njit(cache=True)
def _depths(
    positions: Floats, axes: Floats, points: Floats, areas: Floats, seen: Bools, fovea: float, nearest: float
) -> Floats:
    """Depth of the subject in each picture (K,), m; inf where the picture shows nothing."""
    depths = np.full(len(positions), np.inf)
    place, weight = np.empty(len(points)), np.empty(len(points))
    for pose in range(len(positions)):
        count, whole = 0, 0.0
        for index in range(len(points)):
            if not seen[pose, index]:
                continue
            x, y, z, across, up, squared = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            facing = 0.0
            for axis in range(3):
                ray = points[index, axis] - positions[pose, axis]
                x += axes[pose, axis, 0] * ray
                across += axes[pose, axis, 1] * ray
                up += axes[pose, axis, 2] * ray
                squared += ray * ray
                facing -= areas[index, axis] * ray
            y, z = across / max(x, 1e-9), up / max(x, 1e-9)
            distance = np.sqrt(squared)
            if x <= 0 or facing <= 0:
                continue
            place[count] = x
            weight[count] = np.exp(-(y * y + z * z) / (2 * fovea * fovea)) * facing / (squared * distance)
            whole += weight[count]
            count += 1
        if whole <= 0:
            continue
        share = 0.0
        for index in np.argsort(place[:count]):
            share += weight[index]
            if share >= nearest * whole:
                depths[pose] = place[index]
                break
    return depths


@njit(cache=True)
def _gazed(
    positions: Floats,
    axes: Floats,
    points: Floats,
    areas: Floats,
    seen: Bools,
    limit: Floats,
    step_s: Floats,
    velocity: Floats,
    turn: Floats,
    sharp: Floats,
    fovea: float,
) -> tuple[Floats, Floats]:
    """Seconds for which each sample (N,) was gazed at, and shown, sharply and at the subject's depth."""
    gaze, time = np.zeros(len(points)), np.zeros(len(points))
    ray = np.empty(3)
    for pose in range(len(positions)):
        if limit[pose] <= 0:
            continue
        for index in range(len(points)):
            if not seen[pose, index]:
                continue
            x, across, up, squared = 0.0, 0.0, 0.0, 0.0
            for axis in range(3):
                ray[axis] = points[index, axis] - positions[pose, axis]
                x += axes[pose, axis, 0] * ray[axis]
                across += axes[pose, axis, 1] * ray[axis]
                up += axes[pose, axis, 2] * ray[axis]
                squared += ray[axis] * ray[axis]
            if x <= 0 or x > limit[pose]:
                continue
            moved = motion_of(ray, np.sqrt(squared), velocity[pose], turn[pose])
            weight_s = step_s[pose] * min(1.0, sharp[pose] / max(moved, 1e-12))
            y, z = across / x, up / x
            gaze[index] += weight_s * np.exp(-(y * y + z * z) / (2 * fovea * fovea))
            time[index] += weight_s
    return gaze, time
