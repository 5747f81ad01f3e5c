"""A flight in even steps of time: how long, how fast and how steadily a camera looks.

A log may hold a hundred poses a second with jitter of centimetres, or two. Averaged over half a second,
what it says about time and motion no longer depends on that.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import fov_at, in_a_row, interpolate, normalised
from upplied.records import Floats, Ints, Record, Trajectory

STEP_S = 0.5
_INNER = 10  # poses that each step is averaged over


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
    """Steps of about half a second, none of them across a gap in the log.

    Parameters
    ----------
    flight : Trajectory
    breaks : array of int, optional
        First pose after each gap.
    """
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
