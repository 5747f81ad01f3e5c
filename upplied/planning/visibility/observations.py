"""What a path sees of a cloud on its whole way, and how it looks at it: of flights and plans alike.

Closely spaced poses are asked what they see. A look counts where the patch is in view, seen frontally enough,
and moves slowly enough in the picture to be sharp; it is asked in steps of half a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numba import njit

from upplied.config import VisibilitySettings
from upplied.planning.visibility.frustum import coarseness
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.moments import Moments, motion_of, rates, sight_to
from upplied.polylines import cumulated, leg_lengths, pieces_of_legs
from upplied.poses import angle_between, interpolate
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Rows, Trajectory
from upplied.scene import Scene
from upplied.vectors import sphere

#: What `coverage_paper_pct` calls seen (paper, Sec. III-C), whatever the preset.
BY_FRUSTUM = VisibilitySettings(occlusion=False)
#: What `coverage_seen_pct` calls seen, whatever the preset.
TRULY = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)

_STEP_M, _STEP_RAD = 0.5, np.radians(3.0)  # between the poses that are asked what they see
_MOST = 3000


@dataclass(frozen=True, eq=False, repr=False)
class Views(Record):
    """What a path sees of a cloud, asked at closely spaced poses."""

    stations: Trajectory  # P poses
    seen: Bools  # (P, N)
    # (P,) what distances are to be taken times, so that zooms compare (`frustum.coarseness`)
    coarse: Floats | None = field(default=None, metadata={"later": True})

    @property
    def coarseness(self) -> Floats:
        """(P,) the same; ones where the camera does not zoom."""
        return np.ones(len(self.stations)) if self.coarse is None else self.coarse

    @property
    def total(self) -> Bools:
        """(N,) seen from any pose."""
        return np.asarray(self.seen.any(axis=0), bool)

    def nearest(
        self, points: Floats, normals: Floats | None = None, carry: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Smallest distance, m, and largest cosine of the incidence of each point, (N,); else inf and -1.

        Parameters
        ----------
        points : array, shape (N, 3), m
            What `seen` is of.
        normals : array, shape (N, 3), optional
            Without them all cosines are 0.
        carry : array, shape (3, 3), optional
            How lines of sight are carried before they are measured.
        """
        carry = np.eye(3) if carry is None else carry
        normals = np.zeros((len(points), 3)) if normals is None else normals
        return _nearest(
            self.stations.positions @ carry.T, points @ carry.T, normals, self.seen, self.coarseness
        )

    def shown_well(self, cloud: Cloud, farthest_m: Floats, sharp_radps: float, least_cosine: float) -> Bools:
        """Which samples (N,) some pose sees finely, frontally and slowly enough, all at once.

        Parameters
        ----------
        cloud : Cloud
            What `seen` is of, with normals.
        farthest_m : array, shape (N,), m
            Of a frontal look; an oblique one is nearer by the cosine of its incidence. NaN: not asked for.
        sharp_radps : float
            Largest motion of the sample in the picture.
        least_cosine : float
            Of the incidence.
        """
        moving, points = (self.stations.positions, *rates(self.stations)), (cloud.points, cloud.outward)
        looks = (*(np.ascontiguousarray(of) for of in (*moving, *points)), self.seen, self.coarseness)
        return np.asarray(_shown_well(*looks, farthest_m, least_cosine, sharp_radps), bool)


def stations(trajectory: Trajectory, most: int = _MOST) -> Trajectory:
    """Closely spaced poses of a trajectory: its own, and between them every half metre or 3 degrees.

    Where that is more than `most`, the spacing grows; a trajectory with more poses than that is
    thinned evenly, so that what is found to be seen is never more than what is seen.
    """
    if len(trajectory) < 2:
        return trajectory
    progress = leg_lengths(trajectory.positions) / _STEP_M
    progress += angle_between(trajectory.quat_xyzw[:-1], trajectory.quat_xyzw[1:]) / _STEP_RAD
    if len(trajectory) >= most:
        along = cumulated(progress + 1e-9)
        chosen = np.searchsorted(along, np.linspace(0, along[-1], most), side="left")
        chosen = np.unique(np.clip(chosen, 0, len(trajectory) - 1))
        return trajectory.take(chosen)
    coarseness = max(1.0, float(progress.sum()) / (most - len(trajectory)))
    pieces = np.maximum(np.ceil(progress / coarseness - 1e-9).astype(int), 1)
    legs, part = pieces_of_legs(pieces)
    times = trajectory.t_s[legs] + part * np.diff(trajectory.t_s)[legs]
    return interpolate(trajectory, np.append(times, trajectory.t_s[-1]))


def views(
    trajectory: Trajectory,
    cloud: Cloud,
    camera: Camera,
    settings: VisibilitySettings,
    scene: Scene | None = None,
) -> Views:
    """What a trajectory sees of a cloud on its whole way; ask a demonstration in the same manner.

    Parameters
    ----------
    trajectory : Trajectory
    cloud : Cloud
    camera : Camera
    settings : VisibilitySettings
        `BY_FRUSTUM` or `TRULY` for the measures.
    scene : Scene, optional
    """
    asked = stations(trajectory)
    poses, fov_deg = (asked.positions, asked.quat_xyzw), asked.fov_deg
    seen = visible(*poses, cloud, camera, settings, scene, fov_deg=fov_deg).seen
    return Views(asked, seen, coarseness(camera, fov_deg))


@njit(cache=True)
def _nearest(
    positions: Floats, points: Floats, normals: Floats, seen: Bools, coarse: Floats
) -> tuple[Floats, Floats]:
    near, frontal, ray = np.full(len(points), np.inf), np.full(len(points), -1.0), np.empty(3)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if seen[pose, index]:
                distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
                near[index] = min(near[index], distance * coarse[pose])
                frontal[index] = max(frontal[index], cosine)
    return near, frontal


@njit(cache=True)
def _shown_well(
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
    shown = np.zeros(len(points), np.bool_)
    ray = np.empty(3)
    for pose in range(len(positions)):
        for index in range(len(points)):
            if shown[index] or not seen[pose, index]:
                continue
            distance, cosine = sight_to(positions[pose], points[index], normals[index], ray)
            if not distance * coarse[pose] <= farthest_m[index] * cosine or cosine < least_cosine:
                continue
            shown[index] = motion_of(ray, distance, velocity[pose], turn[pose]) <= sharp_radps
    return shown


_SIDES = 60  # directions of the sphere, some 26 deg apart, that looks are distinguished by
_NEIGHBOUR = np.cos(np.radians(30.0))


@dataclass(frozen=True, eq=False, repr=False)
class Dwell(Rows):
    """The sharp looks at each of N patches."""

    # (N,) distance of the finest over the cosine of its incidence, of one camera where it zooms; inf for none
    near_m: Floats
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
    near, carried, frontal, held, time, sides = _dwelt(
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
    near = (way @ way.T >= _NEIGHBOUR).astype(np.float32)
    return np.asarray(sides.astype(np.float32) @ near > 0, bool)


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
            if (
                cosine < max(least_cosine, 1e-6)
                or motion_of(ray, distance, velocity[pose], turn[pose]) > sharp
            ):
                continue
            near[index] = min(near[index], distance / cosine * coarse[pose])
            frontal[index] = max(frontal[index], cosine)
            held[index] += step_s[pose]
            time[index] += step_s[pose] * t_s[pose]
            squared = 0.0
            for axis in range(3):
                carried[axis] = carry[axis, 0] * ray[0] + carry[axis, 1] * ray[1] + carry[axis, 2] * ray[2]
                squared += carried[axis] * carried[axis]
            reached[index] = min(reached[index], np.sqrt(squared) / cosine * coarse[pose])
            best, side = -np.inf, 0
            for way in range(len(ways)):
                along = -(ways[way, 0] * carried[0] + ways[way, 1] * carried[1] + ways[way, 2] * carried[2])
                if along > best:
                    best, side = along, way
            sides[index, side] = True
    return near, reached, frontal, held, time, sides
