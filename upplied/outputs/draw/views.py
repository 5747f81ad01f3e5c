"""From where a picture is taken: directions, and frames that map pixels to rays and points to pixels."""

from dataclasses import dataclass

import numpy as np

from upplied.errors import SettingsError
from upplied.records import Floats


@dataclass(frozen=True)
class View:
    """The direction to the eye, seen from the structure; orthographic unless a field of view is given."""

    azimuth_deg: float  # counter-clockwise from +X seen from above
    elevation_deg: float
    fov_deg: float = 0.0  # full angle along the longer side of the picture; 0: orthographic


VIEWS = {
    "three-quarter": View(-52.0, 24.0),
    "other side": View(128.0, 24.0),
    "perspective": View(-52.0, 20.0, 40.0),
    "side": View(-90.0, 0.0),
    "front": View(0.0, 0.0),
    "top": View(-90.0, 90.0),
    "below": View(-52.0, -28.0),
}


def named_view(view: str | View) -> View:
    """The view of that name."""
    if isinstance(view, View):
        return view
    if view not in VIEWS:
        raise SettingsError(f"view {view!r}", "is unknown", f"one of {', '.join(VIEWS)}")
    return VIEWS[view]


def facing(vertices: Floats, positions: Floats) -> View:
    """The three-quarter view from the side on which a path (N, 3) is flown around vertices (V, 3), m."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    aside = (positions.mean(axis=0) - (low + high) / 2) / np.maximum(high - low, 1e-9)
    azimuth = 52.0 if aside[1] > 0.05 else -52.0
    return View(float(np.copysign(180.0, azimuth) - azimuth) if aside[0] < -0.25 else azimuth, 24.0)


@dataclass(frozen=True)
class Frame:
    """A view fitted to its content, for a picture of given size in pixels."""

    width: int
    height: int
    right: Floats  # (3,) unit vectors of the picture, structure frame
    up: Floats
    back: Floats  # towards the eye
    centre: Floats  # (3,) m, shown in the middle of the picture
    metre_px: float  # pixels a metre takes, at the centre
    eye_m: float  # distance from the centre to the eye; inf: orthographic

    def rays(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Origins and unit directions (N, 3) of the rays through picture points, px from the upper left."""
        across = (np.asarray(x, float) - self.width / 2) / self.metre_px
        upward = (self.height / 2 - np.asarray(y, float)) / self.metre_px
        plane = np.empty((len(across), 3))
        for axis in range(3):  # faster than by broadcasting, and the same on any number of threads
            plane[:, axis] = across * self.right[axis] + upward * self.up[axis] + self.centre[axis]
        if np.isinf(self.eye_m):
            far = 10 * max(self.width, self.height) / self.metre_px
            return plane + far * self.back, np.broadcast_to(-self.back, plane.shape)
        eye = self.centre + self.eye_m * self.back
        ray = plane - eye
        return np.broadcast_to(eye, plane.shape), ray / np.linalg.norm(ray, axis=1, keepdims=True)


def fitted(view: View, points: Floats, width: int, height: int, margin: float = 0.06) -> Frame:
    """The frame in which all points (N, 3), m, just appear, with a margin as a share of the picture."""
    axes = _axes(view)
    right, up, back = axes.T
    local = points @ axes
    middle = (local.min(axis=0) + local.max(axis=0)) / 2
    local = local - middle
    room = np.array([width, height]) * (1 - 2 * margin)
    if view.fov_deg <= 0:
        half = np.maximum(np.abs(local[:, :2]).max(axis=0), 1e-6)
        return Frame(width, height, right, up, back, axes @ middle, float((room / 2 / half).min()), np.inf)
    slope = np.tan(np.radians(view.fov_deg) / 2) * room / max(width, height)
    eye = float((np.abs(local[:, :2]) / slope + local[:, 2:]).max()) + 1e-6
    focal_px = max(width, height) / 2 / np.tan(np.radians(view.fov_deg) / 2)
    return Frame(width, height, right, up, back, axes @ middle, focal_px / eye, eye)


def proportion(view: View, points: Floats) -> float:
    """Height over width of the points (N, 3) in the view."""
    wide, high = np.ptp(points @ _axes(view)[:, :2], axis=0)
    return float(high / max(wide, 1e-9))


def _axes(view: View) -> Floats:
    """Columns: right, up and back (towards the eye) of the view, structure frame."""
    azimuth, elevation = np.radians([view.azimuth_deg, view.elevation_deg])
    level = np.cos(elevation)
    back = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(back, right), back], axis=1)
