"""Rotations and rigid motions on arrays of poses; quaternions are ``x y z w`` throughout.

The camera frame is x forward (optical axis), y left, z up. A pilot's gimbal gives yaw and pitch
and no roll: yaw is counter-clockwise from +X seen from above, pitch is positive upwards.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from upplied.geometry.polylines import interpolated
from upplied.records import Floats, Trajectory

_STEEP = 0.1  # an optical axis that is less far across than this much of up or down has no heading


def look_at(positions: Floats, targets: Floats) -> Floats:
    """Orientations (N, 4) without roll that point the optical axis from positions to targets (N, 3), m.

    Straight up or down, yaw is 0.
    """
    ray = np.asarray(targets, float) - np.asarray(positions, float)
    flat = np.hypot(ray[..., 0], ray[..., 1])
    return from_yaw_pitch(np.arctan2(ray[..., 1], ray[..., 0]), np.arctan2(ray[..., 2], flat))


def from_yaw_pitch(yaw_rad: Floats, pitch_rad: Floats) -> Floats:
    """Quaternions (N, 4) ``x y z w`` without roll; yaw from +X to +Y, pitch positive upwards, rad."""
    yaw, pitch = np.broadcast_arrays(np.asarray(yaw_rad, float), np.asarray(pitch_rad, float))
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    cp, sp = np.cos(pitch / 2), np.sin(-pitch / 2)  # about +y (left), up is negative
    return np.stack([-sy * sp, cy * sp, sy * cp, cy * cp], axis=-1)


def yaw_pitch(quat_xyzw: Floats) -> tuple[Floats, Floats]:
    """Yaw and pitch (rad) of the optical axis of each orientation; roll is ignored.

    Within some degrees of straight up or down, where that axis has no heading, the yaw is that of the
    left axis: a camera that looks at a roof from above keeps its heading.
    """
    axes = matrices(quat_xyzw)
    return _heading_elevation(axes[..., :, 0], axes[..., :, 1])


def facing(forward: Floats, left: Floats) -> Floats:
    """Orientations (N, 4) without roll of cameras with these optical and left axes (N, 3), of any length."""
    return from_yaw_pitch(*_heading_elevation(forward, left))


def _heading_elevation(forward: Floats, left: Floats) -> tuple[Floats, Floats]:
    flat = np.hypot(forward[..., 0], forward[..., 1])
    steep = flat < _STEEP * np.abs(forward[..., 2])
    ahead = np.arctan2(forward[..., 1], forward[..., 0])
    yaw = np.where(steep, np.arctan2(-left[..., 0], left[..., 1]), ahead)
    return yaw, np.arctan2(forward[..., 2], flat)


def optical_axis(quat_xyzw: Floats) -> Floats:
    """Unit vector (N, 3) along which each camera looks, structure frame."""
    return matrices(quat_xyzw)[..., :, 0]


def matrices(quat_xyzw: Floats) -> Floats:
    """Rotation matrices (N, 3, 3), camera to structure; columns are forward, left, up."""
    quats = np.asarray(quat_xyzw, float)
    return Rotation.from_quat(quats.reshape(-1, 4)).as_matrix().reshape(*quats.shape[:-1], 3, 3)


def normalised(quat_xyzw: Floats) -> Floats:
    """Unit quaternions with w >= 0, so that equal orientations have equal numbers."""
    quats = np.asarray(quat_xyzw, float)
    quats = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    return np.where(quats[..., 3:] < 0, -quats, quats)


def mean_rotation(quat_xyzw: Floats) -> Floats:
    """Mean orientation (4,) of (N, 4), in the least-squares sense of the chordal distance."""
    return normalised(Rotation.from_quat(quat_xyzw).mean().as_quat())


def without_roll(quat_xyzw: Floats) -> Floats:
    """The same optical axes with the horizon level."""
    return from_yaw_pitch(*yaw_pitch(quat_xyzw))


def angle_between(a_xyzw: Floats, b_xyzw: Floats) -> Floats:
    """Angle (rad) of the rotation from each `a` to its `b`."""
    dot = np.abs(np.sum(normalised(a_xyzw) * normalised(b_xyzw), axis=-1))
    return 2 * np.arccos(np.clip(dot, 0, 1))


def interpolate(trajectory: Trajectory, t_s: Floats) -> Trajectory:
    """Poses at other times (M,), s: linear in position, spherical in orientation; ends are held."""
    if len(trajectory) == 1:
        return replace(trajectory.take(np.zeros(len(t_s), np.int64)), t_s=np.asarray(t_s, float))
    times = np.clip(t_s, trajectory.t_s[0], trajectory.t_s[-1])
    positions = interpolated(times, trajectory.t_s, trajectory.positions)
    quats = Slerp(trajectory.t_s, Rotation.from_quat(trajectory.quat_xyzw))(times).as_quat()
    return Trajectory(np.asarray(t_s, float), positions, normalised(quats), fov_at(trajectory, times))


def fov_at(trajectory: Trajectory, t_s: Floats) -> Floats | None:
    """Fields of view (M, 2), deg, at times of a flight whose camera zooms; None where it does not."""
    if trajectory.fov_deg is None:
        return None
    return interpolated(t_s, trajectory.t_s, trajectory.fov_deg)


def wrapped(angle: Floats) -> Floats:
    """The same angles from -pi to pi, rad."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def moved(trajectory: Trajectory, rotation: Floats, translation: Floats) -> Trajectory:
    """The trajectory after a rigid motion: ``p' = rotation @ p + translation``."""
    quats = (Rotation.from_matrix(rotation) * Rotation.from_quat(trajectory.quat_xyzw)).as_quat()
    positions = trajectory.positions @ rotation.T + translation
    return replace(trajectory, positions=positions, quat_xyzw=normalised(quats))


def in_a_row(parts: Sequence[Trajectory]) -> Trajectory:
    """Several flights one after another, as one, in the times that they have."""
    zoom = [part.fov_deg for part in parts if part.fov_deg is not None]
    columns = zip(*((part.t_s, part.positions, part.quat_xyzw) for part in parts), strict=True)
    t_s, positions, quats = map(np.concatenate, columns)
    return Trajectory(t_s, positions, quats, np.concatenate(zoom) if len(zoom) == len(parts) else None)
