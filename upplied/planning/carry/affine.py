"""Poses carried from the demonstration structure to the target (paper, Eqs. 1 and 2).

Every carrier here is an affine map per axis, applied after the registration's rotation, and turns
the camera with it: what was in the middle of the picture stays in the middle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.config import TransferSettings
from upplied.geometry.poses import matrices, normalised
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.demonstration.repetition import Take
from upplied.planning.geometry.clouds import axis_ratios, box_scale
from upplied.records import (
    Cloud,
    Floats,
    Record,
    Registration,
    Trajectory,
    Waypoints,
)


@dataclass(frozen=True, eq=False, repr=False)
class AxisMap(Record):
    """``p_target = matrix @ p_demo + offset``."""

    matrix: Floats  # (3, 3)
    offset: Floats  # (3,) m

    def points(self, points: Floats) -> Floats:
        """Points (..., 3), m, demonstration frame to target frame."""
        return points @ self.matrix.T + self.offset

    def orientations(self, quat_xyzw: Floats) -> Floats:
        """Camera orientations (N, 4): the optical axis is carried as a direction, the horizon with it."""
        return carried_orientation(self.matrix, quat_xyzw)


def zscore_map(source: Cloud, target: Cloud) -> AxisMap:
    """Standardise with one cloud's mean and deviation, and back with the other's (Eqs. 1 and 2).

    A flat structure has no deviation along one axis; there the scale is 1.
    """
    scale = axis_ratios(target.points.std(axis=0), source.points.std(axis=0))
    return AxisMap(np.diag(scale), target.points.mean(axis=0) - scale * source.points.mean(axis=0))


def box_map(source: Cloud, target: Cloud) -> AxisMap:
    """The paper's baseline: scale by the ratio of the bounding boxes (Sec. IV)."""
    scale = box_scale(target.points, source.points)
    return AxisMap(np.diag(scale), target.points.min(axis=0) - scale * source.points.min(axis=0))


def published_map(method: str, source: Cloud, target: Cloud) -> AxisMap:
    """The map of `TransferSettings.method` ``zscore`` or ``box``."""
    return zscore_map(source, target) if method == "zscore" else box_map(source, target)


def registered_map(registration: Registration) -> AxisMap:
    """The inverse of the registration: where the demonstration's space lies on the target."""
    matrix = registration.turn.T @ (registration.rotation / registration.scale[None, :]).T
    return AxisMap(matrix, -matrix @ registration.translation)


def carried_orientation(jacobian: Floats, quat_xyzw: Floats) -> Floats:
    """Orientations after a local linear map of space, made orthonormal again.

    Parameters
    ----------
    jacobian : array, shape (3, 3) or (N, 3, 3)
    quat_xyzw : array, shape (N, 4)

    Notes
    -----
    Forward is carried exactly. Up is carried with it and gives the plane of both, to which left is
    normal: under a scaling along the axes a vertical plane stays vertical, so a level horizon stays level.
    """
    axes = jacobian @ matrices(quat_xyzw)
    forward = axes[..., 0] / np.linalg.norm(axes[..., 0], axis=-1, keepdims=True)
    left = np.cross(axes[..., 2], forward)
    left /= np.linalg.norm(left, axis=-1, keepdims=True)
    frame = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    return normalised(Rotation.from_matrix(frame).as_quat())


def aimed(
    quat_xyzw: Floats, positions: Floats, aim: Floats, before_quat: Floats, before_to_aim: Floats
) -> Floats:
    """Turn each camera by the smallest rotation that brings its aim to its old place in the picture.

    Parameters
    ----------
    quat_xyzw : array, shape (N, 4)
        Orientations to correct.
    positions, aim : array, shape (N, 3), m
        The camera now, and what it should look at; NaN aims leave the orientation alone.
    before_quat : array, shape (N, 4)
        Demonstrated orientation.
    before_to_aim : array, shape (N, 3), m
        Demonstrated vector from the camera to the centre of what it saw.
    """
    in_picture = np.einsum("nji,nj->ni", matrices(before_quat), before_to_aim)
    now = np.einsum("nij,nj->ni", matrices(quat_xyzw), in_picture)
    wanted = aim - positions
    turn = _smallest_rotations(now, wanted)
    return normalised((turn * Rotation.from_quat(quat_xyzw)).as_quat())


def _smallest_rotations(a: Floats, b: Floats) -> Rotation:
    """Rotations that turn each direction `a` onto `b`; none where either is not a direction."""
    length_a, length_b = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    usable = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1) & (length_a > 0) & (length_b > 0)
    unit_a = np.where(usable[:, None], a, [1.0, 0, 0]) / np.where(usable, length_a, 1)[:, None]
    unit_b = np.where(usable[:, None], b, [1.0, 0, 0]) / np.where(usable, length_b, 1)[:, None]
    axis = np.cross(unit_a, unit_b)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, np.sum(unit_a * unit_b, axis=1))
    axis = np.where(sine[:, None] > 1e-12, axis / np.where(sine > 1e-12, sine, 1)[:, None], [0.0, 0, 1])
    return Rotation.from_rotvec(axis * angle[:, None])


def demonstrated_on_target(take: Take) -> Floats:
    """The demonstrated positions after the box transform, with the target turned as it was registered.

    However the target stands: at the declared heading, turned about the vertical, or tipped over.
    """
    voxels, flown = take.pair.voxels, take.inspection.by_frustum.stations.positions
    return registered_map(box_on_box(voxels.source, voxels.target, standing(take.pair))).points(flown)


def standing(pair: Pair) -> Floats:
    """The turn (3, 3) of the target that makes it stand as the source does.

    Paths are z-scored along the axes of the source, so that a turned target changes no figure.
    """
    registration = pair.surface.registration
    return registration.rotation @ registration.turn


def plane_height(flight: Trajectory, pair: Pair, carried: Floats, settings: TransferSettings) -> float:
    """Height of the plane at the target, m.

    With the stand-off kept, as high above the ground as demonstrated (a robot does not grow), where
    both grounds are known; else where the structure's map carries the flight.

    Parameters
    ----------
    flight : Trajectory
        In the source's frame.
    pair : Pair
    carried : array, shape (M, 3), m, target frame
        The carried flight.
    settings : TransferSettings
    """
    here, there = pair.source.surroundings.ground_z_m, pair.target.surroundings.ground_z_m
    if settings.standoff != "kept" or here is None or there is None:
        return float(carried[:, 2].mean())
    return there + float(flight.positions[:, 2].mean()) - here


def at_height(path: Waypoints, height_m: float) -> Waypoints:
    """The same waypoints, all at one height."""
    positions = np.array(path.positions)
    positions[:, 2] = height_m
    return replace(path, positions=positions)
