"""From many points to few: one for each voxel (paper, Sec. III-A), or such as keep apart (Poisson discs)."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.config import CloudSettings
from upplied.geometry.vectors import points_on_triangles
from upplied.records import Cloud, Floats, Ints, Structure

_ALIKE = 1e-6  # share by which distances may differ and be equal
_MOST_VOXELS = 2**20  # of a box, that are counted one by one


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
    leaf = _leaf_for(raw, settings.voxel_points)
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


def _leaf_for(points: Floats, number: int) -> float:
    """The leaf that leaves about `number` points, found by bisection on its logarithm."""
    columns = np.ascontiguousarray((points - points.min(axis=0)).T)
    extent = float(columns.max())
    low, high = np.log(extent / 2000), np.log(extent)
    for _ in range(20):
        middle = (low + high) / 2
        voxel, whole = _voxels(columns, float(np.exp(middle)))
        many = whole > _MOST_VOXELS
        if (len(np.unique(voxel)) if many else np.count_nonzero(np.bincount(voxel))) > number:
            low = middle
        else:
            high = middle
    return float(np.exp(high))


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
        if chosen.sum() > number:
            low = middle
        else:
            high = middle
    return np.flatnonzero(chosen)


def shares(points: Floats, normals: Floats, area: Floats, chosen: Ints) -> Floats:
    """The area (K,) of all candidates, each given to the nearest kept samples on its own side.

    On a grid many candidates are as near to four: they are given to all of them, and no last bit decides.
    """
    distance, near = cKDTree(points[chosen]).query(points, k=[*range(1, min(8, len(chosen)) + 1)])
    facing = np.einsum("nki,ni->nk", normals[chosen][near], normals) > 0
    facing[~facing.any(axis=1)] = True
    distance = np.where(facing, distance, np.inf)
    alike = distance <= (1 + _ALIKE) * distance.min(axis=1, keepdims=True)
    parts = alike * (area / alike.sum(axis=1))[:, None]
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
