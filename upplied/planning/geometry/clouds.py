"""Clouds of points: boxes made equal (paper, Sec. III-A), spacing, ICP with PCL's score, percentiles."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.vectors import with_normals
from upplied.records import Cloud, Floats, Ints, Registration

UNTURNED = np.eye(3)


def box_scale(source: Floats, target: Floats) -> Floats:
    """Factors (3,) per axis that make the target's bounding box as large as the source's.

    Where either is flat (no extent along an axis) the factor of that axis is 1.
    """
    return axis_ratios(np.ptp(source, axis=0), np.ptp(target, axis=0))


def axis_ratios(one: Floats, other: Floats) -> Floats:
    """Extents (3,) of one thing over those of another along each axis; 1 where either is flat."""
    flat = np.minimum(one, other) <= 1e-9 * max(one.max(), other.max())
    return np.where(flat, 1.0, one / np.where(flat, 1.0, other))


def diagonal_of(points: Floats) -> float:
    """Length of the diagonal of the bounding box, m."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def spacing(cloud: Cloud) -> float:
    """Distance between neighbouring samples, m: the leaf of a voxel cloud, else from the area."""
    if cloud.leaf_m > 0:
        return cloud.leaf_m
    if cloud.area_m2 is not None:
        return float(np.sqrt(cloud.area_m2.mean()))
    size = np.sort(np.ptp(cloud.points, axis=0))
    return float(np.sqrt(2 * (size[2] * size[1] + size[2] * size[0] + size[1] * size[0]) / len(cloud)))


def in_source_frame(target: Cloud, registration: Registration) -> Cloud:
    """The target's samples in the frame and at the scale of the demonstration structure.

    Normals are carried as normals, areas as areas.
    """
    moved = replace(target, points=registration.to_demo(target.points))
    if target.normals is None:
        return moved
    cofactor = np.linalg.det(registration.matrix) * np.linalg.inv(registration.matrix).T
    normals = target.normals @ cofactor.T
    stretch = np.linalg.norm(normals, axis=1)
    area = None if target.area_m2 is None else target.area_m2 * stretch
    # A mirroring turns a surface inside out; the outside stays outside.
    outward = np.sign(np.linalg.det(registration.matrix)) * normals / stretch[:, None]
    return replace(moved, normals=outward, area_m2=area)


def nearest_facing(cloud: Cloud, other: Cloud, weight: float) -> tuple[Floats, Ints]:
    """How far the nearest sample of another surface is, (N,) m, and which; turning its normal counts."""
    tree = cKDTree(with_normals(other.points, other.outward, weight))
    distance, index = tree.query(with_normals(cloud.points, cloud.outward, weight))
    return distance, index


def icp(source: Floats, target: Floats, iterations: int) -> tuple[Floats, Floats]:
    """The rigid motion that brings `source` onto `target`: ``p_target = rotation @ p + translation``.

    Every source point (N, 3), m, is paired with its nearest target point (M, 3), however far; all iterations
    count. Open3D's ``registration_icp`` with ``ICPConvergenceCriteria(0, 0, iterations)`` gives the same
    motion.
    """
    tree, rotation, translation = cKDTree(target), np.eye(3), np.zeros(3)
    before = None
    for _ in range(iterations):
        nearest = tree.query(source @ rotation.T + translation)[1]
        if before is not None and np.array_equal(nearest, before):
            break  # the same pairs give the same motion, now and in every iteration that would follow
        rotation, translation = rigid_fit(source, target[nearest])
        before = nearest
    return rotation, translation


def rigid_fit(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Rotation and translation with the least ``sum |rotation @ a + translation - b|^2`` (Kabsch)."""
    share = np.full(len(a), 1 / len(a))
    mean_a, mean_b = share @ a, share @ b
    u, _, vt = np.linalg.svd(((a - mean_a) * share[:, None]).T @ (b - mean_b))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation = vt.T @ proper @ u.T
    return rotation, mean_b - rotation @ mean_a


def mean_squared_nn_distance(source: Floats, target: Floats) -> float:
    """PCL's ``getFitnessScore``, m^2: mean squared distance from `source` to the nearest `target` points.

    Lower is better. Open3D's word fitness means a share of inliers, where higher is better.

    Examples
    --------
    >>> mean_squared_nn_distance(np.zeros((1, 3)), np.array([[0.0, 0, 2], [0, 3, 0]]))
    4.0
    """
    return float(np.mean(cKDTree(target).query(source)[0] ** 2))


def weighted_percentile(values: Floats, weights: Floats, percent: float) -> float:
    """The least value up to which at least so many percent of the weight lie; NaN for none.

    Examples
    --------
    >>> weighted_percentile(np.array([1.0, 5.0]), np.array([3.0, 1.0]), 50)
    1.0
    """
    whole = float(np.sum(weights))
    if len(values) == 0 or whole <= 0:
        return float("nan")
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order]) / whole
    rank = int(np.searchsorted(share, percent / 100))
    return float(values[order][min(rank, len(values) - 1)])
