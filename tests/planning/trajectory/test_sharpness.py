"""How far what is inspected moves through the picture between two poses."""

import numpy as np
import pytest

from upplied.planning.trajectory.sharpness import moved_in_picture, time_above
from upplied.poses import from_yaw_pitch, matrices
from upplied.records import Trajectory

AHEAD = np.array([[10.0, 0, 0]])


def moved(positions, yaw, points=AHEAD, seen=None, farthest=100.0, share=0.7):
    axes = matrices(from_yaw_pitch(np.asarray(yaw, float), np.zeros(len(yaw))))
    seen = np.ones((len(yaw), len(points)), bool) if seen is None else seen
    positions = np.asarray(positions, float)
    coarse = np.ones(len(positions))
    return moved_in_picture(positions, axes, points, seen, coarse, np.full(len(points), farthest), share)


def test_flying_past_moves_by_way_over_distance():
    assert moved([[0, 0, 0], [0, 0.1, 0]], [0, 0])[0] == pytest.approx(0.01, rel=1e-3)


def test_turning_moves_by_the_angle_and_following_stills_it():
    assert moved(np.zeros((2, 3)), [0, 0.02])[0] == pytest.approx(0.02, rel=1e-3)
    assert moved([[0, 0, 0], [0, 0.1, 0]], [0, -0.01])[0] < 1e-6  # the camera follows the point


def test_what_is_unseen_or_too_far_does_not_count():
    path, aside = [[0, 0, 0], [0, 0.1, 0]], [0, 0]
    assert moved(path, aside, seen=np.array([[True], [False]]))[0] == 0
    assert moved(path, aside, farthest=9.0)[0] == 0


def test_the_rim_may_move_faster():
    points = np.array([[10.0, 0, 0]] * 7 + [[1.0, 0, 0]] * 3)
    path = [[0, 0, 0], [0, 0.1, 0]]
    assert moved(path, [0, 0], points, share=0.6)[0] == pytest.approx(0.01, rel=1e-2)
    assert moved(path, [0, 0], points, share=0.9)[0] == pytest.approx(0.1, rel=1e-2)


def test_the_time_of_fast_turns_is_their_share():
    times = np.arange(0, 20.1, 0.1)
    yaw = np.where(times < 15, np.radians(5) * times, np.radians(75 + 30 * (times - 15)))
    flown = Trajectory(times, np.zeros((len(times), 3)), from_yaw_pitch(yaw, np.zeros(len(times))))
    assert time_above(flown, np.radians(10)) == pytest.approx(0.25, abs=0.03)
    assert time_above(flown, np.radians(40)) == 0
    assert time_above(flown, np.radians(1)) == pytest.approx(1)
