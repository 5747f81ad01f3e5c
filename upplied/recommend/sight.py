"""Lines of sight among surface samples without a mesh: each sample is an opaque disc.

It differs from the mesh where surfaces are nearer to each other than their samples. It needs neither
the mesh nor the ray caster, so that queries need not load them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit

from upplied.planning.geometry.clouds import spacing
from upplied.planning.visibility.observations import TRULY
from upplied.records import Bools, Camera, Cloud, Floats, Ints

_OWN_SURFACE = 0.5  # of the spacing: nearer discs belong to the sample's own surface
_CELLS = 10  # along the longest side: the discs in one cell are a bunch


def in_sight(cloud: Cloud, wanted: Ints, stations: Floats, camera: Camera) -> Bools:
    """The samples of a surface that are seen from any of the stations, with the camera turned freely.

    Parameters
    ----------
    cloud : Cloud
        With normals and areas: each sample is an opaque disc of its area.
    wanted : array of int, shape (K,)
        Samples to test.
    stations : array, shape (S, 3), m, structure frame
    camera : Camera
        Only its range counts.

    Returns
    -------
    array of bool, shape (K,)
    """
    visible = _in_sight(
        np.ascontiguousarray(cloud.points[wanted]),
        np.ascontiguousarray(cloud.outward[wanted]),
        np.ascontiguousarray(stations),
        (camera.min_range_m, camera.max_range_m),
        np.cos(np.radians(TRULY.max_incidence_deg)),
        _OWN_SURFACE * spacing(cloud),
        *_discs(cloud.points, cloud.outward, cloud.areas),
    )
    return np.asarray(visible, bool)


def _discs(points: Floats, normals: Floats, area_m2: Floats) -> tuple[Floats, Ints, Floats]:
    """Discs as rows of centre, normal and squared radius; the start of each bunch, and a ball round it."""
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0).max(), 1e-9)
    cell = ((points - low) / size * (_CELLS - 1e-6)).astype(np.int64) @ np.array([_CELLS**2, _CELLS, 1])
    order = np.argsort(cell, kind="stable")
    radius2 = area_m2 / 2  # of the circle round a square of that area
    discs = np.column_stack([points, normals, radius2])[order]
    start = np.flatnonzero(np.diff(cell[order], prepend=-1, append=-1))
    balls = np.empty((len(start) - 1, 4))
    for bunch, (first, last) in enumerate(pairwise(start)):
        own = discs[first:last]
        middle = (own[:, :3].min(axis=0) + own[:, :3].max(axis=0)) / 2
        reach = np.linalg.norm(own[:, :3] - middle, axis=1) + np.sqrt(own[:, 6])
        balls[bunch] = *middle, reach.max()
    return discs, start, balls


@njit(cache=True)
def _in_sight(
    points: Floats,
    normals: Floats,
    stations: Floats,
    ranges: tuple[float, float],
    least_cosine: float,
    near: float,
    discs: Floats,
    start: Ints,
    balls: Floats,
) -> Bools:
    visible = np.zeros(len(points), np.bool_)
    cosine = np.empty(len(stations))
    for row in range(len(points)):
        at, normal = points[row], normals[row]
        for station in range(len(stations)):
            ray = stations[station] - at
            length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            facing = (ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]) / max(length, 1e-12)
            cosine[station] = facing if ranges[0] <= length <= ranges[1] else -1.0
        for _ in range(len(stations)):  # the most frontal view first: it is rarely occluded
            best = np.argmax(cosine)
            if cosine[best] < least_cosine:
                break
            if _free(at, stations[best], near, discs, start, balls):
                visible[row] = True
                break
            cosine[best] = -1.0
    return visible


@njit(cache=True)
def _free(begin: Floats, end: Floats, near: float, discs: Floats, start: Ints, balls: Floats) -> bool:
    """Whether no disc crosses the line."""
    ax, ay, az = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
    length = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    for bunch in range(len(balls)):
        x, y, z = balls[bunch, 0] - begin[0], balls[bunch, 1] - begin[1], balls[bunch, 2] - begin[2]
        along, reach = x * ax + y * ay + z * az, balls[bunch, 3]
        if along < -reach or along > length + reach or x * x + y * y + z * z - along**2 > reach**2:
            continue
        for disc in range(start[bunch], start[bunch + 1]):
            across = ax * discs[disc, 3] + ay * discs[disc, 4] + az * discs[disc, 5]
            if abs(across) < 1e-9:
                continue
            x, y, z = discs[disc, 0] - begin[0], discs[disc, 1] - begin[1], discs[disc, 2] - begin[2]
            along = (x * discs[disc, 3] + y * discs[disc, 4] + z * discs[disc, 5]) / across
            if along < near or along > length:
                continue
            x, y, z = ax * along - x, ay * along - y, az * along - z
            if x * x + y * y + z * z < discs[disc, 6]:
                return False
    return True
