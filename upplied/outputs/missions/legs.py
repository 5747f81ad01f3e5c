"""Which straight legs are free to fly, and how to get from home to a waypoint and back."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from upplied.records import Floats, Structure
from upplied.scene import Scene, scene_of

_EXACT_M = 0.02
_FARTHER_M = (0.0, 5.0, 15.0)  # tried where the nearest place outside the box is not free


@dataclass(frozen=True)
class Airspace:
    """A structure with what surrounds it, and the height at which everything can be crossed."""

    structure: Structure
    scene: Scene
    transit_z_m: float

    def free(self, points: Floats, clearance_m: float) -> bool:
        """Whether a polyline (N, 3), m, keeps its clearance and stays where flying is allowed."""
        return not self.forbidden(points) and min_distance(self.scene, points) >= clearance_m - _EXACT_M

    def forbidden(self, points: Floats) -> str:
        """What a polyline (N, 3), m, would break besides the clearance; empty where it is allowed."""
        around = self.structure.surroundings
        if around.ceiling_z_m is not None and points[:, 2].max() > around.ceiling_z_m:
            return f"it rises above the ceiling at {around.ceiling_z_m:g} m"
        dense = _dense(points, 0.25)
        for low, high in around.keep_out_m:
            if ((dense >= low) & (dense <= high)).all(axis=1).any():
                return f"it enters the keep-out box from {low.tolist()} to {high.tolist()} m"
        if len(around.geofence_m) and not _inside(dense, around.geofence_m).all():
            return "it leaves the geofence"
        return ""

    def way_out(self, point: Floats, home: Floats, clearance_m: float) -> Floats | None:
        """The shortest free way (K, 3), m, from a point to straight above home; None where there is none.

        Straight up, or first sideways out of the structure's box and then up, in sixteen directions.
        """
        above_home = np.array([home[0], home[1], self.transit_z_m])
        needed = min(clearance_m, float(self.scene.distance(point[None])[0]))
        ways = [np.array([point, self._above(point), above_home])]
        low, high = self.structure.vertices.min(axis=0), self.structure.vertices.max(axis=0)
        for angle in np.arange(16) * np.pi / 8:
            direction = np.array([np.cos(angle), np.sin(angle), 0.0])
            reach = _until_outside(point, direction, low, high, clearance_m + 1.0)
            for farther in _FARTHER_M:
                out = point + (reach + farther) * direction
                ways.append(np.array([point, out, self._above(out), above_home]))
        ways.sort(key=lambda way: float(length(way)))
        return next((_distinct(way) for way in ways if self.free(way, needed)), None)

    def _above(self, point: Floats) -> Floats:
        return np.array([point[0], point[1], max(self.transit_z_m, point[2])])


def airspace_of(structure: Structure, path: Floats, clearance_m: float) -> Airspace:
    """The airspace of a structure for a path (N, 3), m: transit is above both."""
    top = max(structure.vertices[:, 2].max(), path[:, 2].max())
    return Airspace(structure, scene_of(structure), float(top) + clearance_m + 1.0)


def default_home(structure: Structure, first: Floats, clearance_m: float) -> tuple[Floats, str]:
    """A take-off on the ground near the first waypoint, outside the structure's box; and why there."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    outward = first - (low + high) / 2
    outward[2] = 0.0
    reach = np.linalg.norm(outward)
    outward = outward / reach if reach > 1e-6 else np.array([1.0, 0.0, 0.0])
    place = first + _until_outside(first, outward, low, high, clearance_m + 3.0) * outward
    ground = structure.surroundings.ground_z_m
    place[2] = low[2] if ground is None else ground
    source = "the lowest point of the structure" if ground is None else "the declared ground"
    return (
        place,
        f"take-off assumed at {place.round(1).tolist()} m in the structure frame, at the height of {source}",
    )


def min_distance(scene: Scene, points: Floats) -> float:
    """Least distance of a polyline (N, 3), m, from the surface, to 2 cm.

    A distance changes by no more than the way flown, so an interval whose middle is far enough off
    cannot hold the minimum; the others are halved.
    """
    starts, ends = points[:-1], points[1:]
    best = float(scene.distance(points).min())
    while len(starts):
        middle = (starts + ends) / 2
        half = np.linalg.norm(ends - starts, axis=1) / 2
        distance = scene.distance(middle)
        best = min(best, float(distance.min()))
        open_ = (distance - half < best - _EXACT_M) & (half > 1e-6)
        starts, middle, ends = starts[open_], middle[open_], ends[open_]
        starts, ends = np.concatenate([starts, middle]), np.concatenate([middle, ends])
    return best


def length(points: Floats) -> float:
    """Length of a polyline (N, 3), m."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _until_outside(point: Floats, direction: Floats, low: Floats, high: Floats, margin: float) -> float:
    """How far to go from a point along a level direction to leave a box grown by a margin, m."""
    inside = (point[:2] > low[:2] - margin) & (point[:2] < high[:2] + margin)
    if not inside.all():
        return 0.0
    with np.errstate(divide="ignore"):
        reach = np.where(direction[:2] > 0, high[:2] + margin - point[:2], low[:2] - margin - point[:2])
        steps = np.where(np.abs(direction[:2]) > 1e-9, reach / direction[:2], np.inf)
    return float(steps.min())


def _distinct(points: Floats) -> Floats:
    """The polyline without points that repeat the one before: controllers refuse them."""
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.01
    return points[np.concatenate([[True], moved])]


def _dense(points: Floats, step_m: float) -> Floats:
    """The polyline with a point at least at every step."""
    parts = []
    for start, end in pairwise(points):
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / step_m)) + 1)
        parts.append(start + np.linspace(0, 1, count)[:, None] * (end - start))
    return np.concatenate(parts)


def _inside(points: Floats, polygon: Floats) -> np.ndarray:
    """Which points lie inside a polygon (G, 2) seen from above: even-odd rule."""
    x, y = points[:, 0, None], points[:, 1, None]
    (x1, y1), (x2, y2) = polygon.T, np.roll(polygon, -1, axis=0).T
    crosses = (y1 > y) != (y2 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x1 + (y - y1) * (x2 - x1) / (y2 - y1)
    return (crosses & (x < at)).sum(axis=1) % 2 == 1
