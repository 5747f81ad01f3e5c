"""The search for views: turns, leans and bends of a path beside a wall whose answers geometry gives."""

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.camera_turns import with_looks
from upplied.planning.trajectory.complete import complete
from upplied.planning.trajectory.lean import lean, least_moves
from upplied.planning.trajectory.likeness import Likeness
from upplied.planning.trajectory.look import View, bend, find_detours, find_looks
from upplied.poses import angle_between, from_yaw_pitch, yaw_pitch
from upplied.records import Camera, Cloud, Waypoints
from upplied.scene import Scene

NOWHERE = Standoff(np.empty(0, np.int64), np.empty((0, 32, 3)), np.empty(0))
ANYTHING = Likeness(np.zeros((2, 3)), 1e9, NOWHERE)  # keeps no path from being bent
CAMERA = Camera(hfov_deg=60, vfov_deg=60, min_range_m=1, max_range_m=40)


@pytest.fixture(scope="module")
def wall():
    """A wall of 20 x 8 m in the plane y = 0, seen from y < 0, with a sample every metre."""
    x, z = np.meshgrid(np.arange(-9.5, 10), np.arange(0.5, 8))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 8], [-10, 0, 8]])
    scene = Scene(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    cloud = Cloud(points, normals=np.tile([0.0, -1, 0], (len(points), 1)), area_m2=np.ones(len(points)))
    settings = VisibilitySettings(occlusion=True, max_incidence_deg=75)
    return View(cloud, np.ones(len(points)), CAMERA, settings, RetimeSettings(), scene)


def along_wall(count=21, y=-6.0, yaw=np.pi / 2):
    positions = np.column_stack([np.linspace(-10, 10, count), np.full(count, y), np.full(count, 4.0)])
    return positions, from_yaw_pitch(np.full(count, yaw), np.zeros(count))


def test_looks_add_just_what_they_promise_and_miss_nothing_in_reach(wall):
    positions, quats = along_wall(yaw=-np.pi / 2)  # the camera looks away from the wall
    covered = wall.seen(positions, quats).any(axis=0)
    assert not covered.any()
    looks = find_looks(positions, quats, covered, wall)
    seen = wall.seen(positions[looks.station], looks.quat_xyzw)
    assert looks.gain.sum() == pytest.approx(wall.need[seen.any(axis=0)].sum())
    assert seen.any(axis=0).all()
    assert len(looks.station) <= 6  # a 60 degree picture from 6 m shows 7 m of a wall of 20


def test_nothing_missing_needs_no_look(wall):
    positions, quats = along_wall()
    everything = np.ones(len(wall.need), bool)
    assert len(find_looks(positions, quats, everything, wall).station) == 0
    assert len(find_detours(positions, everything, wall, np.ones(3), lambda at: at[:, 0] > -99).gain) == 0


def test_looks_keep_the_limits_of_the_gimbal(wall):
    limits = RetimeSettings(min_gimbal_pitch_deg=-10, max_gimbal_pitch_deg=5)
    positions, quats = along_wall(yaw=-np.pi / 2)
    looks = find_looks(positions, quats, np.zeros(len(wall.need), bool), replace(wall, limits=limits))
    pitch = np.degrees(yaw_pitch(looks.quat_xyzw)[1])
    assert len(pitch) and pitch.min() >= -10 - 1e-6 and pitch.max() <= 5 + 1e-6


def test_detours_stay_in_reach_and_where_flying_is_allowed(wall):
    positions, _ = along_wall(y=-0.9)  # every sight line along the wall is too oblique, or too short
    reach = np.array([2.0, 3.0, 1.0])

    def allowed(places):
        return places[:, 2] <= 4.5

    found = find_detours(positions, np.zeros(len(wall.need), bool), wall, reach, allowed)
    assert len(found.gain)
    offset = found.positions - positions[found.station]
    assert np.linalg.norm(offset / reach, axis=1).max() <= 1 + 1e-9
    assert found.positions[:, 2].max() <= 4.5
    seen = wall.seen(found.positions, found.quat_xyzw).any(axis=0)
    assert found.gain.sum() == pytest.approx(wall.need[seen].sum())


def test_a_bend_passes_through_its_place_and_leaves_the_rest(wall):
    positions, _ = along_wall(count=81)
    place = positions[40] + [0.0, -1.0, 0.5]
    bent = bend(positions, place, 40)
    np.testing.assert_allclose(bent[40], place)
    far = np.abs(positions[:, 0]) > 3.0 * np.hypot(1.0, 0.5)
    np.testing.assert_array_equal(bent[far], positions[far])
    slope = np.abs(np.diff(bent[:, 1]) / np.diff(bent[:, 0]))
    assert np.degrees(np.arctan(slope.max())) < 30


def test_the_least_move_ends_a_too_oblique_view():
    rng = np.random.default_rng(5)
    points, cameras = rng.normal(size=(30, 3)), rng.normal(size=(20, 3)) * 8
    normals = rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    move = least_moves(points, normals, cameras, 75.0)
    for sample in range(30):
        after = cameras + move[sample][:, None] * normals[sample] - points[sample]
        angle = np.degrees(np.arccos(after @ normals[sample] / np.linalg.norm(after, axis=1)))
        before = cameras - points[sample]
        was = np.degrees(np.arccos(before @ normals[sample] / np.linalg.norm(before, axis=1)))
        assert (angle <= 75).all() and (move[sample][was < 73] == 0).all()


def test_a_path_too_near_leans_away_from_the_wall(wall):
    positions, _ = along_wall(y=-0.8)
    missing = np.flatnonzero(wall.cloud.points[:, 2] > 7)  # seen too obliquely from 4 m height
    asked = lean(positions, missing, wall, np.array([5.0, 5.0, 5.0]))
    assert (asked[3:-3, 1] < 0).all() and np.abs(asked[:, [0, 2]]).max() < 1e-9


def test_completing_sees_more_and_keeps_every_rule(wall):
    positions, quats = along_wall(y=-3.0)
    path = Waypoints(positions, quats, np.arange(21.0), np.zeros(21, bool))
    before = wall.seen(positions, quats).any(axis=0).sum()
    bent, looks = complete(
        path, wall, ANYTHING, np.full(3, 1.5), lambda at: at,
        lambda at: at[:, 1] < -2.0, lambda at: np.zeros(len(at) - 1, bool),
    )  # fmt: skip
    done, _ = with_looks(bent, looks)
    seen = wall.seen(done.positions, done.quat_xyzw).any(axis=0)
    assert seen.sum() > before and seen.sum() >= 0.99 * len(seen)
    assert done.positions[:, 1].max() < -2.0 and (np.diff(done.t_s) >= 0).all()
    turned = angle_between(done.quat_xyzw[done.is_viewpoint], quats[0])
    assert len(turned) and turned.min() > 0.01  # just the turns are viewpoints


def test_what_shows_less_once_it_is_safe_is_taken_back(wall):
    positions, quats = along_wall(y=-3.0)
    path = Waypoints(positions, quats, np.arange(21.0), np.zeros(21, bool))

    def safe(places):
        return places if np.array_equal(places, positions) else places - [0.0, 50.0, 0.0]

    bent, _ = complete(
        path, wall, ANYTHING, np.full(3, 1.5), safe,
        lambda at: np.ones(len(at), bool), lambda at: np.zeros(len(at) - 1, bool),
    )  # fmt: skip
    np.testing.assert_allclose(bent.positions[:, 1], -3.0)
