"""From how near, and how frontally, a path sees each sample of a surface."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.planning.visibility.moments import motion_of, sight_to
from upplied.records import Bools, Floats


@njit(cache=True)
def nearest(positions: Floats, points: Floats, seen: Bools, coarse: Floats) -> Floats:
    """For each of the points (3, N) its smallest distance (N,) over the poses that see it.

    `coarse` (P,) is what each pose's distances are taken times (`frustum.coarseness`).
    """
    x, y, z = points[0], points[1], points[2]
    squared = np.full(len(x), np.inf)
    for pose in range(len(positions)):
        at_x, at_y, at_z = positions[pose, 0], positions[pose, 1], positions[pose, 2]
        row = seen[pose]
        for index in range(len(x)):
            dx, dy, dz = at_x - x[index], at_y - y[index], at_z - z[index]
            gap = (dx * dx + dy * dy + dz * dz) * (coarse[pose] * coarse[pose])
            nearer = row[index] & (gap < squared[index])
            squared[index] = gap if nearer else squared[index]
    return np.sqrt(squared)


@njit(cache=True)
def nearest_views(
    positions: Floats, points: Floats, normals: Floats, seen: Bools, coarse: Floats
) -> tuple[Floats, Floats]:
    """For each point its smallest distance, and largest cosine of incidence, over the poses that see it.

    `coarse` (P,) is what each pose's distances are taken times (`frustum.coarseness`).
    """
    near, frontal = np.full(len(points), np.inf), np.full(len(points), -1.0)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if seen[pose, index]:
                x = positions[pose, 0] - points[index, 0]
                y = positions[pose, 1] - points[index, 1]
                z = positions[pose, 2] - points[index, 2]
                distance = np.sqrt(x * x + y * y + z * z)
                near[index] = min(near[index], distance * coarse[pose])
                facing = x * normals[index, 0] + y * normals[index, 1] + z * normals[index, 2]
                frontal[index] = max(frontal[index], facing / max(distance, 1e-12))
    return near, frontal


@njit(cache=True)
def shown_well(
    positions: Floats,
    velocity: Floats,
    turn: Floats,
    points: Floats,
    normals: Floats,
    seen: Bools,
    coarse: Floats,
    farthest_m: Floats,
    least_cosine: float,
    sharp_radps: float,
) -> Bools:
    """Which points (N,) some pose sees from near enough, frontally enough and slowly enough, all at once.

    Parameters
    ----------
    positions, velocity, turn : array, shape (P, 3)
        m, m/s, rad/s.
    points, normals : array, shape (N, 3)
    seen : array of bool, shape (P, N)
    coarse : array, shape (P,)
        What each pose's distances are taken times (`frustum.coarseness`).
    farthest_m : array, shape (N,)
        NaN: not asked for.
    least_cosine : float
        Of the incidence.
    sharp_radps : float
        Of the point's motion in the picture.
    """
    shown = np.zeros(len(points), np.bool_)
    ray = np.empty(3)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if shown[index] or not seen[pose, index]:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            if not distance * coarse[pose] <= farthest_m[index] or cosine < least_cosine:
                continue
            shown[index] = motion_of(ray, distance, velocity[pose], turn[pose]) <= sharp_radps
    return shown
