"""Points of a mesh on three lattices of straight lines, which depend on the surface alone; and few of many.

Drawn samples are others as soon as a vertex moves by a millimetre, and a plan follows them. So each triangle
is crossed by the parallel lines of the lattice that it faces most; the lines stand fast in the structure's
frame. Where the surface moves by a millimetre so do the points, and only at its borders one comes or goes.

Of many points few are chosen: one for each voxel (paper, Sec. III-A), or such as keep apart (Poisson discs).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.config import CloudSettings
from upplied.geometry.vectors import points_on_triangles, triangle_areas
from upplied.records import Bools, Cloud, Floats, Ints, Record, Structure

# Neither walls nor slopes of 45 deg face two lattices alike, and no edge is parallel to a row of lines.
_HEADING = 0.56  # rad, of the first horizontal lattice
_TILT = 0.41  # rad, of the rows in each lattice
_STEPS = 4  # spacings from one to the one that is half of it
_FACING = 0.85  # mean cosine between a surface and the lines that cross it
_AS_NEAR = 0.5  # times the nearest kept sample's distance, by which another may be farther and have a share
_MOST_VOXELS = 2**20  # of a box, that are counted one by one


@dataclass(frozen=True, eq=False, repr=False)
class Lattice(Record):
    """Where lines cross the triangles of a mesh, in an order of which every beginning is spread evenly."""

    points: Floats  # (N, 3) m
    triangle: Ints  # (N,)
    area: Floats  # (N,) m^2 that each stands for
    coarse: Bools  # (N,) half of them: the crossings of every second line


def lattice(structure: Structure, spacing_m: float, some: Ints | None = None) -> Lattice:
    """The points at which lines of a spacing, m, cross a mesh, or `some` (S,) of its triangles.

    The lattices turn and move with the structure (`surface.frames`). Points are of both sides of a sheet,
    hidden or not, but none under the ground; the areas add up to the mesh's.
    """
    chosen = np.arange(len(structure.triangles)) if some is None else some
    middle = centre(structure)
    corners = structure.vertices[structure.triangles[chosen]] - middle
    number = _crossings(corners, spacing_m, np.empty((0, 3)), np.empty((0, 4), np.int64), np.empty(0))
    points, line, area = np.empty((number, 3)), np.empty((number, 4), np.int64), np.empty(number)
    _crossings(corners, spacing_m, points, line, area)
    # A number for each line by which they are mixed: the same line has the same.
    mixed = np.zeros(len(line), np.uint64)
    with np.errstate(over="ignore"):
        for part in line[:, 1:].T:
            mixed = (mixed ^ part.astype(np.uint64)) + np.uint64(0x9E3779B97F4A7C15)
            mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            mixed ^= mixed >> np.uint64(31)
    points += middle
    order = np.argsort(mixed.view(np.int64), kind="stable")
    order = order[~structure.buried(points[order])]
    line = line[order]
    coarse = (line[:, 2] + line[:, 3]) % 2 == 0
    return Lattice(points[order], chosen[line[:, 0]], area[order], coarse)


def centre(structure: Structure) -> Floats:
    """The centre of a surface (3,), m: triangles may be divided or in any order; of points their mean."""
    area = triangle_areas(structure) if len(structure.triangles) else np.zeros(0)
    whole = float(area.sum())
    near = structure.vertices.mean(axis=0)
    if not whole > 0:
        return np.asarray(near)
    # From near by, so that a kilometre from the origin costs no digits.
    return np.asarray(near + area @ (structure.vertices - near)[structure.triangles].mean(axis=1) / whole)


def spacing_for(structure: Structure, area_m2: float, number: float) -> float:
    """The spacing (m) at which a surface has about as many points, or up to a fifth more or fewer.

    It is one of few, so that a little more surface is not sampled elsewhere.
    """
    spacing = np.sqrt(_FACING * max(area_m2, 1e-12) / max(number, 1.0))
    step = np.round(_STEPS * np.log2(structure.diagonal_m / spacing))
    return float(structure.diagonal_m * 2.0 ** (-step / _STEPS))


@njit(cache=True)
def _crossings(corners: Floats, spacing: float, points: Floats, line: Ints, area: Floats) -> int:
    """How many lines cross the triangles (T, 3, 3); written where there is room."""
    # `line` (N, 4) is the triangle, the lattice and the row and column of the line.
    along, aside = np.cos(_HEADING), np.sin(_HEADING)
    cosine, sine = np.cos(_TILT), np.sin(_TILT)
    flat, count = np.empty((3, 2)), 0
    for triangle in range(len(corners)):
        here = corners[triangle]
        one, two = here[1] - here[0], here[2] - here[0]
        x = one[1] * two[2] - one[2] * two[1]
        y = one[2] * two[0] - one[0] * two[2]
        z = one[0] * two[1] - one[1] * two[0]
        size = np.sqrt(x * x + y * y + z * z)
        if size <= 0.0:
            continue
        facing = np.array([abs(along * x + aside * y), abs(along * y - aside * x), abs(z)]) / size
        way = np.argmax(facing)
        each = spacing * spacing / facing[way]
        # Those across are one another turned by a right angle: left and right of the middle as in a mirror.
        for mirror in range(1 if way == 2 else 2):
            sign = 1.0 - 2.0 * mirror
            for corner in range(3):
                px, py, pz = here[corner]
                if way == 0:
                    u, v = sign * (along * py - aside * px), pz
                elif way == 1:
                    u, v = -sign * (along * px + aside * py), pz
                else:
                    u, v = px, py
                flat[corner, 0] = (cosine * u + sine * v) / spacing
                flat[corner, 1] = (cosine * v - sine * u) / spacing
            first, last = np.ceil(flat[:, 0].min() - 0.5), np.floor(flat[:, 0].max() - 0.5)
            for row in range(int(first), int(last) + 1):
                a, low, high = row + 0.5, np.inf, -np.inf
                for corner in range(3):
                    p, q = flat[corner], flat[(corner + 1) % 3]
                    if (p[0] <= a) != (q[0] <= a):
                        b = p[1] + (a - p[0]) / (q[0] - p[0]) * (q[1] - p[1])
                        low, high = min(low, b), max(high, b)
                if low > high:
                    continue
                for column in range(int(np.ceil(low - 0.5)), int(np.floor(high - 0.5)) + 1):
                    b = column + 0.5
                    if way < 2 and cosine * a - sine * b <= 0.0:
                        continue
                    if count < len(points):
                        _place(here, flat, a, b, points[count])
                        line[count, 0], line[count, 1] = triangle, way + 3 * mirror
                        line[count, 2], line[count, 3] = row, column
                        area[count] = each
                    count += 1
    return count


@njit(cache=True)
def _place(corners: Floats, flat: Floats, a: float, b: float, place: Floats) -> None:
    """The point of a triangle that lies at a place of its image."""
    ua, ub = flat[1, 0] - flat[0, 0], flat[1, 1] - flat[0, 1]
    va, vb = flat[2, 0] - flat[0, 0], flat[2, 1] - flat[0, 1]
    whole = ua * vb - ub * va
    second = ((a - flat[0, 0]) * vb - (b - flat[0, 1]) * va) / whole
    third = (ua * (b - flat[0, 1]) - ub * (a - flat[0, 0])) / whole
    for axis in range(3):
        place[axis] = (
            corners[0, axis]
            + second * (corners[1, axis] - corners[0, axis])
            + third * (corners[2, axis] - corners[0, axis])
        )


def voxel_cloud(structure: Structure, settings: CloudSettings) -> Cloud:
    """The sub-sampled cloud, kappa, of a structure: one centroid per occupied voxel.

    The paper leaves the leaf open; its clouds hold 693 (airplane) and 1120 (turbine) points. Here
    the leaf follows from the structure so that about `settings.voxel_points` remain. The grid starts
    at the corner of the bounding box, so that a moved structure gives the moved cloud. Points (N, 3), m, are
    in the structure's frame and in the order of their voxels.
    """
    if len(structure.triangles):
        rng = np.random.default_rng(settings.seed)
        raw, _ = points_on_triangles(structure, settings.raw_points, rng)
    else:
        raw = structure.vertices
    # The leaf that leaves about so many points, by bisection on its logarithm.
    columns = np.ascontiguousarray((raw - raw.min(axis=0)).T)
    extent = float(columns.max())
    low, high = np.log(extent / 2000), np.log(extent)
    for _ in range(20):
        middle = (low + high) / 2
        voxel, whole = _voxels(columns, float(np.exp(middle)))
        many = len(np.unique(voxel)) if whole > _MOST_VOXELS else np.count_nonzero(np.bincount(voxel))
        low, high = (middle, high) if many > settings.voxel_points else (low, middle)
    leaf = float(np.exp(high))
    return Cloud(points=voxel_filter(raw, leaf), leaf_m=leaf)


def voxel_filter(points: Floats, leaf_m: float) -> Floats:
    """Centroids (N, 3) of the points in each occupied voxel of edge `leaf_m`, as PCL's VoxelGrid.

    Examples
    --------
    >>> voxel_filter(np.array([[0.0, 0, 0], [0.2, 0, 0], [5, 0, 0]]), 1.0)
    array([[0.1, 0. , 0. ],
           [5. , 0. , 0. ]])
    """
    voxel, _ = _voxels((points - points.min(axis=0)).T, leaf_m)
    _, member, count = np.unique(voxel, return_inverse=True, return_counts=True)
    sums = np.column_stack([np.bincount(member, weights=points[:, axis]) for axis in range(3)])
    return sums / count[:, None]


def _voxels(columns: Floats, leaf_m: float) -> tuple[Ints, int]:
    """The voxel (N,) of each place (3, N) from the corner of their box, and how many voxels that has."""
    x, y, z = cell = (columns / leaf_m).astype(np.int64)
    size = cell.max(axis=1) + 1
    return (x * size[1] + y) * size[2] + z, int(size.prod())


def thin(points: Floats, normals: Floats, number: int, area: float) -> Ints:
    """About `number` of the candidates, none nearer to another on the same side than it must be.

    Indices, increasing. Of N points, m, with normals, that cover an area, m^2; those that face apart
    may lie near each other: the two sides of a sheet.
    """
    if len(points) <= number:
        return np.arange(len(points))
    reach = np.sqrt(area / number)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > 0]
    pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
    start = np.searchsorted(pairs[:, 0], np.arange(len(points) + 1))
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    low, high = 0.0, reach
    chosen = np.ones(len(points), bool)
    for _ in range(12):
        middle = (low + high) / 2
        chosen = _greedy(start, pairs[:, 1], distance, middle)
        low, high = (middle, high) if chosen.sum() > number else (low, middle)
    return np.flatnonzero(chosen)


def shares(points: Floats, normals: Floats, area: Floats, chosen: Ints) -> Floats:
    """The area (K,) of all candidates, each given to the nearest kept samples on its own side.

    On a grid many candidates are as near to four. They share it by how near they are: no millimetre decides.
    """
    distance, near = cKDTree(points[chosen]).query(points, k=[*range(1, min(8, len(chosen)) + 1)])
    facing = np.einsum("nki,ni->nk", normals[chosen][near], normals) > 0
    facing[~facing.any(axis=1)] = True
    distance = np.where(facing, distance, np.inf)
    nearest = distance.min(axis=1, keepdims=True)
    beyond = (distance - nearest) / np.maximum(_AS_NEAR * nearest, 1e-12)
    parts = np.maximum(1 - beyond, 0) ** 2
    parts *= (area / parts.sum(axis=1))[:, None]
    return np.asarray(np.bincount(near.ravel(), parts.ravel(), minlength=len(chosen)), float)


@njit(cache=True)
def _greedy(start: Ints, other: Ints, distance: Floats, radius: float) -> np.ndarray:
    """Keep each candidate in turn unless one kept before lies within the radius."""
    number = len(start) - 1
    chosen = np.ones(number, np.bool_)
    for index in range(number):
        if chosen[index]:
            for pair in range(start[index], start[index + 1]):
                if distance[pair] < radius:
                    chosen[other[pair]] = False
    return chosen
