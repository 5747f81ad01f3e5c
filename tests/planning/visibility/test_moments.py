"""Even steps of a flight, its rates, and motion in the picture, against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import look_at
from upplied.planning.visibility.observations import moments, motion_of, rates, sight_to
from upplied.records import Floats, Trajectory

SPEED, TURN = np.array([1.0, -2.0, 0.5]), 0.3


def about_z(angle_rad: Floats) -> Rotation:
    return Rotation.from_rotvec(np.outer(angle_rad, [0.0, 0.0, 1.0]))


def turning(t_s: Floats) -> Trajectory:
    """Straight on at an even speed, the camera turning about the vertical."""
    return Trajectory(t_s, t_s[:, None] * SPEED + [5, 6, 7], about_z(TURN * t_s).as_quat())


@pytest.mark.parametrize(("lasts", "steps"), [(4.0, 8), (4.2, 8), (4.3, 9), (0.3, 1), (0.2, 1)])
def test_steps_are_even_and_about_half_a_second(lasts: float, steps: int) -> None:
    flight = turning(np.linspace(2.0, 2.0 + lasts, 40))
    actual = moments(flight)
    assert len(actual) == steps and actual.step_s == pytest.approx(np.full(steps, lasts / steps))
    middle = 2.0 + (np.arange(steps) + 0.5) * lasts / steps
    assert actual.poses.t_s == pytest.approx(middle)
    assert actual.poses.positions == pytest.approx(middle[:, None] * SPEED + [5, 6, 7])
    turned = Rotation.from_quat(actual.poses.quat_xyzw) * about_z(-TURN * middle)
    assert turned.magnitude() == pytest.approx(np.zeros(steps), abs=1e-9)
    if steps > 1:
        assert actual.velocity == pytest.approx(np.tile(SPEED, (steps, 1)))
        assert actual.turn == pytest.approx(np.tile([0, 0, TURN], (steps, 1)), abs=1e-9)
    else:
        assert not actual.velocity.any() and not actual.turn.any()


def test_a_step_is_the_mean_of_ten_poses_within_it() -> None:
    t_s = np.linspace(0, 1, 21)
    flight = Trajectory(t_s, np.column_stack([t_s**2, np.zeros((21, 2))]), turning(t_s).quat_xyzw)
    within = np.interp((np.arange(20) + 0.5) / 20, t_s, t_s**2).reshape(2, 10)
    assert moments(flight).poses.positions[:, 0] == pytest.approx(within.mean(axis=1))


def test_signs_of_quaternions_do_not_cancel_out() -> None:
    t_s = np.linspace(0, 30, 400)  # turns by more than a whole circle
    actual = moments(turning(t_s))
    turned = Rotation.from_quat(actual.poses.quat_xyzw) * about_z(-TURN * actual.poses.t_s)
    assert turned.magnitude().max() < 1e-6


def test_no_step_crosses_a_gap() -> None:
    t_s = np.concatenate([np.linspace(0, 2, 11), [60.0], np.linspace(100, 101, 6)])
    actual = moments(turning(t_s), np.array([12, 11, 0, 18, 40]))
    assert actual.step_s == pytest.approx([0.5] * 4 + [0.0] + [0.5] * 2)
    assert actual.poses.t_s == pytest.approx([0.25, 0.75, 1.25, 1.75, 60, 100.25, 100.75])
    assert not actual.velocity[4].any() and actual.velocity[5] == pytest.approx(SPEED)
    alone = moments(turning(t_s), np.array([12, 12, 11]))
    assert np.array_equal(alone.poses.t_s, actual.poses.t_s)
    assert len(moments(turning(t_s[:11]), np.empty(0, np.int64))) == 4


def test_rates_are_the_means_of_the_legs_on_both_sides() -> None:
    at = np.array([[0.0, 0, 0], [1, 0, 0], [1, 4, 0]])
    quats = about_z(np.array([0.0, 0.2, 0.8])).as_quat()
    velocity, turn = rates(Trajectory(np.array([0.0, 1.0, 3.0]), at, quats))
    assert velocity == pytest.approx(np.array([[1.0, 0, 0], [0.5, 1, 0], [0, 2, 0]]))
    assert turn[:, 2] == pytest.approx([0.2, 0.25, 0.3])
    one = rates(Trajectory(np.zeros(1), at[:1], quats[:1]))
    assert one[0].shape == one[1].shape == (1, 3) and not one[0].any() and not one[1].any()


def test_an_angular_velocity_is_in_the_structures_frame() -> None:
    tilted = Rotation.from_euler("x", 70, degrees=True)
    quats = (about_z(np.array([0.0, 0.1])) * tilted).as_quat()
    turn = rates(Trajectory(np.array([0.0, 0.5]), np.zeros((2, 3)), quats))[1]
    assert turn == pytest.approx(np.array([[0, 0, 0.2], [0, 0, 0.2]]), abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_motion_in_the_picture_is_that_of_the_direction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point, at, velocity, turn = rng.normal(size=(4, 3)) * [[9], [1], [2], [0.5]]
    step = 1e-6

    def seen(t: float) -> Floats:
        ray = Rotation.from_rotvec(-turn * t).apply(point - at - velocity * t)
        return ray / np.linalg.norm(ray)

    known = np.linalg.norm(seen(step) - seen(-step)) / (2 * step)
    ray = point - at
    assert motion_of(ray, float(np.linalg.norm(ray)), velocity, turn) == pytest.approx(known, rel=1e-6)


def test_a_line_of_sight_has_a_length_and_an_incidence() -> None:
    ray = np.empty(3)
    distance, cosine = sight_to(np.array([1.0, 2, 3]), np.array([1.0, 5, 7]), np.array([0.0, 0.6, -0.8]), ray)
    assert ray.tolist() == [0, 3, 4] and distance == pytest.approx(5)
    assert cosine == pytest.approx(-(3 * 0.6 - 4 * 0.8) / 5)
    assert sight_to(np.ones(3), np.ones(3), np.array([0.0, 0, 1]), ray)[0] == 1e-9


def test_looking_at_a_point_while_passing_leaves_the_others_moving() -> None:
    t_s = np.linspace(0, 2, 41)
    at = np.column_stack([t_s - 1, np.full(41, -10.0), np.zeros(41)])
    flight = moments(Trajectory(t_s, at, look_at(at, np.zeros_like(at))))
    ray = -flight.poses.positions[2]
    still = motion_of(ray, float(np.linalg.norm(ray)), flight.velocity[2], flight.turn[2])
    far = motion_of(3 * ray, float(np.linalg.norm(3 * ray)), flight.velocity[2], flight.turn[2])
    assert still < 2e-4 and far == pytest.approx(0.1 - 0.1 / 3, rel=0.02)
