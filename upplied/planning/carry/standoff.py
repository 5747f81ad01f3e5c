"""From how far a camera sees what it looks at.

The demonstrated stand-off is asked of what the expert saw, the planned one of its counterparts. Scaled with
the structure it is the weighted median distance over the picture: a picture of a structure twice as large,
from twice as far, shows the same. Kept in metres, or set by a ground sampling distance, it is the distance to
what is in the middle of the picture: the rest of what the expert saw lies farther apart on a larger
structure, partly outside of the picture, and says nothing of how near the camera is.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial.distance import cdist

from upplied.config import TransferSettings, focal_px
from upplied.planning.carry.affine import AxisMap
from upplied.planning.constants import FOVEA, TOLERANCE
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record

_LEAST_M2 = 1e-6  # squared distance, so that nothing is divided by none
_SEEN = 32  # counterparts that speak for what a viewpoint sees
_BESIDE = 0.01  # attention, that what is beside the subject counts at least


@dataclass(frozen=True, eq=False, repr=False)
class Standoff(Record):
    """How far each viewpoint was from what it saw, and what corresponds to that on the target."""

    station: Ints  # (V,) of the path
    seen: Floats  # (V, S, 3) m, counterparts of what fills the picture, each for an equal share of it
    wanted_m: Floats  # (V,) median distance
    in_metres: bool = False  # asked for by the user as a length, not as what a picture of that size takes

    @property
    def usual_m(self) -> float:
        """Median over the viewpoints, m; 0 where there are none."""
        return float(np.median(self.wanted_m)) if len(self.wanted_m) else 0.0


def picture_share(positions: Floats, source: Cloud, known: Ints, seen: Bools, attention: Floats) -> Floats:
    """How much of each picture (M, K) is about each of K samples, `seen` (M, K) in it or not.

    That is the solid angle under which the camera sees it, how much of the picture it fills, times its
    `attention` (N,): who flies round an engine means the engine, though the fuselage behind it fills more of
    the pictures. A picture of nothing else is about what is beside the subject.
    """
    area, points = source.areas[known], np.ascontiguousarray(source.points[known])
    if source.normals is None:
        angles = area / np.maximum(cdist(positions, points, "sqeuclidean"), _LEAST_M2)
    else:
        normals = np.ascontiguousarray(source.normals[known])
        angles = _solid_angles(np.ascontiguousarray(positions), points, normals, area)
    return np.asarray(angles * seen * np.maximum(attention[known], _BESIDE))


@njit(cache=True)
def _solid_angles(positions: Floats, points: Floats, normals: Floats, area: Floats) -> Floats:
    """Under which each position (M, 3) sees surface of an area (K,) at each point, (M, K)."""
    angles = np.zeros((len(positions), len(points)))
    for pose in range(len(positions)):
        for sample in range(len(points)):
            squared, facing = 0.0, 0.0
            for axis in range(3):
                ray = positions[pose, axis] - points[sample, axis]
                squared += ray * ray
                facing += ray * normals[sample, axis]
            squared = max(squared, _LEAST_M2)
            angles[pose, sample] = area[sample] * max(facing, 0.0) / (squared * np.sqrt(squared))
    return angles


@dataclass(frozen=True, eq=False, repr=False)
class Counted(Record):
    """What the stand-off of each camera is counted to, and how much it should be."""

    weight: Floats  # (M, K) share of each picture that each counterpart fills, any unit
    points: Floats  # (K, 3) m, the counterparts
    middle: Floats | None  # (M, 3) m, what corresponds to the middle of each picture; None: all of it counts
    wanted_m: Floats  # (M,) NaN where a camera sees nothing
    before: Floats | None = None  # (M, 3) m, on the source: what `middle` corresponds to

    def distance(self, positions: Floats) -> Floats:
        """Stand-off (M,), m, of cameras there; NaN where one sees nothing."""
        if self.middle is None:
            return median_distance(positions, self.points, self.weight)
        return np.linalg.norm(positions - self.middle, axis=1)

    def at(self, station: Ints) -> Standoff:
        """The stand-off of some of the cameras, each at its station of the path."""
        weight, wanted_m = self.weight[station], self.wanted_m[station]
        useful = np.flatnonzero(np.isfinite(wanted_m) & weight.any(axis=1))
        if self.middle is not None:
            return Standoff(station[useful], self.middle[station][useful, None], wanted_m[useful], True)
        chosen = np.empty((len(useful), _SEEN), np.int64)
        for row, viewpoint in enumerate(useful):
            share = np.cumsum(weight[viewpoint])
            chosen[row] = np.searchsorted(share, share[-1] * (np.arange(_SEEN) + 0.5) / _SEEN)
        return Standoff(station[useful], self.points[chosen], wanted_m[useful])


def counted(
    positions: Floats,
    weight: Floats,
    here: Floats,
    there: Floats,
    carrier: AxisMap,
    settings: TransferSettings,
    camera: Camera,
    nearest_m: float,
    coarse: Floats | None = None,
) -> Counted:
    """From how far each camera should see what on the target.

    Parameters
    ----------
    positions : array, shape (M, 3), m
        Demonstrated, source frame.
    weight : array, shape (M, K)
        Share of each picture that is about each sample (`picture_share`), 0 for what is not seen.
    here, there : array, shape (K, 3), m
        The samples on the source, and their counterparts on the target; `carrier` maps all of its space.
    settings : TransferSettings
        `scaled` takes the distances as the structure's map carries them, `kept` as flown, and a ground
        sampling distance sets the distance at which one pixel covers it in the middle of the picture.
    camera, nearest_m
        The camera's range and the safety distance, m, bound the stand-off.
    coarse : array, shape (M,), optional
        How coarsely each camera shows beside `camera`, where it zooms.
    """
    before = middle = None
    if settings.gsd_m is not None and camera.width_px:
        before, middle = _middles(positions, weight, here, there)
        sampled = settings.gsd_m * focal_px(camera.width_px, camera.hfov_deg)
        standoff_m = np.where(weight.any(axis=1), sampled / (1.0 if coarse is None else coarse), np.nan)
    elif settings.standoff == "kept":
        before, middle = _middles(positions, weight, here, there)
        standoff_m = np.linalg.norm(positions - before, axis=1)
    else:
        sight = carrier.matrix
        standoff_m = median_distance(positions @ sight.T, here @ sight.T, weight)
    # So that the middle of the view is in range.
    lowest = max(nearest_m, camera.min_range_m) * (1 + TOLERANCE)
    standoff_m = np.clip(standoff_m, lowest, max((1 - TOLERANCE) * camera.max_range_m, lowest))
    return Counted(weight, there, middle, standoff_m, before)


def _middles(positions: Floats, weight: Floats, here: Floats, there: Floats) -> tuple[Floats, Floats]:
    """What is in the middle of each picture, (M, 3), m, and its counterpart; NaN where nothing is seen."""
    # The middle is about the centre of what is seen, within some degrees: what is beside it is at another
    # depth, or round the corner.
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = (weight @ here) / weight.sum(axis=1)[:, None] - positions
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        ahead = towards @ here.T - np.einsum("mj,mj->m", towards, positions)[:, None]
        tangent = cdist(positions, here, "sqeuclidean") / np.maximum(ahead, 1e-9) ** 2 - 1
        tangent = np.where((weight > 0) & (ahead > 0), tangent, np.inf)
        least = tangent.min(axis=1, keepdims=True, initial=1e18)
        near = weight * np.exp(-(tangent - least) / (2 * (FOVEA / 2) ** 2))  # 1 for the nearest seen
        total = near.sum(axis=1)[:, None]
        return (near @ here) / total, (near @ there) / total


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
