"""Structures from above: the outline, the axis of a tower, the piers of a bridge."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated
from upplied.geometry.scene import Scene
from upplied.records import Floats, Structure

_SAMPLES = 60_000


def surface_points(structure: Structure, seed: int = 0) -> Floats:
    """Points (N, 3) spread evenly over a mesh, m; the points themselves for a cloud."""
    if not len(structure.triangles):
        return structure.vertices
    a, b, c = (structure.vertices[structure.triangles[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(area), _SAMPLES, p=area / area.sum())
    u, v = rng.random((2, _SAMPLES, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return np.asarray(a[chosen] + u * (b[chosen] - a[chosen]) + v * (c[chosen] - a[chosen]))


def offset_outline(points_xy: Floats, distance_m: float, step_m: float = 0.5) -> Floats:
    """A closed loop (N, 2) at a distance from the convex outline of points (M, 2), m, anticlockwise from -x.

    The first point is not repeated at the end.
    """
    angle = np.pi + np.linspace(0, 2 * np.pi, 721)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    hull = points_xy[ConvexHull(points_xy, qhull_options="QJ Pp").vertices]
    loop = hull[np.argmax(hull @ normal.T, axis=0)] + distance_m * normal
    along = arc_length(loop)
    wanted = np.linspace(0, along[-1], max(int(along[-1] / step_m), 8), endpoint=False)
    return interpolated(wanted, along, loop)


class Tower(NamedTuple):
    """An upright mast, m."""

    axis_xy: tuple[float, float]
    foot_z: float
    top_z: float  # where something wider begins
    radius_m: float  # largest


def tower_of(structure: Structure) -> Tower:
    """The mast that carries a turbine's nacelle: the narrow part of the structure over its foot.

    Raises RefusedError if nothing slender stands below.
    """
    points = surface_points(structure)
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    foot = points[points[:, 2] < low + 0.25 * (high - low)]
    axis = (foot[:, :2].min(axis=0) + foot[:, :2].max(axis=0)) / 2
    radius = float(np.linalg.norm(foot[:, :2] - axis, axis=1).max())
    if radius > 0.12 * (high - low):
        raise RefusedError(structure.structure_id, "no slender tower was found", "a tower that stands free")
    # Above the foot, blades may hang beside the tower: only the rear half reveals the start of the nacelle.
    rear = points[points[:, 0] < axis[0] - 1.25 * radius]
    near = rear[np.abs(rear[:, 1] - axis[1]) < 2 * radius]
    top = float(near[:, 2].min()) if len(near) else low + 0.6 * (high - low)
    return Tower((float(axis[0]), float(axis[1])), low, max(top, low + 0.3 * (high - low)), radius)


class Pier(NamedTuple):
    """One pier in plan, m."""

    centre: tuple[float, float]
    half: tuple[float, float]  # sizes along and across the road


def two_piers(structure: Structure, scene: Scene) -> tuple[Pier, Pier, float, float]:
    """Two neighbouring piers nearest to the middle of a bridge, and the free heights between them.

    The first is at smaller x; the heights are of the ground and of the underside of the deck midway between
    them, m; inf where the sky is open.

    Raises RefusedError if no two piers stand apart.
    """
    points = surface_points(structure)
    low, high = points[:, 2].min(), points[:, 2].max()
    middle_x = (points[:, 0].min() + points[:, 0].max()) / 2
    for share in (0.35, 0.25, 0.15, 0.5):
        level = low + share * (high - low)
        slab = points[np.abs(points[:, 2] - level) < 0.08 * (high - low)]
        piers = _groups_along(slab, gap_m=0.025 * float(np.ptp(points[:, 0])))
        slender = [pier for pier in piers if pier.half[0] < 0.06 * np.ptp(points[:, 0])]
        pairs = [
            ((one.centre[0] + two.centre[0]) / 2, one, two)
            for one, two in pairwise(slender)
            if two.centre[0] - one.centre[0] > 2 * max(*one.half, *two.half) + 8
        ]
        if pairs:
            x, one, two = min(pairs, key=lambda pair: abs(pair[0] - middle_x))
            between = np.array([[x, one.centre[1], low + 0.01]])
            reach = scene.cast(between, np.array([[0.0, 0.0, 1.0]]))[0]
            return one, two, float(low), float(low + reach[0])
    raise RefusedError(structure.structure_id, "no two piers that stand apart", "a bridge on piers along X")


def _groups_along(points: Floats, gap_m: float) -> list[Pier]:
    """Points grouped by gaps along x."""
    if len(points) < 10:
        return []
    ordered = points[np.argsort(points[:, 0], kind="stable")]
    cuts = np.flatnonzero(np.diff(ordered[:, 0]) > gap_m) + 1
    groups = (group[:, :2] for group in np.split(ordered, cuts) if len(group) >= 10)
    ends = [(group.min(axis=0), group.max(axis=0)) for group in groups]
    return [Pier(tuple(((lo + hi) / 2).tolist()), tuple(((hi - lo) / 2).tolist())) for lo, hi in ends]
