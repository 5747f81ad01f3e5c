"""How far what is inspected moves through the picture between two poses."""

from dataclasses import replace

import numpy as np
import pytest
from remembered import study_pair

from upplied.config import focal_px, settings_for
from upplied.geometry.poses import from_yaw_pitch, matrices
from upplied.planning.carry.inspected_surface import inspected_by
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.trajectory.retime import Sharp, Timed
from upplied.planning.trajectory.sharpness import moved_in_picture, sharp_limits, steadied_swings
from upplied.records import Trajectory, Waypoints
from upplied.samples.pilot import fly
from upplied.samples.surfaces import box

AHEAD = np.array([[10.0, 0, 0]])


def moved_and_stillest(positions, yaw, points=AHEAD, seen=None, farthest=100.0, share=0.7):
    axes = matrices(from_yaw_pitch(np.asarray(yaw, float), np.zeros(len(yaw))))
    seen = np.ones((len(yaw), len(points)), bool) if seen is None else seen
    positions = np.asarray(positions, float)
    coarse, facing = np.ones(len(positions)), np.tile([-1.0, 0, 0], (len(points), 1))
    limits = np.full(len(points), farthest), share
    return moved_in_picture(positions, axes, points, facing, seen, coarse, *limits)


def moved(*args, **others):
    return moved_and_stillest(*args, **others)[0]


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


def test_each_sample_has_the_leg_on_which_it_moves_least_for_its_length():
    path = [[0, 0, 0], [0, 0.1, 0], [0, 0.4, 0], [0, 0.5, 0]]
    angle, stillest, least = moved_and_stillest(path, [0, 0, -0.03, -0.03])  # the middle follows
    assert stillest.tolist() == [1] and least[0] < 1e-3 < angle[0]
    unseen = np.array([[True], [True], [False], [True]])
    assert moved_and_stillest(path, [0, 0, -0.03, -0.03], seen=unseen)[1].tolist() == [0]
    assert moved_and_stillest(path, [0, 0, 0, 0], seen=np.zeros((4, 1), bool))[1].tolist() == [-1]


def test_a_leg_from_which_a_sample_is_shown_too_obliquely_is_not_its_stillest():
    path = [[8, 6.0, 0], [8, 5.9, 0], [0, 0.0, 0], [0, 0.4, 0]]  # near and 70 deg oblique, then frontal
    near = moved_and_stillest(path, np.zeros(4), farthest=30.0)
    assert near[1].tolist() == [0]
    assert moved_and_stillest(path, np.zeros(4), farthest=15.0)[1].tolist() == [2]


def turned(swings, total_s=40.0):
    """A camera that stands still but for swings (begin, end, deg/s); the demonstration went the same."""
    times = np.arange(0, total_s + 0.05, 0.1)
    rate = np.zeros(len(times))
    for begin, end, degps in swings:
        rate[(times >= begin) & (times < end)] = degps
    yaw = np.concatenate([[0.0], np.cumsum(np.radians(rate[:-1]) * 0.1)])
    flown = Trajectory(times, np.zeros((len(times), 3)), from_yaw_pitch(yaw, np.zeros(len(times))))
    limits = Sharp(np.full(len(times), np.inf), np.maximum(rate, 10.0))
    return limits, times, Timed(flown, np.zeros(len(times), bool), times, np.zeros(len(times), bool))


def steady_after(swings):
    limits, times, timed = turned(swings)
    actual = steadied_swings(limits, times, timed, np.radians(10))
    np.testing.assert_array_equal(actual.speed_mps, limits.speed_mps)
    return [bool((actual.pan_degps[(times >= a) & (times < b)] < 10).all()) for a, b, _ in swings]


def test_swings_that_are_rare_are_flown_as_the_expert_flew_them():
    limits, times, timed = turned([(10, 11.5, 30)])
    assert steadied_swings(limits, times, timed, np.radians(10)) is limits


def test_so_many_of_the_slowest_swings_are_steadied_that_the_others_are_rare():
    swings = [(5, 8, 30), (15, 16.5, 60), (25, 28, 20)]
    assert steady_after(swings) == [True, False, True]  # 1.5 of 40 s are left
    assert steady_after([(5, 8, 30), (15, 18, 60)]) == [True, True]  # 3 s would be too many


def test_where_the_pictures_of_the_expert_smeared_the_plan_is_slower():
    """An exposure that smears his pictures by two pixels: about half as fast as he flew."""
    settings = settings_for("recommended", clouds={"surface_samples": 400})
    cube = box((12.0, 12.0, 12.0), "cube").structure
    flight = fly(cube, "sides", seed=3)
    take = takes_of(flight, study_pair(cube, cube, settings), settings)[0]
    camera = take.inspection.camera
    focal = focal_px(camera.width_px or settings.inspection.width_px, camera.hfov_deg)
    camera = replace(camera, exposure_s=2 / (focal * take.inspection.attention.motion_radps))
    blurred = replace(take, inspection=replace(take.inspection, camera=camera))
    flown = take.inspection.flight
    path = Waypoints(flown.positions, flown.quat_xyzw, flown.t_s, np.ones(len(flown), bool))
    limits = sharp_limits(path, flown, [blurred], inspected_by(blurred, settings), settings)
    speed = np.linalg.norm(np.diff(flown.positions, axis=0), axis=1) / np.diff(flown.t_s)
    bounded = np.isfinite(limits.speed_mps[1:]) & (speed > 0.1)
    assert bounded.mean() > 0.5
    assert np.median(limits.speed_mps[1:][bounded] / speed[bounded]) < 0.75
