"""Coverage: the share of what is to be shown that no station shows, made differentiable.

A station shows a sample by a share from 0 to 1 that falls smoothly across the limit of the incidence,
the borders of the picture and the farthest distance; the path shows it unless every station fails to.
What stands in the way is found by rays from the path as it is, and holds until they are cast again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.planning.visibility.frustum import coarseness
from upplied.records import Bools, Floats, Ints, Record

_MOST = 0.98  # that one station shows: a second look at the same sample is worth a little


@dataclass(frozen=True, eq=False, repr=False)
class Coverage(Record):
    """Share of the need that is not shown, 0 to 1."""

    points: Floats  # (N, 3) m
    normals: Floats  # (N, 3)
    need: Floats  # (N,) sums to 1
    farthest_m: Floats  # (N,)
    start: Ints  # (M + 1,) of each station's samples in `sample`
    sample: Ints  # (P,) to which a station has a free line of sight
    half_rad: Floats  # (M, 2) half the field of view, across and up
    coarse: Floats  # (M,) what each station's distances are taken times
    least_cosine: Floats  # (N,) of the incidence
    width: float  # over which a share falls: of the cosine, of the border's angle in rad, of the distance

    @classmethod
    def of(
        cls, view: View, chosen: Ints, need: Floats, free: Bools, width: float, stride: int = 1
    ) -> Coverage:
        """The term for some samples (N,) of a view, with the free lines of sight (M, N) to them.

        With a stride, those of every so many stations.
        """
        station, sample = np.nonzero(free)
        station = stride * station
        halves = view.halves_rad(stride * len(free) if view.fov_deg is None else len(view.fov_deg))
        coarse = coarseness(view.camera, view.fov_deg)
        usual = float(np.cos(np.radians(view.settings.max_incidence_deg)))
        own = view.least_cosine
        return cls(
            points=view.cloud.points[chosen],
            normals=view.cloud.outward[chosen],
            need=need / need.sum(),
            farthest_m=view.farthest_m[chosen],
            start=np.searchsorted(station, np.arange(stride * len(free) + 1)),
            sample=sample,
            half_rad=halves,
            coarse=np.ones(len(halves)) if coarse is None else coarse,
            least_cosine=np.full(len(chosen), usual) if own is None else np.maximum(own[chosen], usual),
            width=width,
        )

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Share of the need that is missed, and its slope."""
        missed, slope = _missed(
            flown.positions,
            flown.yaw,
            flown.pitch,
            self.points,
            self.normals,
            self.need,
            self.farthest_m,
            self.start,
            self.sample,
            self.half_rad,
            self.coarse,
            self.least_cosine,
            self.width,
        )
        return missed, Flown(slope[:, :3], slope[:, 3], slope[:, 4])


@njit(cache=True, inline="always", error_model="numpy")
def _step(value: float, width: float) -> tuple[float, float]:
    """Smooth step from 0 at half a width below zero to 1 at one and a half above, and its slope."""
    part = (value / width + 0.5) / 2
    if part <= 0:
        return 0.0, 0.0
    if part >= 1:
        return 1.0, 0.0
    return part * part * (3 - 2 * part), 3 * part * (1 - part) / width


@njit(cache=True, error_model="numpy")
def _missed(
    positions: Floats,
    yaw: Floats,
    pitch: Floats,
    points: Floats,
    normals: Floats,
    need: Floats,
    farthest_m: Floats,
    start: Ints,
    sample: Ints,
    half_rad: Floats,
    coarse: Floats,
    least_cosine: Floats,
    width: float,
) -> tuple[float, Floats]:
    """Missed share, and its slope (M, 5) with respect to x, y, z, yaw and pitch of each station."""
    # Of the pairs that are shown at all, one after another: what is not shown is not written either.
    shown, slopes = np.empty(len(sample)), np.empty((len(sample), 5))
    what, first, count = np.empty(len(sample), np.int64), np.zeros(len(positions) + 1, np.int64), 0
    left, outside = np.ones(len(need)), width * width / 4
    for m in range(len(positions)):
        first[m + 1] = first[m]
        if start[m] == start[m + 1]:
            continue
        sin_h, cos_h = np.sin(half_rad[m, 0]), np.cos(half_rad[m, 0])
        sin_v, cos_v = np.sin(half_rad[m, 1]), np.cos(half_rad[m, 1])
        round_ = half_rad[m, 0] >= np.pi / 2  # so wide a field that there is no picture plane
        cy, sy, cp, sp = np.cos(yaw[m]), np.sin(yaw[m]), np.cos(pitch[m]), np.sin(pitch[m])
        for k in range(start[m], start[m + 1]):
            i = sample[k]
            ux, uy, uz = (
                points[i, 0] - positions[m, 0],
                points[i, 1] - positions[m, 1],
                points[i, 2] - positions[m, 2],
            )
            level = cy * ux + sy * uy
            x, y, z = cp * level + sp * uz, cy * uy - sy * ux, cp * uz - sp * level  # in the camera's frame
            side, above = 1.0 if y >= 0 else -1.0, 1.0 if z >= 0 else -1.0
            squared = ux * ux + uy * uy + uz * uz
            # Most lie outside of the picture: by more than the step's half width, no root is needed.
            h = x * sin_h - side * y * cos_h
            if h < 0 and h * h >= outside * squared:
                continue
            ahead = np.sqrt(x * x + y * y) if round_ else x
            v = ahead * sin_v - above * z * cos_v
            if v < 0 and v * v >= outside * squared:
                continue
            d = max(np.sqrt(squared), 1e-9)
            ux, uy, uz, level, x, y, z, ahead = (
                ux / d,
                uy / d,
                uz / d,
                level / d,
                x / d,
                y / d,
                z / d,
                ahead / d,
            )
            facing = -(ux * normals[i, 0] + uy * normals[i, 1] + uz * normals[i, 2])
            a, da = _step(facing - least_cosine[i], width)
            b, db = _step(facing - d * coarse[m] / farthest_m[i], width)  # fine enough, as obliquely as it is
            c, dc = _step(h / d, width)  # sine of the angle to the border's plane
            e, de = _step(v / d, width)
            if a * b * c * e == 0.0:
                continue
            share = _MOST * a * b * c * e
            shown[count], what[count] = share, i
            left[i] *= 1.0 - share
            gb, gc, ge = a * db * c * e, a * b * dc * e, a * b * c * de
            ga = da * b * c * e + gb  # of the cosine of the incidence
            fx, fy = 1.0, 0.0
            if round_:
                fx, fy = x / max(ahead, 1e-9), y / max(ahead, 1e-9)
            wx = gc * sin_h + ge * sin_v * fx
            wy = ge * sin_v * fy - gc * side * cos_h
            wz = -ge * above * cos_v
            slopes[count, 3] = wx * cp * y - wy * level - wz * sp * y
            slopes[count, 4] = wx * z - wz * x
            # with respect to the unit ray u, then to the position: du / dp = -(I - u u^T) / d
            gx = wx * cp * cy - wy * sy - wz * sp * cy - ga * normals[i, 0]
            gy = wx * cp * sy + wy * cy - wz * sp * sy - ga * normals[i, 1]
            gz = wx * sp + wz * cp - ga * normals[i, 2]
            along = gx * ux + gy * uy + gz * uz
            out = gb * coarse[m] / farthest_m[i]
            slopes[count, 0] = out * ux - (gx - along * ux) / d
            slopes[count, 1] = out * uy - (gy - along * uy) / d
            slopes[count, 2] = out * uz - (gz - along * uz) / d
            count += 1
        first[m + 1] = count
    total = np.zeros((len(positions), 5))
    for m in range(len(positions)):
        for k in range(first[m], first[m + 1]):
            factor = -_MOST * need[what[k]] * left[what[k]] / (1.0 - shown[k])
            for axis in range(5):
                total[m, axis] += factor * slopes[k, axis]
    missed = 0.0
    for i in range(len(need)):
        missed += need[i] * left[i]
    return missed, total
