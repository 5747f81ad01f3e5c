"""What a path sees of a cloud on its whole way, of flights and plans alike, and how it moves meanwhile.

A log may hold a hundred poses a second with jitter of centimetres, or two. Averaged over half a second, what
it says about time and motion no longer depends on that.
"""

import itertools
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from upplied.config import VisibilitySettings
from upplied.geometry.polylines import cumulated, leg_lengths, pieces_of_legs
from upplied.geometry.poses import angle_between, fov_at, in_a_row, interpolate, normalised
from upplied.geometry.scene import Scene
from upplied.planning.visibility.line_of_sight import coarseness, visible
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record, Trajectory

STEP_S = 0.5
_INNER = 10  # poses that each step is averaged over
#: What `coverage_paper_pct` calls seen (paper, Sec. III-C), whatever the preset.
BY_FRUSTUM = VisibilitySettings(occlusion=False)
#: What `coverage_seen_pct` calls seen, whatever the preset.
TRULY = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)
_STEP_M, _STEP_RAD = 0.5, np.radians(3.0)  # between the poses that are asked what they see
_MOST = 3000


@dataclass(frozen=True, eq=False, repr=False)
class Moments(Record):
    """A flight in even steps of time."""

    poses: Trajectory  # K poses, each the mean over its step
    step_s: Floats  # (K,) s that each stands for
    velocity: Floats  # (K, 3) m/s, structure frame
    turn: Floats  # (K, 3) rad/s, angular velocity of the camera, structure frame

    def __len__(self) -> int:
        return len(self.step_s)


def moments(flight: Trajectory, breaks: Ints | None = None) -> Moments:
    """Steps of about half a second, none of them across a gap in the log (`breaks`: the first pose after)."""
    inner = {int(b) for b in breaks if 0 < b < len(flight)} if breaks is not None else set()
    cuts = [0, *sorted(inner), len(flight)]
    parts = [_even(flight, first, last) for first, last in itertools.pairwise(cuts)]
    return Moments(
        in_a_row([part.poses for part in parts]),
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("step_s", "velocity", "turn")),
    )


def _even(flight: Trajectory, first: int, last: int) -> Moments:
    part = flight.take(slice(first, last))
    if len(part) == 1:  # between two gaps: it shows something, but not for how long
        return Moments(part, np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)))
    begin, end = float(part.t_s[0]), float(part.t_s[-1])
    number = max(1, round((end - begin) / STEP_S))
    step = (end - begin) / number
    fine = interpolate(part, begin + (np.arange(number * _INNER) + 0.5) * step / _INNER)
    positions = fine.positions.reshape(number, _INNER, 3).mean(axis=1)
    quats = fine.quat_xyzw.reshape(number, _INNER, 4)
    alike = np.einsum("nij,nj->ni", quats, quats[:, 0]) < 0
    quats = normalised(np.asarray(np.where(alike[:, :, None], -quats, quats).mean(axis=1), float))
    times = np.asarray(begin + (np.arange(number) + 0.5) * step, float)
    poses = Trajectory(times, positions, quats, fov_at(part, times))
    return Moments(poses, np.full(number, step), *rates(poses))


def rates(poses: Trajectory) -> tuple[Floats, Floats]:
    """Velocity (K, 3), m/s, and angular velocity (K, 3), rad/s, of each pose, structure frame.

    Each is the mean of those of the legs before and after it.
    """
    if len(poses) < 2:
        return np.zeros((len(poses), 3)), np.zeros((len(poses), 3))
    step = np.maximum(np.diff(poses.t_s), 1e-9)[:, None]
    quats = Rotation.from_quat(poses.quat_xyzw)
    legs = np.diff(poses.positions, axis=0) / step
    turns = (quats[1:] * quats[:-1].inv()).as_rotvec() / step
    velocity, turn = (
        (np.concatenate([of[:1], of]) + np.concatenate([of, of[-1:]])) / 2 for of in (legs, turns)
    )
    return velocity, turn


@njit(cache=True, inline="always")
def motion_of(
    ray: Floats, distance: float, velocity: Floats, turn: Floats
) -> float:  # pragma: no cover - compiled
    """How fast what lies along a ray (3,), m, moves in the picture, rad/s.

    A point at rest moves against the camera at ``-turn x b - (v - b (b . v)) / d`` in direction b.
    """
    b_x, b_y, b_z = ray[0] / distance, ray[1] / distance, ray[2] / distance
    along = b_x * velocity[0] + b_y * velocity[1] + b_z * velocity[2]
    x = turn[1] * b_z - turn[2] * b_y + (velocity[0] - along * b_x) / distance
    y = turn[2] * b_x - turn[0] * b_z + (velocity[1] - along * b_y) / distance
    z = turn[0] * b_y - turn[1] * b_x + (velocity[2] - along * b_z) / distance
    return float(np.sqrt(x * x + y * y + z * z))


@njit(cache=True, inline="always")
def sight_to(position: Floats, point: Floats, normal: Floats, ray: Floats) -> tuple[float, float]:
    """Distance, m, and cosine of incidence of a point from a position; `ray`, m, is filled."""
    squared, facing = 0.0, 0.0
    for axis in range(3):
        ray[axis] = point[axis] - position[axis]
        squared += ray[axis] * ray[axis]
        facing -= ray[axis] * normal[axis]
    distance = max(np.sqrt(squared), 1e-9)
    return distance, facing / distance


@dataclass(frozen=True, eq=False, repr=False)
class Views(Record):
    """What a path sees of a cloud, asked at closely spaced poses."""

    stations: Trajectory  # P poses
    seen: Bools  # (P, N)
    # (P,) what distances are to be taken times, so that zooms compare (`line_of_sight.coarseness`)
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

        `points` (N, 3) are what `seen` is of; without normals all cosines are 0. With `carry` (3, 3) lines of
        sight are carried before they are measured.
        """
        carry = np.eye(3) if carry is None else carry
        normals = np.zeros((len(points), 3)) if normals is None else normals
        positions = self.stations.positions @ carry.T
        return _nearest(positions, points @ carry.T, normals, self.seen, self.coarseness)

    def shown_well(self, cloud: Cloud, farthest_m: Floats, sharp_radps: float, least_cosine: float) -> Bools:
        """Which samples (N,) of what `seen` is of some pose sees finely, frontally and slowly enough at once.

        `farthest_m` (N,) is of a frontal look; an oblique one is nearer by the cosine of its incidence. NaN:
        not asked for. `sharp_radps` is the largest motion of the sample in the picture.
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
    """What a trajectory sees of a cloud on its whole way; for the measures by `BY_FRUSTUM` or `TRULY`."""
    thinned = stations(trajectory)
    poses, fov_deg = (thinned.positions, thinned.quat_xyzw), thinned.fov_deg
    seen = visible(*poses, cloud, camera, settings, scene, fov_deg=fov_deg).seen
    return Views(thinned, seen, coarseness(camera, fov_deg))


def stations_at(shown: Views, steps: Moments) -> Ints:
    """The station (K,) of some views that is nearest in time to each moment."""
    times = shown.stations.t_s
    if len(times) == 1:
        return np.zeros(len(steps), np.int64)
    after = np.clip(np.searchsorted(times, steps.poses.t_s), 1, len(times) - 1)
    earlier = steps.poses.t_s - times[after - 1] <= times[after] - steps.poses.t_s
    return np.asarray(after - earlier, np.int64)


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
