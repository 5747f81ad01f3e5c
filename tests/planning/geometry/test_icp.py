"""Rigid fits against closed forms, ICP against Open3D's, and PCL's score by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry.scene import open3d
from upplied.planning.geometry.clouds import icp, mean_squared_nn_distance, rigid_fit
from upplied.records import Floats


def cloud(number: int, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).normal(size=(number, 3)) * [3, 2, 1]


def test_a_rigid_motion_is_found_exactly() -> None:
    here, turn = cloud(20), Rotation.from_euler("xyz", [70, -30, 140], degrees=True).as_matrix()
    rotation, translation = rigid_fit(here, here @ turn.T + [3, -5, 7])
    assert rotation == pytest.approx(turn)
    assert translation == pytest.approx([3, -5, 7])


def test_what_is_mirrored_is_fitted_by_a_turn() -> None:
    here = cloud(40)
    there = here * [1, 1, -1]
    rotation, translation = rigid_fit(here, there)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    least = np.sum((here @ rotation.T + translation - there) ** 2)
    for angle in np.random.default_rng(2).normal(size=(300, 3)):
        other = Rotation.from_rotvec(angle).as_matrix()
        moved = here @ other.T
        moved += there.mean(axis=0) - moved.mean(axis=0)
        assert np.sum((moved - there) ** 2) >= least - 1e-9


@pytest.mark.parametrize("iterations", [1, 2, 5, 50])
def test_icp_is_open3ds(iterations: int) -> None:
    target = cloud(400, 3)
    turn = Rotation.from_euler("xyz", [8, -6, 11], degrees=True).as_matrix()
    source = cloud(150, 4) @ turn.T + [0.3, -0.2, 0.4]
    rotation, translation = icp(source, target, iterations)
    o3d = open3d()
    here, there = (o3d.geometry.PointCloud(o3d.utility.Vector3dVector(of)) for of in (source, target))
    registration = o3d.pipelines.registration
    known = registration.registration_icp(
        here, there, 1e3, np.eye(4), registration.TransformationEstimationPointToPoint(),
        registration.ICPConvergenceCriteria(0.0, 0.0, iterations),
    ).transformation  # fmt: skip
    assert rotation == pytest.approx(known[:3, :3], abs=1e-9)
    assert translation == pytest.approx(known[:3, 3], abs=1e-9)


def test_the_score_is_the_mean_square_of_the_nearest() -> None:
    source, target = cloud(30, 5), cloud(40, 6)
    known = np.mean([min(np.sum((a - b) ** 2) for b in target) for a in source])
    assert mean_squared_nn_distance(source, target) == pytest.approx(known)
