"""The paper's viewpoints on the target: by an axis map, refined one by one (Alg. 2, Eq. 3)."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg.lapack import dgelsd, dgelsd_lwork

from upplied.config import RefineSettings, Settings
from upplied.planning.carry.affine import aimed, published_map
from upplied.planning.correspondence.pair import Pair
from upplied.planning.demonstration.inspection import Inspection
from upplied.planning.demonstration.repetition import Take
from upplied.records import (
    Cloud,
    Correspondences,
    Floats,
    Viewpoints,
    Waypoints,
)

_SINGULAR = 1e-6  # of the largest singular value: directions that the points in view do not determine


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
    source, target, correspondences
        Clouds, and what on the target corresponds to every point of the source.

    Returns
    -------
    array, shape (K, 3), m, target frame
    """
    mean_d, sigma_d = source.points.mean(axis=0), _deviation(source)
    mean_t, sigma_t = target.points.mean(axis=0), _deviation(target)
    refined = np.array(start, float)
    for index in range(len(viewpoints)):
        seen = viewpoints.seen[index] & (correspondences.target_index >= 0)
        if np.count_nonzero(seen) < 3:
            continue  # fewer than three distances do not place a point
        camera_d = (viewpoints.positions[index] - mean_d) / sigma_d
        points_d = (source.points[seen] - mean_d) / sigma_d
        points_t = (target.points[correspondences.target_index[seen]] - mean_t) / sigma_t
        wanted = np.linalg.norm(points_d - camera_d, axis=1)
        camera_t = _solve((start[index] - mean_t) / sigma_t, points_t, wanted, settings.iterations)
        refined[index] = camera_t * sigma_t + mean_t
    return refined


def _solve(camera: Floats, points: Floats, wanted: Floats, iterations: int) -> Floats:
    """Plain Gauss-Newton with the least-norm step; of all iterates the one with the least residual.

    Without that choice single viewpoints run off by kilometres where the points in view lie in a plane.
    """
    here, best, least = camera, camera, np.inf
    residual, jacobian = np.empty(len(points)), np.empty(points.shape)
    room = [int(size) for size in dgelsd_lwork(*points.shape, 1, _SINGULAR)[:2]]
    for _ in range(iterations + 1):
        _residuals(here, points, wanted, residual, jacobian)
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
def _residuals(camera: Floats, points: Floats, wanted: Floats, residual: Floats, jacobian: Floats) -> None:
    """Fill in the residuals (Eq. 3) and their derivatives by the camera's place."""
    for row in range(len(points)):
        x, y, z = camera[0] - points[row, 0], camera[1] - points[row, 1], camera[2] - points[row, 2]
        distance = max(np.sqrt(x * x + y * y + z * z), 1e-12)
        residual[row] = distance - wanted[row]
        jacobian[row, 0], jacobian[row, 1], jacobian[row, 2] = x / distance, y / distance, z / distance


def _deviation(cloud: Cloud) -> Floats:
    sigma = cloud.points.std(axis=0)
    return np.where(sigma > 1e-9 * sigma.max(), sigma, 1.0)


def published(take: Take, settings: Settings) -> Waypoints:
    """The paper's way, and its baseline's: viewpoints carried by an axis map, refined one by one."""
    inspection, pair = take.inspection, take.pair
    viewpoints, fit = inspection.viewpoints, pair.fit_for(settings)
    carrier = published_map(settings.transfer.method, fit.source, fit.target)
    positions = carrier.points(viewpoints.positions)
    quats = carrier.orientations(viewpoints.quat_xyzw)
    if settings.refine.method == "gauss-newton":
        clouds = fit.source, fit.target, fit.correspondences
        positions = gauss_newton(positions, viewpoints, *clouds, settings.refine)
        before, now = _centres_of_view(inspection, pair, settings)
        quats = aimed(quats, positions, now, viewpoints.quat_xyzw, before - viewpoints.positions)
    return Waypoints(positions, quats, viewpoints.t_s, np.ones(len(viewpoints), bool))


def _centres_of_view(inspection: Inspection, pair: Pair, settings: Settings) -> tuple[Floats, Floats]:
    """Centre of what each viewpoint saw, and of its counterparts on the target, (K, 3) each; NaN for none."""
    fit = pair.fit_for(settings)
    known = fit.correspondences.target_index >= 0
    weight = inspection.viewpoints.seen[:, known].astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight /= weight.sum(axis=1, keepdims=True)
    return weight @ fit.source.points[known], weight @ fit.correspondences.target_points[known]
