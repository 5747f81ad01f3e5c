"""Poses carried from the demonstration structure to the target (paper, Eqs. 1 to 3).

Every carrier here is an affine map per axis, applied after the registration's rotation, and turns
the camera with it: what was in the middle of the picture stays in the middle. The paper's viewpoints are
refined one by one after that (Alg. 2, Eq. 3).
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg.lapack import dgelsd, dgelsd_lwork
from scipy.spatial.transform import Rotation

from upplied.config import RefineSettings, Settings, TransferSettings
from upplied.geometry.poses import matrices, normalised
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.demonstration.repetition import Take
from upplied.planning.geometry.clouds import axis_ratios, box_scale
from upplied.records import (
    Cloud,
    Correspondences,
    Floats,
    Record,
    Registration,
    Trajectory,
    Viewpoints,
    Waypoints,
)

_SINGULAR = 1e-6  # of the largest singular value: directions that the points in view do not determine


@dataclass(frozen=True, eq=False, repr=False)
class AxisMap(Record):
    """``p_target = matrix @ p_demo + offset``."""

    matrix: Floats  # (3, 3)
    offset: Floats  # (3,) m

    def points(self, points: Floats) -> Floats:
        """Points (..., 3), m, demonstration frame to target frame."""
        return points @ self.matrix.T + self.offset


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


#: The maps of `TransferSettings.method`.
PUBLISHED = {"zscore": zscore_map, "box": box_map}


def registered_map(registration: Registration) -> AxisMap:
    """The inverse of the registration: where the demonstration's space lies on the target."""
    matrix = registration.turn.T @ (registration.rotation / registration.scale[None, :]).T
    return AxisMap(matrix, -matrix @ registration.translation)


def carried_orientation(jacobian: Floats, quat_xyzw: Floats) -> Floats:
    """Orientations (N, 4) after a local linear map of space, (3, 3) or (N, 3, 3), made orthonormal again.

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
    a, b = now, aim - positions
    # None where either is not a direction.
    length_a, length_b = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    usable = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1) & (length_a > 0) & (length_b > 0)
    unit_a = np.where(usable[:, None], a, [1.0, 0, 0]) / np.where(usable, length_a, 1)[:, None]
    unit_b = np.where(usable[:, None], b, [1.0, 0, 0]) / np.where(usable, length_b, 1)[:, None]
    axis = np.cross(unit_a, unit_b)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, np.sum(unit_a * unit_b, axis=1))
    axis = np.where(sine[:, None] > 1e-12, axis / np.where(sine > 1e-12, sine, 1)[:, None], [0.0, 0, 1])
    turn = Rotation.from_rotvec(axis * angle[:, None])
    return normalised((turn * Rotation.from_quat(quat_xyzw)).as_quat())


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
    both grounds are known; else where the structure's map `carried` the flight, (M, 3), m.
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


def gauss_newton(
    start: Floats,
    viewpoints: Viewpoints,
    source: Cloud,
    target: Cloud,
    correspondences: Correspondences,
    settings: RefineSettings,
) -> Floats:
    """Move each viewpoint until its distances to what it should see are the demonstrated ones.

    All is standardised by each cloud's mean and deviation. The residual is ``r = d_T - d_D`` over all points
    of the viewpoint (Eq. 3), its Jacobian the unit vectors from the points to the camera. Distances to a
    plane do not know their side: 1 to 3 % of the starts end mirrored behind the surface. The preset `paper`
    keeps that, as published.

    Parameters
    ----------
    start : array, shape (K, 3), m, target frame
        Transferred viewpoints.
    viewpoints : Viewpoints
        The demonstrated ones, in the source's frame.
    """
    mean_d, mean_t = source.points.mean(axis=0), target.points.mean(axis=0)
    spreads = source.points.std(axis=0), target.points.std(axis=0)
    sigma_d, sigma_t = (np.where(one > 1e-9 * one.max(), one, 1.0) for one in spreads)
    refined = np.array(start, float)
    for index in range(len(viewpoints)):
        seen = viewpoints.seen[index] & (correspondences.target_index >= 0)
        if np.count_nonzero(seen) < 3:
            continue  # fewer than three distances do not place a point
        camera_d = (viewpoints.positions[index] - mean_d) / sigma_d
        points_d = (source.points[seen] - mean_d) / sigma_d
        points_t = (target.points[correspondences.target_index[seen]] - mean_t) / sigma_t
        distances = np.linalg.norm(points_d - camera_d, axis=1)
        camera_t = _solve((start[index] - mean_t) / sigma_t, points_t, distances, settings.iterations)
        refined[index] = camera_t * sigma_t + mean_t
    return refined


def _solve(camera: Floats, points: Floats, distances: Floats, iterations: int) -> Floats:
    """Plain Gauss-Newton with the least-norm step; of all iterates the one with the least residual."""
    # Without that choice single viewpoints run off by kilometres where the points in view lie in a plane.
    here, best, least = camera, camera, np.inf
    residual, jacobian = np.empty(len(points)), np.empty(points.shape)
    room = [int(size) for size in dgelsd_lwork(*points.shape, 1, _SINGULAR)[:2]]
    for _ in range(iterations + 1):
        _residuals(here, points, distances, residual, jacobian)
        size = float(residual @ residual)
        if not np.isfinite(size):
            break
        if size < least:
            best, least = here, size
        # What numpy's lstsq calls: a few hundred points are solved in less time than it takes to check them.
        step = dgelsd(jacobian, residual, *room, cond=_SINGULAR)[0][: points.shape[1]]
        if np.abs(step).max() < 1e-10:
            break
        here = here - step
    return best


@njit(cache=True)
def _residuals(camera: Floats, points: Floats, distances: Floats, residual: Floats, jacobian: Floats) -> None:
    """Fill in the residuals (Eq. 3) and their derivatives by the camera's place."""
    for row in range(len(points)):
        x, y, z = camera[0] - points[row, 0], camera[1] - points[row, 1], camera[2] - points[row, 2]
        distance = max(np.sqrt(x * x + y * y + z * z), 1e-12)
        residual[row] = distance - distances[row]
        jacobian[row, 0], jacobian[row, 1], jacobian[row, 2] = x / distance, y / distance, z / distance


def published(take: Take, settings: Settings) -> Waypoints:
    """The paper's way, and its baseline's: viewpoints carried by an axis map, refined one by one."""
    viewpoints, fit = take.inspection.viewpoints, take.pair.fit_for(settings)
    carrier = PUBLISHED.get(settings.transfer.method, box_map)(fit.source, fit.target)
    positions = carrier.points(viewpoints.positions)
    quats = carried_orientation(carrier.matrix, viewpoints.quat_xyzw)
    if settings.refine.method == "gauss-newton":
        match = fit.correspondences
        positions = gauss_newton(positions, viewpoints, fit.source, fit.target, match, settings.refine)
        # The centre of what each viewpoint saw, and of its counterparts; NaN for none.
        known = match.target_index >= 0
        weight = viewpoints.seen[:, known].astype(float)
        with np.errstate(invalid="ignore", divide="ignore"):
            weight /= weight.sum(axis=1, keepdims=True)
        before, now = weight @ fit.source.points[known], weight @ match.target_points[known]
        quats = aimed(quats, positions, now, viewpoints.quat_xyzw, before - viewpoints.positions)
    return Waypoints(positions, quats, viewpoints.t_s, np.ones(len(viewpoints), bool))
