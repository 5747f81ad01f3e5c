"""Parts located on any mesh: fuselage, wings and nacelles by rays; outlines, towers and piers from above.

Only the frame of the mesh is known: nose or road along +X, Z up; an airplane's plane of symmetry at y = 0.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import grey_dilation, label, median_filter
from scipy.spatial import ConvexHull

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Bools, Floats, Structure

_ROWS, _COLUMNS = 161, 321  # of the height map, across and along
_SAMPLES = 60_000  # of a mesh, seen from above


class Nacelle(NamedTuple):
    """One engine seen from ahead."""

    centre: tuple[float, float, float]  # middle of its length, m
    radius_m: float
    length_m: float


@dataclass(frozen=True)
class Airframe:
    """The measures of an airplane that its inspection needs, m, structure frame."""

    nose_x: float
    tail_x: float
    axis_z: float
    half_width: float
    half_height: float
    semi_span: float
    wing_y: Floats  # (W,) distances from the plane of symmetry, rising
    leading_x: Floats  # (W,) of the wing there
    trailing_x: Floats  # (W,)
    wing_z: Floats  # (W,) its upper side
    map_x: Floats  # (C,) of the height map, rising
    map_y: Floats  # (R,)
    map_z: Floats  # (R, C) highest surface, -inf if there is none

    def height_near(self, x: Floats, y: Floats, reach_m: float) -> Floats:
        """Highest surface within about `reach_m` of points in plan, -inf if there is none."""
        rows = int(np.ceil(reach_m / (self.map_y[1] - self.map_y[0])))
        columns = int(np.ceil(reach_m / (self.map_x[1] - self.map_x[0])))
        wide = grey_dilation(self.map_z, size=(2 * rows + 1, 2 * columns + 1))
        row = np.clip(np.searchsorted(self.map_y, y), 0, len(self.map_y) - 1)
        column = np.clip(np.searchsorted(self.map_x, x), 0, len(self.map_x) - 1)
        return np.asarray(wide[row, column])


def airframe(structure: Structure, scene: Scene | None = None) -> Airframe:
    """Find the fuselage and the wings.

    Raises RefusedError if there is no body with a wing on each side of the plane of symmetry.
    """
    scene = scene or scene_of(structure)
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    axis_z, half_width, half_height = _body(structure.structure_id, scene, low, high)
    map_x = np.linspace(low[0] - 4, high[0] + 4, _COLUMNS)
    map_y = np.linspace(low[1] - 4, high[1] + 4, _ROWS)
    grid_y, grid_x = np.meshgrid(map_y, map_x, indexing="ij")
    start = np.column_stack([grid_x.ravel(), grid_y.ravel(), np.full(grid_x.size, high[2] + 5)])
    reach = _reach(scene, start, (0.0, 0.0, -1.0))
    map_z = np.where(np.isfinite(reach), start[:, 2] - reach, -np.inf).reshape(grid_x.shape)
    semi_span = float(high[1])
    wing_y, leading, trailing, wing_z = _wing(map_x, map_y, map_z, half_width, semi_span)
    if len(wing_y) < 5:
        raise RefusedError(structure.structure_id, "no wing was found", "an airplane with its nose along +X")
    return Airframe(
        float(high[0]), float(low[0]), axis_z, half_width, half_height, semi_span,
        wing_y, leading, trailing, wing_z, map_x, map_y, map_z,
    )  # fmt: skip


def _body(name: str, scene: Scene, low: Floats, high: Floats) -> tuple[float, float, float]:
    """Height of the fuselage's axis, its half width and half height, between nose and wings."""
    length = high[0] - low[0]
    x = high[0] - length * np.linspace(0.13, 0.23, 11)

    def reach(y: float, z: float, *direction: float) -> Floats:
        return _reach(scene, np.column_stack([x, np.full(len(x), y), np.full(len(x), z)]), direction)

    top = np.median(high[2] + 1 - reach(0.01, high[2] + 1, 0.0, 0.0, -1.0))
    bottom = np.median(low[2] - 1 + reach(0.01, low[2] - 1, 0.0, 0.0, 1.0))
    axis = (top + bottom) / 2
    half_width = np.median(high[1] + 1 - reach(high[1] + 1, axis, 0.0, -1.0, 0.0))
    if not np.isfinite([top, bottom, half_width]).all() or half_width <= 0:
        raise RefusedError(name, "no fuselage was found", "an airplane with its nose along +X")
    return float(axis), float(half_width), float(top - bottom) / 2


def _reach(scene: Scene, start: Floats, direction: tuple[float, ...]) -> Floats:
    """Lengths (N,) of rays of one direction, m."""
    return scene.cast(start, np.broadcast_to(direction, start.shape))[0]


def _wing(
    map_x: Floats, map_y: Floats, map_z: Floats, half_width: float, semi_span: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Edges of the left wing, followed from three quarters of its span inwards and outwards."""
    rows = np.flatnonzero((map_y > 1.25 * half_width) & (map_y < 0.985 * semi_span))
    start = rows[np.argmin(np.abs(map_y[rows] - 0.72 * semi_span))] if len(rows) else 0
    runs: dict[int, tuple[int, int]] = {}
    for step in (-1, 1):
        run: tuple[int, int] | None = None
        for row in rows[rows <= start][::-1] if step < 0 else rows[rows >= start]:
            run = _overlapping_run(np.isfinite(map_z[row]), run)
            if run is None:
                break
            runs[int(row)] = run
    wing = sorted(runs)
    y = map_y[wing]
    trailing = median_filter(map_x[[runs[row][0] for row in wing]], size=9, mode="nearest")
    leading = _straight(y, map_x[[runs[row][1] for row in wing]])
    middle = [(runs[row][0] + runs[row][1]) // 2 for row in wing]
    height = median_filter(map_z[wing, middle], size=5, mode="nearest") if wing else np.empty(0)
    return y, leading, np.minimum(trailing, leading - 0.3), height


def _overlapping_run(covered: Bools, before: tuple[int, int] | None) -> tuple[int, int] | None:
    """The run of covered cells that overlaps the one before most, or the longest."""
    edges = np.flatnonzero(np.diff(covered, prepend=False, append=False)).reshape(-1, 2)
    runs = [(int(a), int(b) - 1) for a, b in edges]
    if not runs:
        return None
    if before is None:
        return max(runs, key=lambda run: run[1] - run[0])
    best = max(runs, key=lambda run: min(run[1], before[1]) - max(run[0], before[0]))
    return best if min(best[1], before[1]) >= max(best[0], before[0]) else None


def _straight(y: Floats, x: Floats) -> Floats:
    """The line through most of the points (Theil and Sen): nacelles that stick out do not count."""
    i, j = np.triu_indices(len(y), k=1)
    if len(i) == 0:
        return x
    slope = np.median((x[j] - x[i]) / (y[j] - y[i]))
    return np.asarray(np.median(x - slope * y) + slope * y)


def left_nacelle(structure: Structure, frame: Airframe, scene: Scene) -> Nacelle:
    """The left engine; of two, the inner one.

    It is ahead of the wing or, if none is there, beside the tail.

    Raises RefusedError if nothing of the shape of an engine protrudes.
    """
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    cell = frame.semi_span / 240
    y = np.arange(1.12 * frame.half_width, 0.9 * frame.semi_span, cell)
    z = np.arange(low[2], frame.axis_z + 2.2 * frame.half_height, cell)
    grid_y, grid_z = np.meshgrid(y, z, indexing="ij")
    start = np.column_stack([np.full(grid_y.size, high[0] + 5), grid_y.ravel(), grid_z.ravel()])
    front = (start[:, 0] - _reach(scene, start, (-1.0, 0.0, 0.0))).reshape(grid_y.shape)
    apart = 0.022 * (frame.nose_x - frame.tail_x)
    leading = np.interp(grid_y, frame.wing_y, frame.leading_x)
    trailing = np.interp(grid_y, frame.wing_y, frame.trailing_x)
    beside = (grid_y < 3.2 * frame.half_width) & (grid_z > frame.axis_z - frame.half_height)
    for stands_out in (front > leading + apart, np.isfinite(front) & (front < trailing - apart) & beside):
        spot = _inner_spot(stands_out, least=(0.25 * frame.half_width / cell) ** 2)
        if spot is not None:
            return _measured(scene, y, z, front, spot, apart)
    raise RefusedError(structure.structure_id, "no engine was found on the left", "an airplane with engines")


def _inner_spot(stands_out: Bools, least: float) -> Bools | None:
    """The connected spot nearest the fuselage among those nearly as large as the largest."""
    spots, count = label(stands_out)
    sizes = np.bincount(spots.ravel(), minlength=count + 1)[1:]
    large = [number + 1 for number in range(count) if sizes[number] >= max(least, 0.4 * sizes.max())]
    return spots == large[0] if large else None  # labels rise with y


def _measured(scene: Scene, y: Floats, z: Floats, front: Floats, spot: Bools, apart: float) -> Nacelle:
    rows, columns = np.nonzero(spot)
    y_low, y_high = y[rows.min()], y[rows.max()]
    z_low, z_high = z[columns.min()], z[columns.max()]
    middle_y, middle_z = (y_low + y_high) / 2, (z_low + z_high) / 2
    radius, lip = max((y_high - y_low) / 2, (z_high - z_low) / 2), float(front[spot].max())
    # How far aft the flank runs: rays from outboard, at the height of the axis.
    x = np.arange(lip - 0.1, lip - 6 * radius, -apart / 8)
    outboard = np.column_stack([x, np.full(len(x), y_high + radius), np.full(len(x), middle_z)])
    flank = _reach(scene, outboard, (0.0, -1.0, 0.0)) < 2.2 * radius
    gap = np.flatnonzero(~flank[len(x) // 12 :])
    length = lip - (x[gap[0] + len(x) // 12] if len(gap) else x[-1])
    length = float(np.clip(length, 1.5 * radius, 5 * radius))
    return Nacelle((lip - length / 2, float(middle_y), float(middle_z)), float(radius), length)


def points_on(structure: Structure, seed: int = 0) -> Floats:
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
    # Not square to straight sides: there all points lie as far out, and the last bit would choose.
    angle = np.pi + np.radians(np.arange(721) / 2 + 0.25)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    hull = points_xy[ConvexHull(points_xy, qhull_options="QJ Pp").vertices]
    loop = hull[np.argmax(hull @ normal.T, axis=0)] + distance_m * normal
    along = arc_length(loop)
    places = np.linspace(0, along[-1], max(int(along[-1] / step_m), 8), endpoint=False)
    return interpolated(places, along, loop)


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
    points = points_on(structure)
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
    points = points_on(structure)
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
