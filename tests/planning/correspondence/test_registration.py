"""Laws of the convergence check."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import CloudSettings, settings_for
from upplied.geometry.scene import open3d, scene_of
from upplied.planning.correspondence.orientation import _cost
from upplied.planning.correspondence.registration import register
from upplied.planning.geometry.clouds import box_scale, icp, mean_squared_nn_distance, rigid_fit
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud
from upplied.samples.fleet import member, shape_of
from upplied.samples.parametric import turbine

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
    registration = register(cloud(points), cloud(points), PAPER)
    assert registration.accepted and registration.reason == ""
    assert registration.score_m2 == pytest.approx(0, abs=1e-18)
    np.testing.assert_allclose(registration.scale, 1)
    np.testing.assert_allclose(registration.rotation, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(registration.translation, 0, atol=1e-9)


def test_round_trip_of_frames() -> None:
    registration = register(cloud(blob()), cloud(blob(1) * [2.0, 3.0, 0.5] + 7), PAPER)
    points = blob(2)
    np.testing.assert_allclose(registration.to_target(registration.to_demo(points)), points, atol=1e-9)


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
    registration = register(cloud(box), cloud(line), PAPER)
    assert not registration.accepted
    assert (
        f"{registration.score_m2:.3g} m^2" in registration.reason
        and f"gate {PAPER.gamma:.3g} m^2" in registration.reason
    )


RECOMMENDED = settings_for("recommended").registration


@cache
def surface(structure_id: str, number: int = 4000) -> Cloud:
    structure = member(structure_id).structure
    return surface_samples(structure, scene_of(structure, 1), CloudSettings(surface_samples=number))


def turned(target: Cloud, rotation: np.ndarray) -> Cloud:
    return replace(target, points=target.points @ rotation.T, normals=target.normals @ rotation.T)


def test_recommended_identity() -> None:
    one = surface("a320-v1")
    registration = register(one, one, RECOMMENDED)
    assert registration.accepted and registration.acceptance == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(registration.to_demo(one.points), one.points, atol=1e-9)


@pytest.mark.parametrize(
    ("source", "target", "same"),
    [
        ("a320-v1", "b747-v1", True),
        ("beluga-v1", "a320-v1", True),
        ("turbine-1-v1", "turbine-3-v1", True),
        ("cruise-v1", "yacht-1-v1", True),
        ("cube-v1", "cuboid-v1", True),
        ("bridge-1-v1", "bridge-2-v1", True),
        ("a320-v1", "turbine-1-v1", False),
        ("a320-v1", "bridge-1-v1", False),
        ("turbine-1-v1", "cube-v1", False),
        ("cruise-v1", "a320-v1", False),
        ("bridge-1-v1", "cruise-v1", False),
    ],
)
def test_the_same_kind_is_accepted_and_another_refused(source: str, target: str, same: bool) -> None:
    registration = register(surface(source), surface(target), RECOMMENDED)
    assert registration.accepted == same
    assert (registration.acceptance < RECOMMENDED.acceptance) == same


def test_a_refusal_says_what_and_where() -> None:
    registration = register(surface("a320-v1"), surface("bridge-1-v1"), RECOMMENDED)
    assert "do not correspond" in registration.reason and "gate 1 " in registration.reason
    assert (
        "section of the" in registration.reason and "% of its area, has no counterpart" in registration.reason
    )


def test_acceptance_is_free_of_density_scale_and_place() -> None:
    one, other = surface("a320-v1"), surface("b777-v1")
    plain = register(one, other, RECOMMENDED).acceptance
    small = replace(other, points=0.01 * other.points + 5, area_m2=1e-4 * other.area_m2)
    assert register(one, small, RECOMMENDED).acceptance == pytest.approx(plain, rel=1e-6)
    thin = register(surface("a320-v1", 1500), surface("b777-v1", 1500), RECOMMENDED).acceptance
    assert thin == pytest.approx(plain, abs=0.1)


def test_where_the_rotor_stopped_does_not_matter() -> None:
    shape = replace(shape_of("turbine-2-v1"), azimuth_deg=35.0)
    stopped = turbine(shape, "stopped-v1").structure
    other = surface_samples(stopped, scene_of(stopped, 1), CloudSettings())
    assert register(surface("turbine-1-v1"), other, RECOMMENDED).accepted


@pytest.mark.parametrize("heading_deg", [0.0, 77.0, 180.0, 250.0])
@pytest.mark.parametrize(("source", "target"), [("a320-v1", "b747-v1"), ("cruise-v1", "yacht-1-v1")])
def test_heading_is_found(source: str, target: str, heading_deg: float) -> None:
    one, other = surface(source), surface(target)
    away = Rotation.from_euler("z", heading_deg, degrees=True).as_matrix()
    registration = register(one, turned(other, away), replace(RECOMMENDED, search="heading"))
    assert registration.accepted
    off = Rotation.from_matrix(registration.rotation @ registration.turn @ away).magnitude()
    assert np.degrees(off) < 3
    assert registration.runner_up_gap > 0.15


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_orientation_is_found(seed: int) -> None:
    one, other = surface("a320-v1"), surface("b777-v1")
    away = Rotation.random(random_state=seed).as_matrix()
    registration = register(one, turned(other, away), replace(RECOMMENDED, search="orientation"))
    assert registration.accepted
    assert np.degrees(Rotation.from_matrix(registration.rotation @ registration.turn @ away).magnitude()) < 6


def test_symmetric_structures_keep_the_declared_heading_and_say_so() -> None:
    registration = register(surface("cube-v1"), surface("cube-v1"), replace(RECOMMENDED, search="heading"))
    np.testing.assert_allclose(registration.turn, np.eye(3), atol=1e-9)
    assert registration.runner_up_gap < 0.15
    assert "declared heading is used" in registration.evidence


def test_a_wrong_heading_is_mentioned_and_a_right_one_is_not() -> None:
    one, other = surface("a320-v1"), surface("b777-v1")
    assert "declared forward axis" not in register(one, other, RECOMMENDED).evidence
    about = turned(other, np.diag([-1.0, -1.0, 1.0]))
    match = re.search(r"turned by (-?\d+) deg about the vertical", register(one, about, RECOMMENDED).evidence)
    assert match is not None and abs(int(match[1])) > 170
    aside = register(one, turned(other, Rotation.from_euler("z", 90, degrees=True).as_matrix()), RECOMMENDED)
    assert not aside.accepted and "check its declared forward axis" in aside.reason


def test_normals_tell_a_sheet_from_its_back():
    """A plate sampled on its upper side lies on itself upside down, point for point; its normals do not."""
    x, y = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-2, 2, 9))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    up = Cloud(points, np.tile([0.0, 0, 1], (len(points), 1)))
    over = np.diag([1.0, -1, -1])  # about X
    same, turned = _cost(up, up, np.eye(3)), _cost(up, up, over)
    assert same == pytest.approx(0, abs=1e-9)
    assert turned == pytest.approx(0.03, rel=1e-6)
