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
    start, second, distance = _neighbours(points, normals, pairs)
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
    tree, sides = cKDTree(points[kept]), normals[kept]
    choice = tree.query(points)[1]
    # The nearest of all is mostly on the same side.
    asked = np.flatnonzero(~(np.einsum("ni,ni->n", sides[choice], normals) > 0))
    near = tree.query(points[asked], k=[*range(1, min(8, len(kept)) + 1)])[1]
    facing = np.einsum("nki,ni->nk", sides[near], normals[asked]) > 0
    choice[asked] = near[np.arange(len(asked)), np.argmax(facing, axis=1)]
    return np.asarray(np.bincount(choice, weights=area, minlength=len(kept)), float)


@njit(cache=True)
def _neighbours(points: Floats, normals: Floats, pairs: Ints) -> tuple[Ints, Ints, Floats]:
    """Of pairs (P, 2) on one side: where each point's begin (N + 1,), the others, and how far they are, m."""
    start = np.zeros(len(points) + 2, np.int64)
    far = np.full(len(pairs), -1.0)
    for pair in range(len(pairs)):
        one, other = pairs[pair]
        facing, square = 0.0, 0.0
        for axis in range(3):
            facing += normals[one, axis] * normals[other, axis]
            square += (points[one, axis] - points[other, axis]) ** 2
        if facing > 0:
            far[pair] = np.sqrt(square)
            start[one + 2] += 1
    start = np.cumsum(start)
    second, distance = np.empty(start[-1], np.int64), np.empty(start[-1])
    for pair in range(len(pairs)):
        if far[pair] >= 0:
            place = start[pairs[pair, 0] + 1]
            second[place], distance[place] = pairs[pair, 1], far[pair]
            start[pairs[pair, 0] + 1] += 1
    return start[:-1], second, distance


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
