"""What a path is to show, asked of samples in the open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.planning.trajectory.view import View
from upplied.records import Camera, Cloud

POINTS = np.array([[5.0, 0, 0], [8, 0, 0], [0, 5, 0], [5, 0.1, 0]])
NORMALS = np.array([[-1.0, 0, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0]])
FAR = Scene(np.array([[0.0, 0, -900], [1, 0, -900], [0, 1, -900]]), np.array([[0, 1, 2]]), 1)
VIEW = View(
    Cloud(POINTS, NORMALS), np.array([0.4, 0.3, 0.3, 0.0]), np.array([5.0, 7.9, 9.0, 9.0]), np.ones(4, bool),
    Camera(60, 60, 0.5, 50), VisibilitySettings(occlusion=True), RetimeSettings(), FAR,
)  # fmt: skip
AT = np.array([[0.0, 0, 0], [0.2, 0, 0]])
AHEAD = from_yaw_pitch(np.zeros(2), np.zeros(2))


def test_a_sample_is_seen_from_near_enough_alone() -> None:
    assert VIEW.shown(AT[:1], AHEAD[:1], np.arange(4)).tolist() == [True, False, False, False]
    assert VIEW.shown(AT[1:], AHEAD[1:], np.arange(4)).tolist() == [True, True, False, False]
    assert VIEW.shown(AT[:1], AHEAD[:1], np.array([1, 0])).tolist() == [False, True]
    assert VIEW.shown(AT, AHEAD, np.array([1, 0])).tolist() == [True, True]


def test_reach_is_what_a_camera_turned_anywhere_would_see() -> None:
    actual = VIEW.reach(AT, np.arange(4))
    assert actual.tolist() == [[True, False, True, False], [True, True, True, False]]
    aside = replace(VIEW, settings=VisibilitySettings(occlusion=False)).reach(AT, np.array([3]))
    assert not aside.any()  # what faces away is never fine enough


def test_missed_is_what_is_needed_and_not_seen() -> None:
    assert VIEW.missed(AT, AHEAD).tolist() == [2]
    assert VIEW.missed(AT[:1], AHEAD[:1]).tolist() == [1, 2]
    aside = from_yaw_pitch(np.array([0.0, np.pi / 2]), np.zeros(2))
    assert VIEW.missed(AT, aside).tolist() == [1]


def test_a_place_sees_as_its_camera_looks_and_as_its_station_zooms() -> None:
    stations = np.array([1, 1, 0])
    zoomed = replace(VIEW, fov_deg=np.array([[60.0, 60], [30, 30]]))  # half as coarse, and half as wide
    places, ahead = np.tile([0.0, 0, 0], (3, 1)), from_yaw_pitch(np.array([0.0, np.pi / 2, 0]), np.zeros(3))
    seen = zoomed.seen(places, ahead, np.arange(4), stations)
    assert seen.tolist() == [[True, True, False, False], [False, False, True, False], [True] + 3 * [False]]
    assert VIEW.seen(places, ahead, np.arange(4), stations)[0].tolist() == [True, False, False, False]
