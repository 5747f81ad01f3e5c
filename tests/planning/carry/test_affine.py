"""The maps of Eqs. 1 and 2 and of the baseline, and the camera that goes with them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import angle_between, from_yaw_pitch, matrices, optical_axis
from upplied.planning.carry.affine import aimed, box_map, carried_orientation, registered_map, zscore_map
from upplied.records import Cloud, Registration


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.mark.parametrize("carrier", [zscore_map, box_map])
def test_a_scaled_structure_carries_points_by_its_scale(rng, carrier):
    points = rng.normal(size=(200, 3)) * [10, 4, 2]
    scale, shift = np.array([1.7, 2.0, 0.6]), np.array([5.0, -3, 1])
    affine = carrier(Cloud(points), Cloud(points * scale + shift))
    cameras = rng.normal(size=(20, 3)) * 20
    np.testing.assert_allclose(affine.points(cameras), cameras * scale + shift, atol=1e-9)


@pytest.mark.parametrize("carrier", [zscore_map, box_map])
def test_a_flat_structure_is_not_scaled_along_its_thin_axis(rng, carrier):
    flat = rng.normal(size=(100, 3)) * [3, 3, 0]
    affine = carrier(Cloud(flat), Cloud(flat * 2))
    assert np.isfinite(affine.points(rng.normal(size=(5, 3)))).all()
    assert affine.matrix[2, 2] == 1


def test_zscore_keeps_standard_scores(rng):
    source, target = Cloud(rng.normal(size=(300, 3))), Cloud(rng.exponential(size=(400, 3)) * [2, 3, 4])
    camera = rng.normal(size=(7, 3))
    there = zscore_map(source, target).points(camera)
    before = (camera - source.points.mean(axis=0)) / source.points.std(axis=0)
    after = (there - target.points.mean(axis=0)) / target.points.std(axis=0)
    np.testing.assert_allclose(after, before, atol=1e-9)


def test_the_registered_map_inverts_the_registration(rng):
    registration = Registration(
        scale=np.array([0.5, 2.0, 1.5]),
        rotation=Rotation.random(rng=rng).as_matrix(),
        translation=rng.normal(size=3),
        score_m2=0.0,
        accepted=True,
    )
    points = rng.normal(size=(30, 3))
    np.testing.assert_allclose(
        registered_map(registration).points(registration.to_demo(points)), points, atol=1e-9
    )
    np.testing.assert_allclose(registration.to_target(registration.to_demo(points)), points, atol=1e-9)


def test_no_scaling_leaves_orientations_alone_even_with_roll(rng):
    quats = Rotation.random(50, rng).as_quat()
    assert angle_between(carried_orientation(np.eye(3), quats), quats).max() < 1e-6


def test_scaling_carries_the_optical_axis_as_a_direction_and_keeps_the_horizon_level(rng):
    quats = from_yaw_pitch(rng.uniform(-3, 3, 40), rng.uniform(-1.2, 1.2, 40))
    scale = np.diag([2.0, 0.5, 1.3])
    carried = carried_orientation(scale, quats)
    expected = optical_axis(quats) @ scale
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(optical_axis(carried), expected, atol=1e-9)
    np.testing.assert_allclose(matrices(carried)[:, 2, 1], 0, atol=1e-9)


def test_aiming_keeps_the_place_in_the_picture(rng):
    before = from_yaw_pitch(rng.uniform(-3, 3, 40), rng.uniform(-1, 1, 40))
    to_aim = rng.normal(size=(40, 3)) * 10
    start = Rotation.random(40, rng).as_quat()
    positions, aim = rng.normal(size=(2, 40, 3)) * 10
    after = aimed(start, positions, aim, before, to_aim)
    in_picture_before = np.einsum("nji,nj->ni", matrices(before), to_aim)
    in_picture_after = np.einsum("nji,nj->ni", matrices(after), aim - positions)
    for vectors in (in_picture_before, in_picture_after):
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    np.testing.assert_allclose(in_picture_after, in_picture_before, atol=1e-9)


def test_an_unknown_aim_leaves_the_camera_alone():
    quats = from_yaw_pitch(np.array([0.4]), np.array([0.1]))
    same = aimed(quats, np.zeros((1, 3)), np.full((1, 3), np.nan), quats, np.ones((1, 3)))
    assert angle_between(same, quats).max() < 1e-9
