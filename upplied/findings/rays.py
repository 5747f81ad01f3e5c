"""Pixels of a photo as rays, and points as pixels: the pinhole of a camera's field of view.

Pixels are counted from the upper left corner of the picture, x to the right and y down, so that its middle is
(width / 2, height / 2). A field of view above 120 degrees has no picture plane: its angles grow evenly.
"""

from __future__ import annotations

import math

import numpy as np

from upplied.config import InspectionSettings, focal_px
from upplied.poses import matrices
from upplied.records import Camera, Floats

_FLAT_DEG = 120.0
_USUAL_PX = InspectionSettings().width_px  # where a camera's pixels are not known


def size_px(camera: Camera) -> tuple[int, int]:
    """Width and height of the camera's photos, px; the usual width where it is not known."""
    if camera.width_px and camera.height_px:
        return camera.width_px, camera.height_px
    across, down = (
        math.tan(math.radians(min(angle, 150.0)) / 2) for angle in (camera.hfov_deg, camera.vfov_deg)
    )
    return _USUAL_PX, max(1, round(_USUAL_PX * down / across))


def focal_of(camera: Camera) -> tuple[float, float]:
    """Pixels per radian in the middle of the photo, across and down."""
    width, height = size_px(camera)
    return focal_px(width, camera.hfov_deg), focal_px(height, camera.vfov_deg)


def rays_of(camera: Camera, pixels: Floats) -> Floats:
    """Unit directions (..., 3), camera frame, of pixels (..., 2)."""
    size, focal = np.array(size_px(camera), float), np.array(focal_of(camera))
    off = (np.asarray(pixels, float) - size / 2) / focal
    if camera.hfov_deg > _FLAT_DEG:
        up = np.cos(off[..., 1])
        return np.stack([up * np.cos(off[..., 0]), -up * np.sin(off[..., 0]), -np.sin(off[..., 1])], axis=-1)
    ray = np.stack([np.ones(off.shape[:-1]), -off[..., 0], -off[..., 1]], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def pixels_of(camera: Camera, position: Floats, quat_xyzw: Floats, points: Floats) -> Floats:
    """Pixels (N, 2) of points (N, 3), m, in a photo from a pose; NaN of what is behind the camera."""
    ahead, left, up = ((points - position) @ matrices(quat_xyzw)).T
    size, focal = np.array(size_px(camera), float), np.array(focal_of(camera))
    with np.errstate(divide="ignore", invalid="ignore"):
        if camera.hfov_deg > _FLAT_DEG:
            off = np.column_stack([np.arctan2(-left, ahead), -np.arctan2(up, np.hypot(ahead, left))])
        else:
            off = np.where(ahead[:, None] > 0, np.column_stack([-left, -up]) / ahead[:, None], np.nan)
    return np.asarray(size / 2 + off * focal)


def footprint_m(camera: Camera, position: Floats, place: Floats, normal: Floats) -> float:
    """Longer side of what a pixel in the picture's middle covers of the surface at a place, m."""
    ray = place - position
    distance = float(np.linalg.norm(ray))
    return distance / max(abs(float(ray @ normal)) / distance, 1e-6) / focal_of(camera)[0]
