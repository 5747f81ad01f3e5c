"""Looks aside: towards what is missed, where it is worth it, as a tent over the way that it takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.trajectory.looks import _in_picture, looks_aside
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.poses import from_yaw_pitch
from upplied.records import Camera, Cloud, Floats
from upplied.scene import Scene

PRICE, WAY = 0.01, 2.0  # share of the need for a radian, metres flown for a radian


def view(points: Floats, normals: Floats, need: Floats | None = None, **camera: float) -> View:
    """Samples in the open; a far triangle is all that could hide them."""
    count = len(points)
    far = Scene(np.array([[0.0, 0, -900], [1, 0, -900], [0, 1, -900]]), np.array([[0, 1, 2]]), 1)
    return View(
        Cloud(points, normals), np.full(count, 1 / count) if need is None else need, np.full(count, 12.0),
        np.ones(count, bool), replace(Camera(40, 30, 0.5, 50), **camera), VisibilitySettings(occlusion=True),
        RetimeSettings(min_gimbal_pitch_deg=-60.0, max_gimbal_pitch_deg=20.0), far,
    )  # fmt: skip


def along_x(count: int = 81, yaw: float = 0.0, pitch: float = 0.0) -> Flown:
    """20 m along x, looking ahead."""
    at = np.column_stack([np.linspace(0, 20, count), np.zeros((count, 2))])
    return Flown(at, np.full(count, yaw), np.full(count, pitch))


LEFT = np.array([[10.0, 6, 0]]), np.array([[0.0, -1, 0]])


def test_the_camera_is_turned_to_what_is_missed() -> None:
    asked, path = view(*LEFT), along_x()
    found = looks_aside(path, asked, PRICE, WAY)
    assert len(asked.missed(found.positions, from_yaw_pitch(found.yaw, found.pitch))) == 0
    assert found.positions is path.positions
    station = int(np.abs(found.yaw).argmax())
    to = LEFT[0][0] - path.positions[station]
    turn = np.arctan2(to[1], to[0])
    assert found.yaw[station] == pytest.approx(turn)
    tent = np.clip(1 - np.abs(path.positions[:, 0] - path.positions[station, 0]) / (WAY * turn), 0, 1)
    assert found.yaw == pytest.approx(turn * tent)
    assert found.pitch == pytest.approx(np.zeros(81), abs=1e-9)
    # The least turn of all from which it is near enough and not too oblique.
    cosine = 6 / np.linalg.norm(LEFT[0][0] - path.positions, axis=1)
    seen = (np.linalg.norm(LEFT[0][0] - path.positions, axis=1) <= 12) & (cosine >= np.cos(np.radians(75)))
    angles = np.arctan2(6, 10 - path.positions[:, 0])
    assert turn == pytest.approx(angles[seen].min(), abs=1e-9)


def test_a_look_up_keeps_to_the_gimbals_limits() -> None:
    high, up = np.array([[10.0, 0.5, 6]]), np.array([[0.0, 0, -1]])
    found = looks_aside(along_x(pitch=0.1), view(high, up), PRICE, WAY)
    assert found.pitch.max() <= np.radians(20) + 1e-12 and found.pitch.max() > 0.3
    low, down = np.array([[10.0, 0.5, -7]]), np.array([[0.0, 0, 1]])
    dive = looks_aside(along_x(), view(low, down), PRICE, WAY)
    assert -np.radians(60) <= dive.pitch.min() < -0.3


def test_what_is_not_worth_its_price_is_left() -> None:
    path = along_x()
    turn = np.arctan2(6, np.sqrt(144 - 36))
    assert looks_aside(path, view(*LEFT), 0.9 / (2 * turn), WAY).yaw.max() > 0
    dear = looks_aside(path, view(*LEFT), 1.2 / (2 * turn), WAY)
    assert not dear.yaw.any()
    crumbs = view(np.vstack([LEFT[0], [[10.0, 6, 1]]]), np.vstack([LEFT[1]] * 2), np.array([5e-5, 0.0]))
    assert not looks_aside(path, crumbs, 0.0, WAY).yaw.any()


def test_a_path_that_misses_nothing_or_reaches_nothing_stays_as_it_is() -> None:
    path = along_x()
    ahead = view(np.array([[10.0, 0, 0]]), np.array([[-1.0, 0, 0]]))
    assert looks_aside(path, ahead, PRICE, WAY) is path
    away = view(np.array([[10.0, 6, 0]]), np.array([[0.0, 1, 0]]))
    assert looks_aside(path, away, PRICE, WAY) is path


def test_two_sides_get_two_looks_that_do_not_overlap() -> None:
    both = np.array([[7.0, 6, 0], [14, -6, 0]]), np.array([[0.0, -1, 0], [0, 1, 0]])
    asked = view(*both)
    found = looks_aside(along_x(), asked, PRICE, WAY)
    assert found.yaw.max() > 0.5 and found.yaw.min() < -0.5
    assert len(asked.missed(found.positions, from_yaw_pitch(found.yaw, found.pitch))) == 0


def test_the_more_needed_is_looked_at_where_both_cannot_be() -> None:
    """From one place: the camera turns once, to the side that counts for more."""
    still = Flown(np.zeros((5, 3)), np.zeros(5), np.zeros(5))
    both = np.array([[0.0, 6, 0], [0, -6, 0]]), np.array([[0.0, -1, 0], [0, 1, 0]])
    for need, side in (([0.7, 0.3], 1.0), ([0.3, 0.7], -1.0)):
        found = looks_aside(still, view(*both, np.array(need)), PRICE, WAY)
        assert found.yaw == pytest.approx(np.full(5, side * np.pi / 2))


def test_a_look_takes_in_all_that_one_picture_holds() -> None:
    x = np.linspace(9.0, 11.0, 5)
    points = np.column_stack([x, np.full(5, 6.0), np.zeros(5)])
    found = looks_aside(along_x(), view(points, np.tile([0.0, -1, 0], (5, 1))), PRICE, WAY)
    assert (np.diff(np.sign(np.diff(found.yaw[found.yaw > 0]))) != 0).sum() <= 1  # one tent
    far = looks_aside(along_x(yaw=np.pi), view(*LEFT), PRICE, WAY)
    assert np.abs(far.yaw - np.pi).max() < np.pi  # the shorter way round


def test_a_round_camera_sees_what_is_beside_it_but_not_above() -> None:
    round_ = view(np.array([[10.0, 3, 5.9]]), np.array([[0.0, -0.6, -0.8]]), hfov_deg=200.0, vfov_deg=30.0)
    found = looks_aside(along_x(), round_, PRICE, WAY)
    assert len(round_.missed(found.positions, from_yaw_pitch(found.yaw, found.pitch))) == 0
    assert found.pitch.max() > np.radians(5)


def test_a_look_goes_from_where_the_camera_points_to_its_sample() -> None:
    path, asked = along_x(yaw=0.2, pitch=-0.4), view(*LEFT)
    found = looks_aside(path, asked, PRICE, WAY)
    station = int(np.abs(found.yaw - 0.2).argmax())
    to = LEFT[0][0] - path.positions[station]
    assert found.yaw[station] == pytest.approx(np.arctan2(to[1], to[0]))
    assert found.pitch[station] == pytest.approx(0, abs=1e-9)
    turn = np.hypot(np.cos(0.4) * (found.yaw[station] - 0.2), 0.4)
    tent = np.clip(1 - np.abs(path.positions[:, 0] - path.positions[station, 0]) / (WAY * turn), 0, 1)
    assert found.yaw - 0.2 == pytest.approx((found.yaw[station] - 0.2) * tent)
    assert found.pitch + 0.4 == pytest.approx(0.4 * tent)


def test_in_the_picture_is_what_both_angles_say() -> None:
    rng = np.random.default_rng(0)
    places, points = rng.normal(0, 4, (3, 3)), rng.normal(0, 4, (60, 3))
    row, turns = rng.integers(0, 3, 12), Rotation.random(12, random_state=1)
    reach, round_ = rng.random((3, 60)) < 0.8, np.arange(12) % 2 == 0
    half = np.column_stack([np.where(round_, 2.0, 0.6), np.full(12, 0.5)])
    found = _in_picture(places, row, turns.as_matrix(), points, reach, half, round_)
    for at in range(12):
        x, y, z = turns[at].inv().apply(points - places[row[at]]).T
        ahead = np.hypot(x, y) if round_[at] else x
        within = (np.abs(np.arctan2(y, x)) <= half[at, 0]) & (np.abs(np.arctan2(z, ahead)) <= half[at, 1])
        assert np.array_equal(found[at], within & reach[row[at]])
    assert 0.02 < found.mean() < 0.5
