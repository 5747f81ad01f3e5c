"""Pixels of a photo as rays, and points as pixels: by the calibration of a lens, else as a pinhole.

Pixels are counted from the upper left corner of the picture, x to the right and y down, so that its middle is
(width / 2, height / 2). Without a calibration, a field of view above 120 degrees has no picture plane: its
angles grow evenly. A lens has one of OpenCV's models (Brown and Conrady, or Kannala and Brandt).
"""

import math

import numpy as np

from upplied.config import InspectionSettings, focal_px
from upplied.geometry.poses import matrices
from upplied.records import Camera, Floats, Lens

_FLAT_DEG = 120.0
_ROUNDS = 12  # of Newton's method: more than twice what lenses of 180 degrees need
_USUAL_PX = InspectionSettings().width_px  # where a camera's pixels are not known


def size_px(camera: Camera) -> tuple[int, int]:
    """Width and height of the camera's photos, px; the usual width where it is not known."""
    if camera.width_px and camera.height_px:
        return camera.width_px, camera.height_px
    angles = camera.hfov_deg, camera.vfov_deg
    across, down = (math.tan(math.radians(min(angle, 150.0)) / 2) for angle in angles)
    return _USUAL_PX, max(1, round(_USUAL_PX * down / across))


def focal_of(camera: Camera) -> tuple[float, float]:
    """Pixels per radian in the middle of the photo, across and down."""
    width, height = size_px(camera)
    angles, lens = (camera.hfov_deg, camera.vfov_deg), camera.lens
    if lens is None:
        return focal_px(width, angles[0]), focal_px(height, angles[1])
    across, down = (math.radians(angle) for angle in angles)
    if lens.model == "fisheye":
        return width / across, height / down
    return width / 2 / math.tan(across / 2), height / 2 / math.tan(down / 2)


def rays_of(camera: Camera, pixels: Floats) -> Floats:
    """Unit directions (..., 3), camera frame, of pixels (..., 2); NaN where its lens shows nothing."""
    middle, focal, lens = _middle(camera), np.array(focal_of(camera)), camera.lens
    off = (np.asarray(pixels, float) - middle) / focal
    if lens is not None:
        off = _undistorted(lens, off)
    if lens is not None and lens.model == "fisheye":
        angle = np.linalg.norm(off, axis=-1, keepdims=True)
        return np.concatenate([np.cos(angle), -np.sinc(angle / np.pi) * off], axis=-1)
    if lens is None and camera.hfov_deg > _FLAT_DEG:
        up = np.cos(off[..., 1])
        return np.stack([up * np.cos(off[..., 0]), -up * np.sin(off[..., 0]), -np.sin(off[..., 1])], axis=-1)
    ray = np.stack([np.ones(off.shape[:-1]), -off[..., 0], -off[..., 1]], axis=-1)
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def pixels_of(camera: Camera, position: Floats, quat_xyzw: Floats, points: Floats) -> Floats:
    """Pixels (N, 2) of points (N, 3), m, in a photo from a pose; NaN of what its lens does not show."""
    return pixels_towards(camera, (points - position) @ matrices(quat_xyzw))


def pixels_towards(camera: Camera, directions: Floats) -> Floats:
    """Pixels (N, 2) of directions (N, 3), camera frame, of any length; NaN of what its lens does not show."""
    ahead, left, up = directions.T
    lens = camera.lens
    with np.errstate(divide="ignore", invalid="ignore"):
        if lens is not None and lens.model == "fisheye":
            aside = np.hypot(left, up)
            share = np.where(aside > 0, np.arctan2(aside, ahead) / aside, 0.0)
            off = -share[:, None] * np.column_stack([left, up])
        elif lens is None and camera.hfov_deg > _FLAT_DEG:
            off = np.column_stack([np.arctan2(-left, ahead), -np.arctan2(up, np.hypot(ahead, left))])
        else:
            off = np.where(ahead[:, None] > 0, np.column_stack([-left, -up]) / ahead[:, None], np.nan)
    if lens is not None:
        off = np.where(np.hypot(*off.T)[:, None] < _reach(lens), _distorted(lens, off), np.nan)
    return np.asarray(_middle(camera) + off * focal_of(camera))


def widest_rad(camera: Camera) -> float:
    """The largest angle off its axis at which a camera sees; half a turn where its lens leaves that open."""
    share = np.linspace(0, 1, 33)
    sides = [np.column_stack([share, 0 * share + end]) for end in (0, 1)]
    border = np.concatenate([*sides, *(side[:, ::-1] for side in sides)]) * size_px(camera)
    ahead = rays_of(camera, border)[:, 0]
    return float(np.arccos(ahead.min())) if np.isfinite(ahead).all() else math.pi


def footprint_m(camera: Camera, position: Floats, place: Floats, normal: Floats) -> float:
    """Longer side of what a pixel in the picture's middle covers of the surface at a place, m."""
    ray = place - position
    distance = float(np.linalg.norm(ray))
    return distance / max(abs(float(ray @ normal)) / distance, 1e-6) / focal_of(camera)[0]


def _middle(camera: Camera) -> Floats:
    """Where the axis meets the picture (2,), px."""
    share = (0.5, 0.5) if camera.lens is None else camera.lens.middle
    return np.array(size_px(camera), float) * share


def _distorted(lens: Lens, off: Floats) -> Floats:
    """Where a lens shows what a pinhole, or an even fisheye, would show at (..., 2), focal lengths."""
    square = (off**2).sum(axis=-1, keepdims=True)
    if lens.model == "fisheye":
        return np.asarray(off * np.polyval([*lens.coefficients[::-1], 1.0], square))
    k1, k2, p1, p2, k3, *below = (*lens.coefficients, *(0.0,) * 8)[:8]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.polyval([k3, k2, k1, 1.0], square) / np.polyval([*below[::-1], 1.0], square)
    aside = 2 * off[..., :1] * off[..., 1:] * np.array([p1, p2])
    return np.asarray(off * ratio + aside + np.array([p2, p1]) * (square + 2 * off**2))


def _undistorted(lens: Lens, shown: Floats) -> Floats:
    """The inverse, by Newton's method; NaN where the lens shows nothing."""
    off, reach = shown.copy(), _reach(lens)
    for _ in range(_ROUNDS):
        ends = ([_distorted(lens, off + end * step) for end in (1, -1)] for step in 1e-6 * np.eye(2))
        (a, c), (b, d) = (np.moveaxis((high - low) / 2e-6, -1, 0) for high, low in ends)
        x, y = np.moveaxis(shown - _distorted(lens, off), -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            off = off + np.stack([d * x - b * y, a * y - c * x], axis=-1) / (a * d - b * c)[..., None]
            off = off * np.minimum(1.0, reach / np.linalg.norm(off, axis=-1, keepdims=True))
        off = np.nan_to_num(off)
    right = np.abs(_distorted(lens, off) - shown).max(axis=-1, keepdims=True) < 1e-7
    return np.where(right, off, np.nan)


def _reach(lens: Lens) -> float:
    """How far from the axis a lens shows farther things farther off: beyond, its model folds the picture."""
    far = np.linspace(0, np.pi if lens.model == "fisheye" else 8.0, 4001)
    shown = _distorted(lens, np.column_stack([far, 0 * far]))[:, 0]
    return float(far[np.append(np.diff(shown) > 0, False).argmin()])
