"""Turns of the camera on a path beside a wall: where they take place, and on how many metres."""

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.trajectory.camera_turns import eased, with_looks
from upplied.planning.trajectory.look import Looks, View
from upplied.planning.trajectory.retime import retime
from upplied.poses import angle_between, from_yaw_pitch, yaw_pitch
from upplied.records import Camera, Cloud, Trajectory, Waypoints
from upplied.scene import Scene

SPEED = 1.5
LIMITS = RetimeSettings(limits=True)


def view_of(points):
    """Samples that look towards -y, on a wall far wider than the path, by a narrow camera."""
    points = np.asarray(points, float)
    corners = np.array([[-99.0, 0, -9], [99, 0, -9], [99, 0, 9], [-99, 0, 9]])
    cloud = Cloud(points, normals=np.tile([0.0, -1, 0], (len(points), 1)), area_m2=np.ones(len(points)))
    settings = VisibilitySettings(occlusion=True, max_incidence_deg=75)
    scene = Scene(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    return View(cloud, np.ones(len(points)), Camera(20, 20, 1, 40), settings, LIMITS, scene)


def along_wall(count=81, yaw=np.pi / 2):
    """A flight of 20 m, 6 m before the wall, that looks straight at it."""
    positions = np.column_stack([np.linspace(-10, 10, count), np.full(count, -6.0), np.zeros(count)])
    quats = from_yaw_pitch(np.full(count, yaw), np.zeros(count))
    return Waypoints(positions, quats, np.linspace(0, 20 / SPEED, count), np.zeros(count, bool))


def turned_away(angles_deg, stations):
    """The flight with turns of the camera by these angles."""
    yaw = np.pi / 2 + np.radians(angles_deg)
    looks = Looks(np.asarray(stations), from_yaw_pitch(yaw, np.zeros(len(yaw))), np.ones(len(yaw)))
    return with_looks(along_wall(), looks)


def timed(path):
    flight = along_wall()
    return retime(path, Trajectory(flight.t_s, flight.positions, flight.quat_xyzw), LIMITS)[0]


def slowest(trajectory):
    """Least speed of a flight apart from its ends, m/s."""
    speed = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1) / np.diff(trajectory.t_s)
    return speed[np.abs(trajectory.positions[:-1, 0]) < 8].min()


def test_turns_lie_soon_after_their_station_one_behind_the_other():
    path = along_wall(count=3)
    quats = from_yaw_pitch(np.full(2, np.pi / 2), np.array([0.2, 0.1]))
    done, turns = with_looks(path, Looks(np.array([1, 1]), quats, np.ones(2)))
    np.testing.assert_array_equal(turns, [False, False, True, True, False])
    np.testing.assert_array_equal(done.positions[~turns], path.positions)
    np.testing.assert_array_equal(done.is_viewpoint, turns)
    way = done.positions[turns] - path.positions[1]
    assert 0 < way[0, 0] < way[1, 0] <= 0.8 and np.abs(way[:, 1:]).max() < 1e-9
    assert yaw_pitch(done.quat_xyzw[turns])[1] == pytest.approx([0.1, 0.2])  # the least turn first


def test_turns_at_the_end_stay_there():
    path = along_wall(count=3)
    done, turns = with_looks(path, Looks(np.array([2]), path.quat_xyzw[:1], np.ones(1)))
    np.testing.assert_array_equal(done.positions[2:], path.positions[[2, 2]])
    assert turns.tolist() == [False, False, False, True]


def test_a_path_without_turns_stays_as_it_is():
    path = along_wall()
    done, turns = with_looks(path, Looks(np.empty(0, np.int64), np.empty((0, 4)), np.empty(0)))
    assert not turns.any() and len(done) == len(path)
    assert eased(done, turns, np.full(len(done), SPEED), view_of([[0.0, 0, 0]])) is done


@pytest.mark.parametrize("angle_deg", [-100.0, 35.0, 90.0])
def test_a_turn_that_nothing_forbids_costs_no_speed(angle_deg):
    path, turns = turned_away([angle_deg], [40])
    wall = view_of([[-9.0, 0, 0], [9.0, 0, 0]])  # only the ends of the wall matter
    easy = eased(path, turns, np.full(len(path), SPEED), wall)
    np.testing.assert_array_equal(easy.positions, path.positions)
    np.testing.assert_allclose(easy.quat_xyzw[turns], path.quat_xyzw[turns])
    assert slowest(timed(path)) < 0.6 * SPEED
    assert slowest(timed(easy)) > 0.95 * SPEED
    assert timed(easy).t_s[-1] < timed(path).t_s[-1]


def test_between_two_turns_the_camera_goes_straight_from_one_to_the_other():
    path, turns = turned_away([80.0, 90.0], [40, 46])
    easy = eased(path, turns, np.full(len(path), SPEED), view_of([[-9.0, 0, 0], [9.0, 0, 0]]))
    first, last = np.flatnonzero(turns)
    yaw = np.degrees(yaw_pitch(easy.quat_xyzw[first : last + 1])[0])
    assert (np.diff(yaw) >= -1e-9).all() and yaw[0] == pytest.approx(170) and yaw[-1] == pytest.approx(180)


def test_what_only_a_pose_beside_the_turn_sees_is_still_seen():
    points = np.column_stack([np.arange(-9.5, 10, 0.5), np.zeros(39), np.zeros(39)])
    wall = view_of(points)
    path, turns = turned_away([90.0, 90.0], [30, 50])
    easy = eased(path, turns, np.full(len(path), SPEED), wall)
    assert (
        wall.covered(path.positions, path.quat_xyzw).sum()
        == wall.covered(easy.positions, easy.quat_xyzw).sum()
    )
    changed = angle_between(path.quat_xyzw, easy.quat_xyzw) > 1e-6
    assert changed.any() and not changed[turns].any()
    assert slowest(timed(easy)) >= slowest(timed(path))


def test_the_camera_turns_the_short_way_round():
    flight = along_wall(yaw=np.radians(170))
    looks = Looks(np.array([40]), from_yaw_pitch(np.radians([-170.0]), np.zeros(1)), np.ones(1))
    path, turns = with_looks(flight, looks)
    easy = eased(path, turns, np.full(len(path), SPEED), view_of([[0.0, 0, 0]]))
    assert np.degrees(angle_between(easy.quat_xyzw, flight.quat_xyzw[:1]).max()) < 20 + 1e-6
