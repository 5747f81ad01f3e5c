"""Laws of the convergence check."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.planning.boxes import box_scale
from upplied.planning.icp import icp, mean_squared_nn_distance, rigid_fit
from upplied.planning.register import register
from upplied.records import Cloud
from upplied.scene import open3d

PAPER = settings_for("paper").registration


def blob(seed: int = 0, number: int = 400) -> np.ndarray:
    """Points on a lopsided ellipsoid with a fin: no symmetry to hide behind."""
    rng = np.random.default_rng(seed)
    body = rng.normal(size=(number, 3))
    body *= np.array([10.0, 4.0, 3.0]) / np.linalg.norm(body, axis=1, keepdims=True)
    fin = rng.random((number // 4, 3)) * [3.0, 0.2, 5.0] + [-9.0, 0.4, 1.0]
    return np.concatenate([body, fin])


def cloud(points: np.ndarray) -> Cloud:
    return Cloud(points=points, leaf_m=1.0)


def test_identity() -> None:
    points = blob()
    found = register(cloud(points), cloud(points), PAPER)
    assert found.accepted and found.reason == ""
    assert found.score_m2 == pytest.approx(0, abs=1e-18)
    np.testing.assert_allclose(found.scale, 1)
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(found.translation, 0, atol=1e-9)


def test_round_trip_of_frames() -> None:
    found = register(cloud(blob()), cloud(blob(1) * [2.0, 3.0, 0.5] + 7), PAPER)
    points = blob(2)
    np.testing.assert_allclose(found.to_target(found.to_demo(points)), points, atol=1e-9)


@pytest.mark.parametrize("shift", [[0.0, 0, 0], [100.0, -40, 3]])
@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_moving_both_moves_the_result(quarter: int, shift: list[float]) -> None:
    turn = np.rint(Rotation.from_euler("z", 90 * quarter, degrees=True).as_matrix())
    source, target = blob(), blob(1) * [2.0, 3.0, 0.5]
    before = register(cloud(source), cloud(target), PAPER)
    after = register(cloud(source @ turn.T + shift), cloud(target @ turn.T + shift), PAPER)
    assert after.score_m2 == pytest.approx(before.score_m2, rel=1e-6)
    np.testing.assert_allclose(
        after.to_demo(target @ turn.T + shift), before.to_demo(target) @ turn.T + shift, atol=1e-6
    )


def test_scale_of_the_target_does_not_matter() -> None:
    source, target = blob(), blob(1)
    one = register(cloud(source), cloud(target), PAPER)
    other = register(cloud(source), cloud(target * [7.0, 0.3, 2.0]), PAPER)
    assert one.score_m2 == pytest.approx(other.score_m2, rel=1e-9)


def test_icp_is_open3ds() -> None:
    source = blob()
    target = blob(3) @ Rotation.from_euler("xyz", [3, -5, 8], degrees=True).as_matrix().T + [0.4, 0.2, -0.3]
    o3d = open3d()
    clouds = [o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in (source, target)]
    reference = o3d.pipelines.registration.registration_icp(
        *clouds,
        1e6,
        np.eye(4),
        o3d.pipelines.registration.TransformationEstimationPointToPoint(),
        o3d.pipelines.registration.ICPConvergenceCriteria(0, 0, 30),
    )
    rotation, translation = icp(source, target, 30)
    np.testing.assert_allclose(rotation, reference.transformation[:3, :3], atol=1e-6)
    np.testing.assert_allclose(translation, reference.transformation[:3, 3], atol=1e-6)
    score = mean_squared_nn_distance(source @ rotation.T + translation, target)
    assert score == pytest.approx(reference.inlier_rmse**2, rel=1e-6)


def test_score_is_the_one_of_brute_force() -> None:
    source, target = blob(0, 60), blob(1, 80)
    squared = ((source[:, None] - target[None]) ** 2).sum(axis=2)
    assert mean_squared_nn_distance(source, target) == pytest.approx(squared.min(axis=1).mean())


def test_rigid_fit_never_mirrors() -> None:
    points = blob()
    rotation, _ = rigid_fit(points, points * [-1.0, 1, 1])
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_flat_structures_keep_their_thickness() -> None:
    flat = blob() * [1.0, 1, 0]
    np.testing.assert_allclose(box_scale(blob(), flat)[2], 1)
    assert np.isfinite(register(cloud(flat), cloud(2 * flat), PAPER).score_m2)


def test_refusal_says_score_and_gate() -> None:
    rng = np.random.default_rng(0)
    box = rng.random((500, 3)) * [20.0, 8, 8]
    line = np.concatenate([rng.random((500, 3)) * [20.0, 0.1, 0.1], [[0, 0, 0], [20, 8, 8]]])
    found = register(cloud(box), cloud(line), PAPER)
    assert not found.accepted
    assert f"{found.score_m2:.3g} m^2" in found.reason and f"gate {PAPER.gamma:.3g} m^2" in found.reason
