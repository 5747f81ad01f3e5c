"""Point-to-point ICP with a fixed number of iterations (paper, Sec. III-A), and PCL's score."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from upplied.records import Floats


def icp(
    source: Floats, target: Floats, iterations: int, tree: cKDTree | None = None
) -> tuple[Floats, Floats]:
    """The rigid motion that brings `source` onto `target`: ``p_target = rotation @ p + translation``.

    Every source point is paired with its nearest target point, however far; all iterations count. Open3D's
    ``registration_icp`` with ``ICPConvergenceCriteria(0, 0, iterations)`` gives the same motion.

    Parameters
    ----------
    source : array, shape (N, 3), m
    target : array, shape (M, 3), m
    iterations : int
    tree : cKDTree, optional
        Of `target`, where it is at hand.

    Returns
    -------
    rotation : array, shape (3, 3)
    translation : array, shape (3,), m
    """
    tree = cKDTree(target) if tree is None else tree
    rotation, translation = np.eye(3), np.zeros(3)
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
