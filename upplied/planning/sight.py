"""Lines of sight where only samples of a surface are at hand, and no mesh: discs stand in the way.

Against the mesh it errs where surfaces are nearer to each other than their samples; it needs neither
the mesh nor the ray caster, so that a question is answered before these were loaded.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.planning.boxes import spacing
from upplied.planning.measure import TRULY
from upplied.records import Bools, Camera, Cloud, Floats, Ints

_NEAR = 0.5  # of the spacing: discs so near to a sample are its own surface


def in_sight(cloud: Cloud, wanted: Ints, stations: Floats, camera: Camera) -> Bools:
    """Which samples of a surface are truly seen from any of some places, the camera turned as it likes.

    Parameters
    ----------
    cloud : Cloud
        With normals and areas: each sample hides what lies behind a disc round its area.
    wanted : array of int, shape (K,)
        The samples asked for.
    stations : array, shape (S, 3), m, structure frame
    camera : Camera
        Its range counts, its field of view does not.

    Returns
    -------
    array of bool, shape (K,)
    """
    assert cloud.normals is not None and cloud.area_m2 is not None
    return np.asarray(
        _in_sight(
            np.ascontiguousarray(cloud.points),
            np.ascontiguousarray(cloud.normals),
            cloud.area_m2 / 2,  # squared radius of the circle round a square of that area
            np.asarray(wanted, np.int64),
            np.ascontiguousarray(stations),
            (camera.min_range_m, camera.max_range_m),
            np.cos(np.radians(TRULY.max_incidence_deg)),
            _NEAR * spacing(cloud),
        ),
        bool,
    )


@njit(cache=True)
def _in_sight(
    points: Floats,
    normals: Floats,
    radius2: Floats,
    wanted: Ints,
    stations: Floats,
    ranges: tuple[float, float],
    least_cosine: float,
    near: float,
) -> Bools:
    found = np.zeros(len(wanted), np.bool_)
    cosine = np.empty(len(stations))
    for row in range(len(wanted)):
        at, normal = points[wanted[row]], normals[wanted[row]]
        for station in range(len(stations)):
            ray = stations[station] - at
            length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            facing = (ray[0] * normal[0] + ray[1] * normal[1] + ray[2] * normal[2]) / max(length, 1e-12)
            cosine[station] = facing if ranges[0] <= length <= ranges[1] else -1.0
        for _ in range(len(stations)):  # the most frontal view first: it is free most often
            best = np.argmax(cosine)
            if cosine[best] < least_cosine:
                break
            if _free(at, stations[best], points, normals, radius2, near):
                found[row] = True
                break
            cosine[best] = -1.0
    return found


@njit(cache=True)
def _free(start: Floats, end: Floats, points: Floats, normals: Floats, radius2: Floats, near: float) -> bool:
    """Whether no disc crosses the line."""
    ax, ay, az = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length = np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / length, ay / length, az / length
    for disc in range(len(points)):
        x, y, z = points[disc, 0] - start[0], points[disc, 1] - start[1], points[disc, 2] - start[2]
        passed = x * ax + y * ay + z * az
        if x * x + y * y + z * z - passed * passed > radius2[disc]:
            continue  # the line passes by, as it does by nearly all
        across = ax * normals[disc, 0] + ay * normals[disc, 1] + az * normals[disc, 2]
        if abs(across) < 1e-9:
            continue
        along = (x * normals[disc, 0] + y * normals[disc, 1] + z * normals[disc, 2]) / across
        if along < near or along > length:
            continue
        x, y, z = ax * along - x, ay * along - y, az * along - z
        if x * x + y * y + z * z < radius2[disc]:
            return False
    return True
