"""Even spacing: from many candidates on a surface to few samples that keep apart (Poisson discs)."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.cubes import Cubes
from upplied.records import Floats, Ints
from upplied.vectors import neighbour_spacing


def thin(points: Floats, normals: Floats, number: int, area: float) -> Ints:
    """About `number` of the candidates, none nearer to another on the same side than it must be.

    Parameters
    ----------
    points : array, shape (N, 3), m
    normals : array, shape (N, 3)
        Samples whose normals point apart may lie near each other: the two sides of a sheet.
    number : int
    area : float
        Of the surface that the candidates cover, m^2.

    Returns
    -------
    array of int
        Indices of those kept, increasing.
    """
    if len(points) <= number:
        return np.arange(len(points))
    reach = np.sqrt(area / number)
    near = Cubes.of(points, reach).facing(normals, reach)
    low, high = 0.0, reach
    kept = np.ones(len(points), bool)
    for _ in range(12):
        middle = (low + high) / 2
        kept = _greedy(*near, middle)
        if kept.sum() > number:
            low = middle
        else:
            high = middle
    return np.flatnonzero(kept)


def shares(points: Floats, normals: Floats, area: Floats, kept: Ints) -> Floats:
    """The area (K,) of all candidates, each given to the nearest kept sample on its own side."""
    tree, kept_normals = cKDTree(points[kept]), normals[kept]
    order = Cubes.of(points, neighbour_spacing(points[kept])).index
    choice = np.empty(len(points), np.int64)
    choice[order] = tree.query(points[order])[1]
    # The nearest of all is mostly on the same side.
    asked = np.flatnonzero(~(np.einsum("ni,ni->n", kept_normals[choice], normals) > 0))
    near = tree.query(points[asked], k=[*range(1, min(8, len(kept)) + 1)])[1]
    facing = np.einsum("nki,ni->nk", kept_normals[near], normals[asked]) > 0
    choice[asked] = near[np.arange(len(asked)), np.argmax(facing, axis=1)]
    return np.asarray(np.bincount(choice, weights=area, minlength=len(kept)), float)


@njit(cache=True)
def _greedy(begin: Ints, end: Ints, later: Ints, distance: Floats, radius: float) -> np.ndarray:
    """Keep each candidate in turn unless one kept before lies within the radius."""
    kept = np.ones(len(begin), np.bool_)
    for index in range(len(begin)):
        if kept[index]:
            for pair in range(begin[index], end[index]):
                if distance[pair] < radius:
                    kept[later[pair]] = False
    return kept
