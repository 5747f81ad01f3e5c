"""Separates the structure of a scan from ground, clutter in the air, and neighbours.

The ground is near level, with nothing below it, and open to the sky round what stands on it: no deck or roof
is. The largest cluster of the rest is the structure, with all that is within its box or near it.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.vectors import neighbour_spacing, points_on_triangles, triangle_areas
from upplied.records import Floats, Ints, Record, Structure

CLASSES = ("structure", "ground", "clutter", "neighbour")
_SAMPLES = 150_000  # points that stand for a surface
_CELLS = 150  # of the plan, along its longer side
_OPEN = 0.02  # of the longer side of the plan: how high a cell may be and show but ground
_STEEP = 0.36  # tangent of the slope from which nothing is ground: 20 deg
_BELOW = 0.01  # share of the samples that may lie below the ground: noise, and a pit
_ROUND = 0.5  # least share of what is round the structure's footprint that is open ground
_TRIALS = 300
_WIDTHS = (27.0, 9.0, 2.0)  # cells over which the height of the ground is smoothed, the widest first
_NOISE = 4.0  # times the spread of the ground: thicker than that is no ground
_THIN, _THICK = 0.001, 0.01  # of the structure's diagonal: bounds of the layer that is taken away
_GAP = 0.006  # of the diagonal of what stands on the ground: clusters nearer are one
_SAMPLED, _SPACED = 2000, 4.0  # samples whose spacing is measured; clusters nearer than so many times that
_FRAGMENT = 0.002  # of the largest cluster's area
_BESIDE = 0.05  # of the largest cluster's diagonal: farther off, and outside its box, stands another


@dataclass(frozen=True, eq=False, repr=False)
class Separation(Record):
    """The class of each triangle of a mesh, or of each point of a cloud."""

    label: Ints  # (T,) or (N,) index into CLASSES
    area_m2: Floats  # (4,) of each class
    ground_z_m: float | None  # height of the ground under the structure, the median; None without ground

    @property
    def texts(self) -> tuple[str, ...]:
        """What was separated, in words; empty where all of it is the structure."""
        areas = zip(CLASSES[1:], self.area_m2[1:], strict=True)
        return tuple(f"{area:.1f} m² of {name}" for name, area in areas if area)


def separated(structure: Structure) -> Separation:
    """The structure, in metres with Z up, apart from ground, clutter and neighbours; deterministic.

    All of it is the structure where no ground is found and it is one cluster.
    """
    points, owner, area = _samples(structure)
    above, thick = _ground(points)
    label = np.where(above < thick, 1, 0)
    standing = np.flatnonzero(above >= thick)
    if len(standing):
        label[standing] = _clusters(points[standing], above[standing])
    # The class of each triangle or point: of most of its samples, or of the nearest one.
    number, count = len(structure.triangles) or len(structure.vertices), len(CLASSES)
    votes = np.bincount(owner * count + label, minlength=number * count).reshape(number, count)
    of_all, empty = votes.argmax(axis=1), np.flatnonzero(votes.sum(axis=1) == 0)
    if len(empty):
        corners = structure.triangles[empty] if len(structure.triangles) else empty[:, None]
        of_all[empty] = label[cKDTree(points).query(structure.vertices[corners].mean(axis=1))[1]]
    areas = np.bincount(owner, area, minlength=len(of_all))  # of all: what was thinned out has none
    share = np.asarray(np.bincount(of_all, areas, minlength=len(CLASSES)), float)
    of_ground = (points[:, 2] - above)[(label == 0) & np.isfinite(above)]
    return Separation(of_all, share, float(np.median(of_ground)) if len(of_ground) else None)


def structure_alone(structure: Structure, separation: Separation) -> tuple[Floats, Ints, Floats | None]:
    """Vertices (V, 3), m, triangles (T, 3) and, of a cloud that has them, normals (V, 3) of the structure."""
    if not len(structure.triangles):
        mine, normals = separation.label == 0, structure.normals
        return structure.vertices[mine], structure.triangles, None if normals is None else normals[mine]
    triangles = structure.triangles[separation.label == 0]
    used = np.unique(triangles)
    return structure.vertices[used], np.searchsorted(used, triangles), None


def _samples(structure: Structure) -> tuple[Floats, Ints, Floats]:
    """Points (S, 3), the triangle or point each stands for, and the area of each, m²."""
    if not len(structure.triangles):
        count = len(structure.vertices)
        chosen = chosen_evenly(count, _SAMPLES)
        points = structure.vertices[chosen]
        far = cKDTree(points).query(points, k=min(9, len(points)))[0][:, -1]
        return points, chosen, np.pi * far**2 / 8
    points, owner = points_on_triangles(structure, _SAMPLES, np.random.default_rng(0))
    return points, owner, np.full(_SAMPLES, triangle_areas(structure).sum() / _SAMPLES)


def _ground(points: Floats) -> tuple[Floats, float]:
    """How high samples (S,) are above the ground, inf without one, and how thick that is, m."""
    none = np.full(len(points), np.inf), 0.0
    low, side = points[:, :2].min(axis=0), float(np.ptp(points[:, :2], axis=0).max())
    if side <= 0:
        return none
    cell = np.floor((points[:, :2] - low) / side * (_CELLS - 1e-6)).astype(np.int64)
    flat = cell[:, 0] * _CELLS + cell[:, 1]
    bottom, top = np.full(_CELLS**2, np.inf), np.full(_CELLS**2, -np.inf)
    np.minimum.at(bottom, flat, points[:, 2])
    np.maximum.at(top, flat, points[:, 2])
    room = _OPEN * side
    low_open = np.flatnonzero((top - bottom < room) & np.isfinite(bottom))
    if len(low_open) < 30:
        return none
    at = np.stack(np.divmod(low_open, _CELLS), axis=1) / _CELLS * side + low + side / _CELLS / 2
    plane = _plane(at, bottom[low_open], room)
    if plane is None:
        return none
    open_ground = np.abs(bottom[low_open] - at @ plane[:2] - plane[2]) < room
    above = points[:, 2] - points[:, :2] @ plane[:2] - plane[2]
    if (above < -2 * room).mean() > _BELOW:
        return none
    mean = np.bincount(flat, points[:, 2], _CELLS**2) / np.maximum(np.bincount(flat, minlength=_CELLS**2), 1)
    surface = _Surface(at[open_ground], mean[low_open][open_ground], low, side)
    above = points[:, 2] - surface(points[:, :2])
    is_open = np.zeros(_CELLS**2, bool)
    is_open[low_open[open_ground]] = True
    standing = above > room
    if not standing.any():
        return none
    # Does open ground lie round the plan of what stands on it?
    covered = np.bincount(flat[standing], minlength=_CELLS**2) > 0
    plan = np.pad(covered.reshape(_CELLS, _CELLS), 4)
    ring = ndimage.binary_dilation(plan, iterations=4) & ~ndimage.binary_dilation(plan, iterations=1)
    ground = ndimage.binary_dilation(np.pad(is_open.reshape(_CELLS, _CELLS), 4))
    if not ground[ring].mean() > _ROUND:
        return none
    layer = above[is_open[flat] & (np.abs(above) < room)]
    spread = 1.4826 * float(np.median(np.abs(layer - np.median(layer))))
    diagonal = float(np.linalg.norm(np.ptp(points[standing], axis=0)))
    thick = float(np.clip(_NOISE * spread, _THIN * diagonal, _THICK * diagonal))
    return above, thick


def _plane(at: Floats, height: Floats, room: float) -> Floats | None:
    """The near level plane (3,) that most of the heights lie on, with no more than few below; or None."""
    rng = np.random.default_rng(0)
    rows = np.column_stack([at, np.ones(len(at))])
    best, most = None, 0
    for _ in range(_TRIALS):
        chosen = rng.choice(len(at), 3, replace=False)
        try:
            plane = np.linalg.solve(rows[chosen], height[chosen])
        except np.linalg.LinAlgError:
            continue
        if np.hypot(*plane[:2]) > _STEEP:
            continue
        above = height - rows @ plane
        count = int((np.abs(above) < room).sum()) - 2 * int((above < -room).sum())
        if count > most:
            best, most = plane, count
    return None if best is None else np.asarray(best, float)


class _Surface:
    """The height of the ground: a surface of second degree, and what departs from it from cell to cell."""

    def __init__(self, at: Floats, height: Floats, low: Floats, side: float) -> None:
        self.low, self.step = low, side / _CELLS
        self.middle, self.size = at.mean(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9)
        rows = self._rows(at)
        inlier = np.ones(len(at), bool)
        for _ in range(4):
            self.weights = np.linalg.lstsq(rows[inlier], height[inlier], rcond=None)[0]
            off = np.abs(height - rows @ self.weights)
            inlier = off <= max(3 * 1.4826 * float(np.median(off)), 1e-9)
        self.rest = self._spread(at, height - rows @ self.weights)

    def _rows(self, at: Floats) -> Floats:
        x, y = ((at - self.middle) / self.size).T
        return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])

    def _spread(self, at: Floats, rest: Floats) -> Floats:
        """What is left over by cell; under the structure as on the ground nearest to it."""
        cell = np.minimum(np.floor((at - self.low) / self.step), _CELLS - 1).astype(np.int64)
        known, value, heights = np.zeros((3, _CELLS, _CELLS))
        known[tuple(cell.T)], value[tuple(cell.T)] = 1.0, rest
        for wide in _WIDTHS:  # the narrowest that reaches any ground decides
            weight = ndimage.gaussian_filter(known, wide)
            mean = ndimage.gaussian_filter(value, wide) / np.maximum(weight, 1e-12)
            heights = np.where(weight > 0.1, mean, heights)
        return heights

    def __call__(self, at: Floats) -> Floats:
        cell = ((at - self.low) / self.step - 0.5).T
        rest = ndimage.map_coordinates(self.rest, cell, order=1, mode="nearest")
        return np.asarray(self._rows(at) @ self.weights + rest)


def _clusters(points: Floats, above: Floats) -> Ints:
    """The class (S,) of samples that are no ground, by the clusters that they fall into."""
    some = points[:: max(1, len(points) // _SAMPLED)]
    apart = neighbour_spacing(points, some)
    edge = max(_GAP * float(np.linalg.norm(np.ptp(points, axis=0))), _SPACED * apart)
    cells = np.floor((points - points.min(axis=0)) / max(edge, 1e-9))
    cell, voxel = np.unique(cells, axis=0, return_inverse=True)
    near = cKDTree(cell).query_pairs(1.8, output_type="ndarray")  # voxels that share a corner
    graph = coo_array((np.ones(len(near), bool), tuple(near.T)), (len(cell), len(cell)))
    cluster = connected_components(graph, directed=False)[1][voxel.reshape(-1)]
    count = np.bincount(cluster)
    low, high = np.full((2, len(count), 3), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(low, cluster, points)
    np.maximum.at(high, cluster, points)
    size = np.linalg.norm(high - low, axis=1)
    main = int(np.argmax(np.where(count > _FRAGMENT * len(points), size * (high - low)[:, 2], -1.0)))
    tree, top = cKDTree(points[cluster == main]), np.zeros(len(count))
    np.maximum.at(top, cluster, above)
    of_cluster = np.zeros(len(count), np.int64)
    for other in np.flatnonzero(np.arange(len(count)) != main):
        mine = points[cluster == other]
        within = ((mine >= low[main]) & (mine <= high[main])).all(axis=1).mean() > 0.5
        if top[other] < _THICK * size[main]:
            of_cluster[other] = 1  # a kerb, grass, a step in the ground
        elif count[other] < _FRAGMENT * count[main]:
            of_cluster[other] = 2
        elif not within and tree.query(mine)[0].min() > _BESIDE * size[main]:
            of_cluster[other] = 3
    return of_cluster[cluster]
