"""How finely, frontally and sharply a flight pictures each patch of a surface: one judgement for every look.

The ground sample distance is the longer side of what one pixel covers of the patch: distance times the
angle of the picture's middle pixel, over the cosine of the incidence. Towards the edge of a flat picture
pixels cover less; that is not counted, since it would reward looking past a subject.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.planning.visibility.moments import Moments, motion_of, sight_to
from upplied.planning.visibility.observations import Views, stations_at
from upplied.poses import matrices
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Rows

_FLAT_DEG = 120.0  # of a field of view, beyond which a picture's angle grows evenly (`config.focal_px`)


@dataclass(frozen=True, eq=False, repr=False)
class Pictures(Rows):
    """The finest sharp look at each of N patches; NaN, and an infinite sample, where there is none."""

    sampled_m: Floats  # (N,) times the angle of a pixel in the picture's middle: what a pixel covers
    depth_m: Floats  # (N,) along the optical axis
    cosine: Floats  # (N,) of the incidence
    moved: Floats  # (N,) 1/s: times the focal length in pixels, the speed across the picture
    defocus: Floats  # (N,) times the focal length in pixels, the blur of what is out of focus; 0 unknown
    pose: Ints  # (N,) step at which it is; -1
    looks: Ints  # (N,) how many looks are as fine as asked, sharp and frontal


def pictures(
    steps: Moments,
    shown: Views,
    cloud: Cloud,
    camera: Camera,
    sharp_radps: float,
    least_cosine: float,
    asked_m: Floats | None = None,
) -> Pictures:
    """The finest sharp look of a flight at each sample of a surface, and how many do what is asked.

    Parameters
    ----------
    steps : Moments
    shown : Views
        What the flight truly sees of the samples, in the same time.
    cloud : Cloud
        N samples with normals.
    camera : Camera
    sharp_radps : float
        Largest motion in the picture.
    least_cosine : float
        Of the incidence.
    asked_m : array, shape (N,), optional
        The largest `sampled_m` that a look may have to count; any, where not given.
    """
    station = stations_at(shown, steps)
    seen = np.ascontiguousarray(shown.seen[station])
    positions = np.ascontiguousarray(steps.poses.positions)
    axes = np.ascontiguousarray(matrices(steps.poses.quat_xyzw)[:, :, 0])
    points, normals = np.ascontiguousarray(cloud.points), np.ascontiguousarray(cloud.outward)
    asked = np.full(len(points), np.inf) if asked_m is None else np.ascontiguousarray(asked_m)
    sampled, depth, cosine, moved, pose, looks = _pictured(
        *(positions, axes, np.ascontiguousarray(steps.velocity), np.ascontiguousarray(steps.turn)),
        *(seen, np.ascontiguousarray(shown.coarseness[station]), points, normals),
        *(sharp_radps, least_cosine, camera.hfov_deg <= _FLAT_DEG, asked),
    )
    defocus = _defocus(camera, positions, axes, seen, points, depth, pose)
    return Pictures(sampled, depth, cosine, moved, defocus, pose, looks)


def _defocus(
    camera: Camera, positions: Floats, axes: Floats, seen: Bools, points: Floats, depth: Floats, pose: Ints
) -> Floats:
    """Diameter of the blur, over the focal length, of what lies off the distance that is in focus (N,).

    A camera is taken to focus on the median depth of what it sees. Thin lens: f |z - s| / (N z (s - f)).
    """
    if not (camera.focal_mm and camera.f_number):
        return np.zeros(len(points))
    focal_m = camera.focal_mm * 1e-3
    focus = np.full(len(positions), np.nan)
    for at in np.unique(pose[pose >= 0]):
        focus[at] = np.median((points[seen[at]] - positions[at]) @ axes[at])
    focus = np.maximum(focus, max(camera.focus_m, 2 * focal_m))[np.maximum(pose, 0)]
    blur = focal_m * np.abs(depth - focus) / (camera.f_number * depth * (focus - focal_m))
    return np.where(pose >= 0, blur, np.nan)


def sampled_m(distance: Floats, cosine: Floats) -> Floats:
    """`Pictures.sampled_m` of looks from a distance, m, by the cosine of the incidence; inf from behind."""
    return np.where(cosine > 1e-6, distance / np.maximum(cosine, 1e-6), np.inf)


@njit(cache=True)
def _pictured(
    positions: Floats,
    axes: Floats,
    velocity: Floats,
    turn: Floats,
    seen: Bools,
    coarse: Floats,
    points: Floats,
    normals: Floats,
    sharp: float,
    least_cosine: float,
    flat: bool,
    asked: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Ints, Ints]:  # pragma: no cover - compiled
    number = len(points)
    sampled, depth, frontal = np.full(number, np.inf), np.full(number, np.nan), np.full(number, np.nan)
    moved, best, looks = np.full(number, np.nan), np.full(number, -1), np.zeros(number, np.int64)
    ray, swept = np.empty(3), np.empty(3)
    for pose in range(len(positions)):
        axis, v, w = axes[pose], velocity[pose], turn[pose]
        for index in range(number):
            if not seen[pose, index]:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            if cosine < max(least_cosine, 1e-6):
                continue
            speed = motion_of(ray, distance, v, w)
            if speed > sharp:
                continue
            reach, deep = distance / cosine * coarse[pose], distance
            along = (ray[0] * axis[0] + ray[1] * axis[1] + ray[2] * axis[2]) / distance
            if flat and along > 1e-3:
                deep = distance * along
                swept[0] = -(v[0] + w[1] * ray[2] - w[2] * ray[1])
                swept[1] = -(v[1] + w[2] * ray[0] - w[0] * ray[2])
                swept[2] = -(v[2] + w[0] * ray[1] - w[1] * ray[0])
                away = swept[0] * axis[0] + swept[1] * axis[1] + swept[2] * axis[2]
                square = 0.0
                for each in range(3):
                    square += (swept[each] - ray[each] / deep * away) ** 2
                speed = np.sqrt(square) / deep
            looks[index] += reach <= asked[index]
            if reach < sampled[index]:
                sampled[index], depth[index], frontal[index] = reach, deep, cosine
                moved[index], best[index] = speed / coarse[pose], pose
    return sampled, depth, frontal, moved, best, looks
