"""A scene to which surface is added that nobody scanned, but that is supposed to be there."""

from __future__ import annotations

import numpy as np

from upplied.records import Bools, Floats, Ints
from upplied.scene import Scene

_ROUNDING_M = 1e-3  # beyond what single precision may be off


class SupposedScene(Scene):
    """What a scene answers where more surface is supposed: rays are blocked by it, distances are from it.

    Where surface may be as well, distances are from that too, but no ray is blocked. `cast` and `hits` tell
    of the triangles that are known alone.

    Parameters
    ----------
    known : Scene
    supposed : Scene or None
        The surface that is likely to be there; its `error_m` says how much nearer it may be.
    doubtful : Scene or None
        Surface that may be there.
    """

    def __init__(self, known: Scene, supposed: Scene | None, doubtful: Scene | None = None) -> None:
        self.known, self.supposed = known, supposed
        self.more = [each for each in (supposed, doubtful) if each is not None]
        self.box, self.origin, self.threads = known.box, known.origin, known.threads
        self.grain_m, self.error_m, self._scene = known.grain_m, known.error_m, known._scene

    def blocked(self, rays: np.ndarray, slack: float = 1e-3) -> Bools:
        """As of a `Scene`, by what is known or likely."""
        found = self.known.blocked(rays, slack)
        if self.supposed is None:
            return found
        free = np.flatnonzero(~found)
        local = rays[free]
        local[:, :3] += np.asarray(self.known.origin - self.supposed.origin, np.float32)
        found[free] = self.supposed.blocked(local, slack)
        return found

    def distance(self, points: Floats) -> Floats:
        """As of a `Scene`, from the nearest surface."""
        points = np.reshape(points, (-1, 3))
        away = self.known.distance(points)
        for scene in self.more:
            asked = _may_be_within(scene, points, away)
            away[asked] = np.minimum(away[asked], scene.distance(points[asked]))
        return away

    def closest(self, points: Floats) -> tuple[Floats, Ints]:
        """As of a `Scene`, on the nearest surface; triangle -1 where that is not known."""
        points = np.reshape(points, (-1, 3))
        places, triangle = self.known.closest(points)
        away = np.linalg.norm(places - points, axis=1)
        for scene in self.more:
            asked = _may_be_within(scene, points, away)
            others, _ = scene.closest(points[asked])
            other = np.linalg.norm(others - points[asked], axis=1)
            nearer = other < away[asked]
            chosen = asked[nearer]
            places[chosen], triangle[chosen], away[chosen] = others[nearer], -1, other[nearer]
        return places, triangle


def _may_be_within(scene: Scene, points: Floats, reach_m: Floats) -> Ints:
    """Which points (N, 3) lie so near to the box of a scene that it may be within reach (N,)."""
    low, high = scene.box
    gap = np.maximum(np.maximum(low - points, points - high), 0.0)
    least = np.linalg.norm(gap, axis=1) - scene.error_m - _ROUNDING_M
    return np.flatnonzero(least < reach_m)
