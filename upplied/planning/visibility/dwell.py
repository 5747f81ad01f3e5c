"""How a flight looked at each patch of a surface: from how near, how frontally, for how long, from where.

A look counts where the patch is in view, seen frontally enough, and moves slowly enough in the picture to
be sharp. A demonstration and a plan are asked in the same manner, in steps of half a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.planning.visibility.moments import Moments, motion_of, sight_to
from upplied.planning.visibility.path_views import Views
from upplied.records import Bools, Cloud, Floats, Ints, Rows
from upplied.vectors import sphere

_SIDES = 60  # directions of the sphere, some 26 deg apart, that looks are distinguished by
_NEIGHBOUR = np.cos(np.radians(30.0))


@dataclass(frozen=True, eq=False, repr=False)
class Dwell(Rows):
    """The sharp looks at each of N patches."""

    near_m: Floats  # (N,) distance of the nearest, of one camera where it zooms; inf for none
    carried_m: Floats  # (N,) the same after the lines of sight are carried to another structure
    frontal: Floats  # (N,) cosine of the least incidence; -1 for none
    held_s: Floats  # (N,) how long in all
    time_s: Floats  # (N,) mean moment; NaN for none
    sides: Bools  # (N, 60) directions from which it was looked at


def dwell(
    steps: Moments,
    shown: Views,
    cloud: Cloud,
    sharp_radps: float,
    least_cosine: float,
    carry: Floats | None = None,
) -> Dwell:
    """The sharp looks of a flight at each sample of a surface.

    Parameters
    ----------
    steps : Moments
    shown : Views
        What the flight truly sees of the samples, in the same time.
    cloud : Cloud
        N samples with normals.
    sharp_radps : float
        Largest motion in the picture.
    least_cosine : float
        Of the incidence.
    carry : array, shape (3, 3), optional
        How a line of sight is carried to the structure that `sides` are compared on.
    """
    station = stations_at(shown, steps)
    found = _dwelt(
        *(np.ascontiguousarray(of) for of in (steps.poses.positions, steps.velocity, steps.turn)),
        steps.poses.t_s,
        steps.step_s,
        np.ascontiguousarray(shown.seen[station]),
        np.ascontiguousarray(shown.coarseness[station]),
        np.ascontiguousarray(cloud.points),
        np.ascontiguousarray(cloud.outward),
        sharp_radps,
        least_cosine,
        np.ascontiguousarray(np.eye(3) if carry is None else carry),
        sphere(_SIDES),
    )
    near, carried, frontal, held, time, sides = found
    with np.errstate(invalid="ignore", divide="ignore"):
        return Dwell(near, carried, frontal, held, time / held, sides)


def stations_at(shown: Views, steps: Moments) -> Ints:
    """The station (K,) of some views that is nearest in time to each moment."""
    times = shown.stations.t_s
    if len(times) == 1:
        return np.zeros(len(steps), np.int64)
    after = np.clip(np.searchsorted(times, steps.poses.t_s), 1, len(times) - 1)
    earlier = steps.poses.t_s - times[after - 1] <= times[after] - steps.poses.t_s
    return np.asarray(after - earlier, np.int64)


def widened(sides: Bools) -> Bools:
    """The same sides and their neighbours on the sphere, within 30 deg."""
    way = sphere(_SIDES)
    return np.asarray(sides.astype(np.float32) @ (way @ way.T >= _NEIGHBOUR).astype(np.float32) > 0, bool)


@njit(cache=True)
def _dwelt(
    positions: Floats,
    velocity: Floats,
    turn: Floats,
    t_s: Floats,
    step_s: Floats,
    seen: Bools,
    coarse: Floats,
    points: Floats,
    normals: Floats,
    sharp: float,
    least_cosine: float,
    carry: Floats,
    ways: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Bools]:
    number = len(points)
    near, reached, frontal = np.full(number, np.inf), np.full(number, np.inf), np.full(number, -1.0)
    held, time = np.zeros(number), np.zeros(number)
    sides = np.zeros((number, len(ways)), np.bool_)
    ray, carried = np.empty(3), np.empty(3)
    for pose in range(len(positions)):
        for index in range(number):
            if not seen[pose, index]:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            if cosine < least_cosine or motion_of(ray, distance, velocity[pose], turn[pose]) > sharp:
                continue
            near[index] = min(near[index], distance * coarse[pose])
            frontal[index] = max(frontal[index], cosine)
            held[index] += step_s[pose]
            time[index] += step_s[pose] * t_s[pose]
            squared = 0.0
            for axis in range(3):
                carried[axis] = carry[axis, 0] * ray[0] + carry[axis, 1] * ray[1] + carry[axis, 2] * ray[2]
                squared += carried[axis] * carried[axis]
            reached[index] = min(reached[index], np.sqrt(squared) * coarse[pose])
            best, side = -np.inf, 0
            for way in range(len(ways)):
                along = -(ways[way, 0] * carried[0] + ways[way, 1] * carried[1] + ways[way, 2] * carried[2])
                if along > best:
                    best, side = along, way
            sides[index, side] = True
    return near, reached, frontal, held, time, sides
