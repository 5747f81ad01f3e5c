"""Laws of the pose algebra."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry import poses
from upplied.records import Trajectory


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_looking_at_a_point_puts_it_on_the_optical_axis(rng):
    eyes, targets = rng.normal(size=(2, 50, 3))
    rays = (targets - eyes) / np.linalg.norm(targets - eyes, axis=1, keepdims=True)
    np.testing.assert_allclose(poses.optical_axis(poses.look_at(eyes, targets)), rays, atol=1e-12)


def test_no_roll_leaves_the_left_axis_level(rng):
    quats = poses.from_yaw_pitch(rng.uniform(-3, 3, 40), rng.uniform(-1.5, 1.5, 40))
    np.testing.assert_allclose(poses.matrices(quats)[:, 2, 1], 0, atol=1e-12)


def test_yaw_pitch_is_the_inverse_of_from_yaw_pitch(rng):
    yaw, pitch = rng.uniform(-3.1, 3.1, 40), rng.uniform(-1.5, 1.5, 40)
    np.testing.assert_allclose(poses.yaw_pitch(poses.from_yaw_pitch(yaw, pitch)), (yaw, pitch), atol=1e-9)


def test_removing_roll_keeps_the_optical_axis(rng):
    quats = Rotation.random(200, rng).as_quat()
    axis = poses.optical_axis(quats)
    level = poses.optical_axis(poses.without_roll(quats))
    steep = np.hypot(axis[:, 0], axis[:, 1]) < 0.1 * np.abs(axis[:, 2])
    np.testing.assert_allclose(level[~steep], axis[~steep], atol=1e-12)
    np.testing.assert_allclose(level[:, 2], axis[:, 2], atol=1e-12)  # its elevation always


def test_a_camera_that_looks_straight_down_keeps_its_heading(rng):
    yaw = rng.uniform(-3.1, 3.1, 60)
    trembling = Rotation.from_rotvec(np.radians(rng.normal(size=(60, 3))))
    for pitch in (-np.pi / 2, np.pi / 2, np.radians(-89.0)):
        exact = poses.from_yaw_pitch(yaw, np.full(60, pitch))
        np.testing.assert_allclose(poses.yaw_pitch(exact)[0], yaw, atol=1e-7)
        shaken = (Rotation.from_quat(exact) * trembling).as_quat()
        off = np.degrees(np.angle(np.exp(1j * (poses.yaw_pitch(shaken)[0] - yaw))))
        assert np.abs(off).max() < 5


def test_interpolating_at_the_stamps_gives_the_poses_back(rng):
    flight = Trajectory(
        np.arange(10.0), rng.normal(size=(10, 3)), poses.normalised(Rotation.random(10, rng).as_quat())
    )
    again = poses.interpolate(flight, flight.t_s)
    np.testing.assert_allclose(again.positions, flight.positions)
    assert poses.angle_between(again.quat_xyzw, flight.quat_xyzw).max() < 1e-6


def test_moving_there_and_back_is_the_identity(rng):
    flight = Trajectory(np.arange(5.0), rng.normal(size=(5, 3)), Rotation.random(5, rng).as_quat())
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    back = poses.moved(poses.moved(flight, turn, shift), turn.T, -turn.T @ shift)
    np.testing.assert_allclose(back.positions, flight.positions, atol=1e-12)
    assert poses.angle_between(back.quat_xyzw, flight.quat_xyzw).max() < 1e-6


def test_mean_of_equal_rotations_is_that_rotation(rng):
    quat = poses.normalised(Rotation.random(rng=rng).as_quat())
    assert poses.angle_between(poses.mean_rotation(np.tile(quat, (5, 1))), quat) < 1e-6
