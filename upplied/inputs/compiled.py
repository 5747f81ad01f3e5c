"""Loops over vertices and triangles that numpy would have to sort for."""

from __future__ import annotations

import numpy as np
from numba import njit

_CELLS = 8  # a cell's edge over the welding distance: most points need to look into one or two cells


@njit(cache=True)
def first_near(points: np.ndarray, reach: float) -> np.ndarray:  # pragma: no cover - compiled
    """For each point (N, 3) the first kept one within reach, itself where there is none.

    Kept points lie farther than `reach` from each other, so doing it twice changes nothing. They are
    hung up in chains by the hash of their cell; distances decide, whatever else shares the chain.
    """
    number = len(points)
    size = 1
    while size < 2 * number:
        size *= 2
    head = np.full(size, -1, np.int64)
    after = np.full(number, -1, np.int64)
    first = np.arange(number)
    cell = np.empty(3, np.int64)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    edge = _CELLS * reach
    for i in range(number):
        for axis in range(3):
            scaled = points[i, axis] / edge
            cell[axis] = np.int64(np.floor(scaled))
            low[axis] = np.int64(np.floor(scaled - 1.0 / _CELLS))
            high[axis] = np.int64(np.floor(scaled + 1.0 / _CELLS))
        best = number
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                for z in range(low[2], high[2] + 1):
                    j = head[_slot(x, y, z, size)]
                    while j >= 0:
                        apart = 0.0
                        for axis in range(3):
                            apart += (points[i, axis] - points[j, axis]) ** 2
                        if j < best and apart <= reach * reach:
                            best = j
                        j = after[j]
        if best < number:
            first[i] = best
        else:
            at = _slot(cell[0], cell[1], cell[2], size)
            after[i] = head[at]
            head[at] = i
    return first


@njit(cache=True)
def _slot(x: int, y: int, z: int, size: int) -> int:  # pragma: no cover - compiled
    """Where a cell or a triangle hangs in a table whose size is a power of two."""
    mixed = x * 73856093 ^ y * 19349663 ^ z * 83492791
    mixed ^= mixed >> 17
    return mixed & (size - 1)


@njit(cache=True)
def faults(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:  # pragma: no cover - compiled
    """(T,) 1 for triangles without area, 2 for those with the corners of an earlier one, else 0."""
    number = len(triangles)
    size = 1
    while size < 2 * number:
        size *= 2
    head = np.full(size, -1, np.int64)
    after = np.full(number, -1, np.int64)
    found = np.zeros(number, np.uint8)
    for t in range(number):
        i, j, k = triangles[t]
        if _sliver(vertices[i], vertices[j], vertices[k]) or i == j or j == k or k == i:
            found[t] = 1
            continue
        a, c = min(i, j, k), max(i, j, k)
        b = i + j + k - a - c
        at = _slot(a, b, c, size)
        other = head[at]
        while other >= 0:
            p, q, r = triangles[other]
            if min(p, q, r) == a and max(p, q, r) == c and p + q + r == a + b + c:
                found[t] = 2
                break
            other = after[other]
        if found[t] == 0:
            after[t] = head[at]
            head[at] = t
    return found


@njit(cache=True)
def _sliver(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:  # pragma: no cover - compiled
    """Whether the height is rounding noise: such a triangle has no normal either."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
    # The height over the longest edge, in metres, squared; and relative to that edge.
    return nx * nx + ny * ny + nz * nz <= max(1e-18 * longest, 1e-20 * longest * longest)


@njit(cache=True)
def boxes(
    vertices: np.ndarray, triangles: np.ndarray, label: np.ndarray
) -> tuple:  # pragma: no cover - compiled
    """Corners (L, 3), low and high, of the box of the triangles of each label."""
    number = 0
    for t in range(len(label)):
        number = max(number, label[t] + 1)
    low = np.full((number, 3), np.inf)
    high = np.full((number, 3), -np.inf)
    for t in range(len(triangles)):
        for corner in range(3):
            for axis in range(3):
                value = vertices[triangles[t, corner], axis]
                low[label[t], axis] = min(low[label[t], axis], value)
                high[label[t], axis] = max(high[label[t], axis], value)
    return low, high


@njit(cache=True)
def longest_edges(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:  # pragma: no cover - compiled
    """(T,) length of the longest edge of each triangle."""
    longest = np.zeros(len(triangles))
    for t in range(len(triangles)):
        for corner in range(3):
            a, b = vertices[triangles[t, corner]], vertices[triangles[t, (corner + 1) % 3]]
            squared = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
            longest[t] = max(longest[t], squared)
    return np.sqrt(longest)
