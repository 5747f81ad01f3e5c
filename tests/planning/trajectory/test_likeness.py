"""What a bent path keeps: its shape, by the Frechet distance, and the stand-off of its viewpoints."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.carry.standoff import picture_share, standoff_of
from upplied.planning.geometry.frechet import frechet, frechet_floored, within_leash, zscored
from upplied.planning.trajectory.likeness import Likeness
from upplied.planning.trajectory.look import View
from upplied.planning.trajectory.stretch import stretched
from upplied.records import Camera, Cloud
from upplied.scene import Scene


def wave(count=81, height=2.0, y=-1.5):
    """A path along a wall in the plane y = 0 that rises and sinks about z = 10."""
    x = np.linspace(-10, 10, count)
    return np.column_stack([x, np.full(count, y), 10 + height * np.sin(x)])


def standing_off(path):
    """Viewpoints that each see the foot of their perpendicular on the wall."""
    station = np.arange(0, len(path), 8)
    foot = path[station] * [1, 0, 1]
    return standoff_of(station, np.eye(len(station)), foot, np.abs(path[station, 1]))


def test_one_decision_agrees_with_the_distance():
    rng = np.random.default_rng(3)
    for _ in range(20):
        one, other = rng.normal(size=(12, 3)).cumsum(axis=0), rng.normal(size=(9, 3)).cumsum(axis=0)
        distance = frechet(one, other)
        assert within_leash(one, other, distance * (1 + 1e-9))
        assert not within_leash(one, other, distance * (1 - 1e-6))


def test_the_stand_off_is_the_median_distance_to_what_is_seen():
    path = wave()
    standoff = standing_off(path)
    np.testing.assert_allclose(standoff.ratio(path), 1.0)
    np.testing.assert_allclose(standoff.ratio(path * [1, 1.5, 1]), 1.5)
    assert standoff.share(path * [1, 1.15, 1]) == 1.0
    assert standoff.share(path * [1, 1.25, 1]) == 0.0
    half = np.where(np.arange(len(path))[:, None] < 40, path * [1, 1.5, 1], path)
    assert standoff.share(half) == pytest.approx(np.mean(standoff.station >= 40))


def test_a_viewpoint_that_sees_nothing_has_no_stand_off():
    path = wave()
    wanted = np.array([np.nan, 1.5, 1.5])
    weight = np.array([[1.0, 0], [1, 1], [0, 0]])
    assert list(standoff_of(np.array([0, 5, 9]), weight, path[:2], wanted).station) == [5]


def test_shape_and_stand_off_are_both_kept():
    path = wave()
    likeness = Likeness(zscored(path), 0.3, standing_off(path))
    slightly = path + np.column_stack([np.zeros((81, 2)), 0.2 * np.cos(path[:, 0] / 3)])
    strongly = path + np.column_stack([np.zeros((81, 2)), 3.0 * np.cos(path[:, 0] / 3)])
    assert likeness.kept(slightly, path)
    assert not likeness.kept(strongly, path)
    assert likeness.kept(slightly, strongly)  # who strayed already may come back
    assert replace(likeness, leash=9.0).kept(strongly, path) is False  # what it saw is too far off now
    nobody = standoff_of(np.empty(0, np.int64), np.empty((0, 1)), path[:1], np.empty(0))
    assert replace(likeness, leash=9.0, standoff=nobody).kept(strongly, path)


def test_a_path_that_strayed_may_stray_no_further():
    path = wave()
    nobody = standoff_of(np.empty(0, np.int64), np.empty((0, 1)), path[:1], np.empty(0))
    likeness = Likeness(zscored(path), 0.05, nobody)

    def strayed(by):
        return path + np.column_stack([np.zeros((81, 2)), by * np.cos(path[:, 0] / 3)])

    assert frechet(likeness.shape, zscored(strayed(1.0))) > likeness.leash
    assert not likeness.kept(strayed(2.0), strayed(1.0))
    assert not likeness.kept(strayed(1.05), strayed(1.0))
    assert likeness.kept(strayed(0.9), strayed(1.0))


@pytest.fixture(scope="module")
def tall_wall():
    """20 x 20 m; a path at 1.5 m sees 5.6 m up and down at 75 degrees."""
    x, z = np.meshgrid(np.arange(-9.5, 10), np.arange(0.5, 20))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    corners = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 20], [-10, 0, 20]])
    cloud = Cloud(points, np.tile([0.0, -1, 0], (len(points), 1)), np.ones(len(points)))
    seeing = VisibilitySettings(occlusion=True, max_incidence_deg=75)
    scene = Scene(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    return View(cloud, np.ones(400), Camera(90, 90, 1, 40), seeing, RetimeSettings(), scene)


def test_a_path_is_stretched_where_that_shows_more(tall_wall):
    path = wave()
    likeness = Likeness(zscored(path), 0.3, standing_off(path))
    loose = replace(likeness, standoff=replace(likeness.standoff, wanted_m=np.full(11, 1e-3)))
    done = stretched(path, tall_wall, loose, lambda at: at[:, 2] < 15)
    everything = np.arange(400)
    before, after = (tall_wall.reach(at, everything).any(axis=0).sum() for at in (path, done))
    assert after > before
    assert frechet_floored(path, done) <= 0.3
    assert done[:, 2].max() < 15
    kept = stretched(path, tall_wall, likeness, lambda at: at[:, 2] < 15)
    assert likeness.standoff.share(kept) >= 0.95  # a path that must keep its distance is stretched less


def test_a_path_that_sees_all_stays_as_it_is(tall_wall):
    path = wave(y=-8.0)
    likeness = Likeness(zscored(path), 9.0, standing_off(path))
    assert stretched(path, tall_wall, likeness, lambda at: at[:, 2] > -99) is path


def test_a_picture_is_about_what_fills_it_and_what_the_flight_was_about() -> None:
    rng = np.random.default_rng(4)
    points, normals = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    area, part = rng.uniform(1, 2, 40), np.repeat([0, 1], 20)
    inspected = rng.random(40) < np.where(part == 0, 0.9, 0.2)
    cloud = Cloud(points, normals=normals, area_m2=area, part=part)
    positions, known = rng.normal(size=(7, 3)) * 6, np.arange(0, 40, 3)
    found = picture_share(positions, cloud, known, inspected)
    for pose, sample in itertools.product(range(7), range(len(known))):
        k = known[sample]
        ray = positions[pose] - points[k]
        length = np.linalg.norm(ray)
        angle = area[k] * max(ray @ normals[k] / length, 0.0) / length**2
        of_part = part == part[k]
        meant = area[of_part & inspected].sum() / area[of_part].sum()
        assert found[pose, sample] == pytest.approx(angle * meant**2, rel=1e-12)
