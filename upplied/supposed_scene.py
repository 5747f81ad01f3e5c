"""A scene to which surface is added that nobody scanned, but that is supposed to be there."""

from __future__ import annotations

import numpy as np

from upplied.records import Bools, Floats, Ints
from upplied.scene import Scene

_ROUNDING_M = 1e-3  # beyond what single precision may be off


class SupposedScene(Scene):
    """What a scene answers where more surface is supposed: rays are blocked by it, distances are from it.

    `cast` and `hits` tell of the triangles that are known alone.

    Parameters
    ----------
    known : Scene
    vertices : array, shape (V, 3), m
        Of the surface that is supposed.
    triangles : array, shape (T, 3)
    error_m : float
        How much nearer that surface may be.
    """

    def __init__(self, known: Scene, vertices: Floats, triangles: Ints, error_m: float) -> None:
        self.known, self.supposed = known, Scene(vertices, triangles, known.threads, error_m=error_m)
        self.box, self.origin, self.threads = known.box, known.origin, known.threads
        self.grain_m, self.error_m, self._scene = known.grain_m, known.error_m, known._scene
        self._shift = np.asarray(known.origin - self.supposed.origin, np.float32)

    def blocked(self, rays: np.ndarray, slack: float = 1e-3) -> Bools:
        """As of a `Scene`, by either surface."""
        found = self.known.blocked(rays, slack)
        free = np.flatnonzero(~found)
        local = rays[free]
        local[:, :3] += self._shift
        found[free] = self.supposed.blocked(local, slack)
        return found

    def distance(self, points: Floats) -> Floats:
        """As of a `Scene`, from the nearer surface."""
        points = np.reshape(points, (-1, 3))
        away = self.known.distance(points)
        asked = self._may_be_within(points, away)
        away[asked] = np.minimum(away[asked], self.supposed.distance(points[asked]))
        return away

    def closest(self, points: Floats) -> tuple[Floats, Ints]:
        """As of a `Scene`, on the nearer surface; triangle -1 where that is supposed."""
        points = np.reshape(points, (-1, 3))
        places, triangle = self.known.closest(points)
        away = np.linalg.norm(places - points, axis=1)
        asked = self._may_be_within(points, away)
        others, _ = self.supposed.closest(points[asked])
        nearer = np.linalg.norm(others - points[asked], axis=1) < away[asked]
        places[asked[nearer]], triangle[asked[nearer]] = others[nearer], -1
        return places, triangle

    def _may_be_within(self, points: Floats, reach_m: Floats) -> Ints:
        """Which points (N, 3) lie so near to the box of what is supposed that it may be within reach (N,)."""
        low, high = self.supposed.box
        gap = np.maximum(np.maximum(low - points, points - high), 0.0)
        least = np.linalg.norm(gap, axis=1) - self.supposed.error_m - _ROUNDING_M
        return np.flatnonzero(least < reach_m)
