"""The score by which the CARIC challenge compares inspections: sight times sharpness times resolution.

Written from the published formula: each picture of each interest point is worth
``q_seen * q_blur * q_res``, nothing below a fifth; a point is worth its best picture, a flight the sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.geometry.poses import matrices
from upplied.geometry.scene import Scene
from upplied.overlap import Frames
from upplied.records import Camera, Cloud, Floats, Trajectory

_LEAST = 0.2  # below it a picture is worth nothing


@dataclass(frozen=True)
class ScoredCamera:
    """A camera as the challenge describes it; the defaults are those of its pages."""

    hfov_deg: float = 80.0
    vfov_deg: float = 60.0
    focal_mm: float = 16.0
    pixel_mm: float = 4.35e-3
    exposure_s: float = 1e-3
    range_m: float = 1e3  # no limit is published


def picture_score(
    taken: Trajectory,
    velocity: Floats,
    turn: Floats,
    cloud: Cloud,
    scene: Scene,
    desired_mm: float,
    camera: ScoredCamera | None = None,
) -> Floats:
    """The worth of each interest point, 0 to 1; their sum is the score of a flight.

    Parameters
    ----------
    taken : Trajectory
        K poses, one a picture.
    velocity, turn : array, shape (K, 3)
        m/s, and rad/s in the structure frame.
    cloud : Cloud
        N interest points with normals.
    scene : Scene
    desired_mm : float
        Millimetres a pixel that are enough.
    camera : ScoredCamera, optional

    Returns
    -------
    array, shape (N,)
    """
    lens = camera or ScoredCamera()
    frames = Frames(taken, Camera(lens.hfov_deg, lens.vfov_deg, 0.0, lens.range_m), scene)
    best = np.zeros(len(cloud))
    axes = matrices(taken.quat_xyzw)
    for at in range(len(taken)):
        seen = np.flatnonzero(frames.shows(at, cloud.points))
        if not len(seen):
            continue
        ray = cloud.points[seen] - taken.positions[at]
        local = ray @ axes[at]
        moving = -(velocity[at] + np.cross(turn[at], ray)) @ axes[at]
        sharp = _sharpness(local, moving, lens)
        fine = desired_mm / np.maximum(_millimetres(local, cloud.outward[seen] @ axes[at], lens), 1e-9)
        worth = sharp * np.minimum(fine, 1.0)
        best[seen] = np.maximum(best[seen], np.where(worth >= _LEAST, worth, 0.0))
    return best


def _sharpness(local: Floats, moving: Floats, lens: ScoredCamera) -> Floats:
    """q_blur (N,): a pixel over the larger of the motions across and up during the exposure, at most 1."""
    after = local + moving * lens.exposure_s
    moved = lens.focal_mm * np.abs(after[:, 1:] / after[:, :1] - local[:, 1:] / local[:, :1]).max(axis=1)
    return np.minimum(lens.pixel_mm / np.maximum(moved, 1e-12), 1.0)


def _millimetres(local: Floats, normal: Floats, lens: ScoredCamera) -> Floats:
    """The larger of the millimetres a pixel (N,) where the tangent plane cuts the camera's two planes.

    On the line in which the tangent plane meets the horizontal (vertical) plane of the camera, a step of a
    pixel in the picture is a step of this length on the surface.
    """
    pixel = lens.pixel_mm / lens.focal_mm
    sizes = []
    for axis in (1, 2):  # to the left with no step up, and up with no step to the left
        line = np.zeros_like(local)  # of the tangent plane
        line[:, 0], line[:, axis] = normal[:, axis], -normal[:, 0]
        length = np.linalg.norm(line, axis=1)
        u = local[:, axis] / local[:, 0]
        # d(u)/d(s) along the line, per metre of it.
        rate = np.abs(line[:, axis] - u * line[:, 0]) / np.maximum(length * local[:, 0], 1e-12)
        sizes.append(np.where(length > 1e-9, 1e3 * pixel / np.maximum(rate, 1e-12), np.inf))
    return np.maximum(*sizes)
