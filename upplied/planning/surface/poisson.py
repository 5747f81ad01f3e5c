"""Even spacing: from many candidates on a surface to few samples that keep apart (Poisson discs)."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from upplied.records import Floats, Ints


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
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0]
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    order = np.argsort(pairs[:, 0], kind="stable")
    first, second, distance = pairs[order, 0], pairs[order, 1], distance[order]
    start = np.searchsorted(first, np.arange(len(points) + 1))
    low, high = 0.0, reach
    kept = np.ones(len(points), bool)
    for _ in range(12):
        middle = (low + high) / 2
        kept = _greedy(start, second, distance, middle)
        if kept.sum() > number:
            low = middle
        else:
            high = middle
    return np.flatnonzero(kept)


def shares(points: Floats, normals: Floats, area: Floats, kept: Ints) -> Floats:
    """The area (K,) of all candidates, each given to the nearest kept sample on its own side."""
    candidates = min(8, len(kept))
    near = cKDTree(points[kept]).query(points, k=candidates)[1].reshape(len(points), candidates)
    facing = np.einsum("nki,ni->nk", normals[kept][near], normals) > 0
    choice = near[np.arange(len(points)), np.argmax(facing, axis=1)]
    return np.asarray(np.bincount(choice, weights=area, minlength=len(kept)), float)


@njit(cache=True)
def _greedy(start: Ints, other: Ints, distance: Floats, radius: float) -> np.ndarray:
    """Keep each candidate in turn unless one kept before lies within the radius."""
    number = len(start) - 1
    kept = np.ones(number, np.bool_)
    for index in range(number):
        if kept[index]:
            for pair in range(start[index], start[index + 1]):
                if distance[pair] < radius:
                    kept[other[pair]] = False
    return kept
