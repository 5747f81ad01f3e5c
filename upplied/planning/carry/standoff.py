"""From how far a camera sees what it looks at: the weighted median distance over the picture.

The demonstrated stand-off is asked of what the expert saw, the planned one of its counterparts. It is
scaled with the structure, kept in metres, or set by a ground sampling distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial.distance import cdist

from upplied.config import TransferSettings
from upplied.planning.carry.affine import AxisMap
from upplied.planning.surface.parts import labels_of
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record

NEAR = 0.2  # of the wanted stand-off, that a viewpoint may be off and still counts as keeping it
_LEAST_M2 = 1e-6  # squared distance, so that nothing is divided by none
_SEEN = 32  # counterparts that speak for what a viewpoint sees


@dataclass(frozen=True, eq=False, repr=False)
class Standoff(Record):
    """How far each viewpoint was from what it saw, and what answers to that on the target."""

    station: Ints  # (V,) of the path
    seen: Floats  # (V, S, 3) m, counterparts of what fills the picture, each for an equal share of it
    wanted_m: Floats  # (V,) median distance

    @property
    def usual_m(self) -> float:
        """Median over the viewpoints, m; 0 where there are none."""
        return float(np.median(self.wanted_m)) if len(self.wanted_m) else 0.0

    def ratio(self, positions: Floats) -> Floats:
        """Stand-off over the wanted one, (V,), of a path with the same stations."""
        ray = self.seen - positions[self.station][:, None]
        return np.median(np.linalg.norm(ray, axis=2), axis=1) / self.wanted_m

    def share(self, positions: Floats) -> float:
        """Share of the viewpoints that stand as far off as wanted, within a fifth; 1 where there are none."""
        if len(self.station) == 0:
            return 1.0
        return float(np.mean(np.abs(self.ratio(positions) - 1) <= NEAR))


def picture_share(positions: Floats, source: Cloud, known: Ints, inspected: Bools) -> Floats:
    """How much of each picture (M, K) is about each of K samples.

    That is the solid angle under which the camera sees it, how much of the picture it fills, times
    the squared share of its part that the flight saw at all: who flies round an engine means the
    engine, though the fuselage behind it fills more of the pictures.

    Parameters
    ----------
    positions : array, shape (M, 3), m
    source : Cloud
        N surface samples.
    known : array of int, shape (K,)
        The samples asked about.
    inspected : array of bool, shape (N,)
        What the whole flight saw.
    """
    area = np.ones(len(source)) if source.area_m2 is None else source.area_m2
    label = labels_of(source)
    meant = np.bincount(label, weights=area * inspected) / np.bincount(label, weights=area)
    weight = area[known] * meant[label[known]] ** 2
    points = np.ascontiguousarray(source.points[known])
    if source.normals is None:
        squared = np.maximum(cdist(positions, points, "sqeuclidean"), _LEAST_M2)
        return np.asarray(weight / squared)
    normals = np.ascontiguousarray(source.normals[known])
    return np.asarray(_solid_angles(np.ascontiguousarray(positions), points, normals, weight))


@njit(cache=True)
def _solid_angles(positions: Floats, points: Floats, normals: Floats, weight: Floats) -> Floats:
    """Under which each position (M, 3) sees surface of an area `weight` (K,) at each point, (M, K)."""
    angles = np.zeros((len(positions), len(points)))
    for pose in range(len(positions)):
        for sample in range(len(points)):
            squared, facing = 0.0, 0.0
            for axis in range(3):
                ray = positions[pose, axis] - points[sample, axis]
                squared += ray * ray
                facing += ray * normals[sample, axis]
            squared = max(squared, _LEAST_M2)
            angles[pose, sample] = weight[sample] * max(facing, 0.0) / (squared * np.sqrt(squared))
    return angles


def expected_standoff(
    positions: Floats,
    weight: Floats,
    points: Floats,
    carrier: AxisMap,
    settings: TransferSettings,
    camera: Camera,
    nearest_m: float,
) -> Floats:
    """How far each camera should stand from what it sees, (M,), m; NaN where it sees nothing.

    The demonstrated stand-off is the median distance over the picture. `scaled` takes the
    distances as the structure's map carries them, `kept` as flown, and a ground sampling distance
    sets the distance at which one pixel covers it in the middle of the picture.
    """
    if settings.gsd_m is not None and camera.width_px:
        pixel = 2 * np.tan(np.radians(min(camera.hfov_deg, 170.0)) / 2) / camera.width_px
        wanted = np.where(weight.any(axis=1), settings.gsd_m / pixel, np.nan)
    else:
        jacobian = carried_sight(carrier, settings)
        wanted = median_distance(positions @ jacobian.T, points @ jacobian.T, weight)
    lowest = max(nearest_m, camera.min_range_m) * 1.15  # so that the middle of the view is not too near
    return np.clip(wanted, lowest, max(0.9 * camera.max_range_m, lowest))


def carried_sight(carrier: AxisMap, settings: TransferSettings) -> Floats:
    """How a demonstrated line of sight is carried, (3, 3): with the structure, or as long as it was."""
    return carrier.matrix if settings.standoff == "scaled" else np.eye(3)


def median_distance(positions: Floats, points: Floats, weight: Floats) -> Floats:
    """Weighted median distance (M,) from each position to the points it sees; NaN where there are none."""
    return np.asarray(_medians(*(np.ascontiguousarray(item, float) for item in (positions, points, weight))))


@njit(cache=True)
def _medians(positions: Floats, points: Floats, weight: Floats) -> Floats:
    medians = np.full(len(positions), np.nan)
    for index in range(len(positions)):
        seen = np.flatnonzero(weight[index] > 0)
        if len(seen) == 0:
            continue
        distance = np.empty(len(seen))
        for place, sample in enumerate(seen):
            squared = 0.0
            for axis in range(3):
                squared += (points[sample, axis] - positions[index, axis]) ** 2
            distance[place] = np.sqrt(squared)
        order = np.argsort(distance)  # whatever the order of equals, the median is the same
        half, share = weight[index][seen].sum() / 2, 0.0
        for place in order:
            share += weight[index, seen[place]]
            if share >= half:
                medians[index] = distance[place]
                break
    return medians


def standoff_of(station: Ints, weight: Floats, seen: Floats, wanted_m: Floats) -> Standoff:
    """The stand-off of viewpoints from shares of the picture.

    Parameters
    ----------
    station : array of int, shape (V,)
    weight : array, shape (V, K)
        Share of each viewpoint's picture that each of K counterparts fills, any unit.
    seen : array, shape (K, 3), m
    wanted_m : array, shape (V,), m
        NaN where a viewpoint sees nothing: it is left out.
    """
    useful = np.flatnonzero(np.isfinite(wanted_m) & weight.any(axis=1))
    chosen = np.empty((len(useful), _SEEN), np.int64)
    for row, viewpoint in enumerate(useful):
        share = np.cumsum(weight[viewpoint])
        chosen[row] = np.searchsorted(share, share[-1] * (np.arange(_SEEN) + 0.5) / _SEEN)
    return Standoff(station[useful], seen[chosen], wanted_m[useful])
