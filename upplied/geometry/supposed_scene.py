"""A scene to which surface is added that nobody scanned, but that is supposed to be there."""

import numpy as np

from upplied.geometry.discs import hexagons
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Bools, Cloud, Floats, Ints, Structure, SupposedSurface

_ROUNDING_M = 1e-3  # beyond what single precision may be off


class SupposedScene(Scene):
    """What a scene answers where more surface is supposed: rays are blocked by it, distances are from it.

    Where surface is doubtful, distances are from that too, but no ray is blocked. `cast` and `hits` tell of
    the triangles that are known alone. The `error_m` of what is supposed says how much nearer it may be.
    """

    def __init__(self, known: Scene, supposed: Scene | None, doubtful: Scene | None = None) -> None:
        vars(self).update(vars(known))
        self.known, self.supposed = known, supposed
        self.more = [each for each in (supposed, doubtful) if each is not None]

    def blocked(self, rays: np.ndarray, slack: float = 1e-3) -> Bools:
        """As of a `Scene`, by what is known or likely."""
        hit = self.known.blocked(rays, slack)
        if self.supposed is None:
            return hit
        free = np.flatnonzero(~hit)
        local = rays[free]
        local[:, :3] += np.asarray(self.known.origin - self.supposed.origin, np.float32)
        hit[free] = self.supposed.blocked(local, slack)
        return hit

    def distance(self, points: Floats) -> Floats:
        """As of a `Scene`, from the nearest surface."""
        points = np.reshape(points, (-1, 3))
        away = self.known.distance(points)
        for scene in self.more:
            near = _may_be_within(scene, points, away)
            away[near] = np.minimum(away[near], scene.distance(points[near]))
        return away

    def nearer_supposed(self, points: Floats) -> Bools:
        """As of a `Scene`."""
        known = self.known.distance(points)
        return np.any([scene.distance(points) < known for scene in self.more], axis=0)

    def apart(self, points: Floats) -> Floats:
        """As of a `Scene`, from the nearer surface."""
        return np.asarray(np.min([each.apart(points) for each in (self.known, *self.more)], axis=0))

    def closest(self, points: Floats) -> tuple[Floats, Ints]:
        """As of a `Scene`, on the nearest surface; triangle -1 where that is not known."""
        points = np.reshape(points, (-1, 3))
        places, triangle = self.known.closest(points)
        away = np.linalg.norm(places - points, axis=1)
        for scene in self.more:
            near = _may_be_within(scene, points, away)
            others, _ = scene.closest(points[near])
            other = np.linalg.norm(others - points[near], axis=1)
            nearer = other < away[near]
            chosen = near[nearer]
            places[chosen], triangle[chosen], away[chosen] = others[nearer], -1, other[nearer]
        return places, triangle


def scene_for(structure: Structure, supposed: SupposedSurface | None) -> Scene:
    """What a plan keeps clear of at its target: what is known of it, and what is supposed (`Plan.supposed`).

    Every room after the plan asks this one where it judges a clearance or a line of sight of a plan;
    `scene.scene_of` tells of what was scanned alone.
    """
    return with_supposed(scene_of(structure), supposed)


def with_supposed(scene: Scene, supposed: SupposedSurface | None) -> Scene:
    """A scene with what is supposed beside, and what may be; itself where nothing is."""
    if supposed is None:
        return scene
    discs = supposed.points, supposed.normals, supposed.radius_m, supposed.corner
    likely, doubtful = (
        Scene(*hexagons(*(each[mine] for each in discs)), scene.threads, error_m=supposed.error_m)
        if mine.any()
        else None
        for mine in (supposed.likely, ~supposed.likely)
    )
    return SupposedScene(scene, likely, doubtful)


def obstacle(surface: Cloud, supposed: SupposedSurface | None) -> Cloud:
    """What is in the way: samples of a target, and of what is supposed of it; without areas where it is."""
    if supposed is None:
        return surface
    points = np.concatenate([surface.points, supposed.points])
    return Cloud(points, np.concatenate([surface.outward, supposed.normals]))


def extent(structure: Structure, supposed: SupposedSurface | None) -> tuple[Floats, Floats]:
    """Lower and upper corner, (3,) m, of the box round a structure and what is supposed of it."""
    points = structure.vertices
    if supposed is not None:
        points = np.concatenate([points, supposed.points])
    return points.min(axis=0), points.max(axis=0)


def _may_be_within(scene: Scene, points: Floats, reach_m: Floats) -> Ints:
    """Which points (N, 3) lie so near to the box of a scene that it may be within reach (N,)."""
    low, high = scene.box
    gap = np.maximum(np.maximum(low - points, points - high), 0.0)
    least = np.linalg.norm(gap, axis=1) - scene.error_m - _ROUNDING_M
    return np.flatnonzero(least < reach_m)
