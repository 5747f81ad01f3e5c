"""Extra views of what all of a path misses: only where that is allowed, and worth its price."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.extra_views import (
    Price,
    _Places,
    _taken,
    in_picture,
    places_beside,
    with_extra_views,
)
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.records import Camera, Cloud, Surroundings

COUNT, HIGH = 61, 5.0  # stations; m, of the roof


@pytest.fixture(scope="module")
def roof() -> View:
    """A box of 20 x 4 x 5 m; its front and its roof are to be shown."""
    x = np.arange(-9.5, 10)
    front = np.array([[a, -2.0, b] for a in x for b in np.arange(0.5, HIGH)])
    top = np.array([[a, b, HIGH] for a in x for b in (-1.5, -0.5, 0.5, 1.5)])
    normals = np.concatenate([np.tile([0.0, -1, 0], (len(front), 1)), np.tile([0.0, 0, 1], (len(top), 1))])
    points = np.concatenate([front, top])
    corners = np.array(list(itertools.product((-10.0, 10.0), (-2.0, 2.0), (0.0, HIGH))))
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    return View(
        cloud=Cloud(points, normals=normals, area_m2=np.ones(len(points))),
        need=np.full(len(points), 1 / len(points)),
        farthest_m=np.full(len(points), 40.0),
        inspected=np.ones(len(points), bool),
        camera=Camera(hfov_deg=60, vfov_deg=60, min_range_m=0.5, max_range_m=40),
        settings=VisibilitySettings(occlusion=True, max_incidence_deg=75),
        limits=RetimeSettings(),
        scene=Scene(corners, triangles),
    )


def below_the_roof() -> Flown:
    """Along the front, 6 m before it, below the roof's height."""
    x = np.linspace(-10, 10, COUNT)
    return Flown(
        np.column_stack([x, np.full(COUNT, -8.0), np.full(COUNT, 3.0)]),
        np.full(COUNT, np.pi / 2),
        np.zeros(COUNT),
    )


def price(of: float) -> Price:
    return Price(6.0, lambda off: of * (off**2).sum(axis=1) / 36, 0.001, 1.0)


def shown(view: View, path: Flown) -> float:
    everything = np.arange(len(view.need))
    seen = view.shown(path.positions, from_yaw_pitch(path.yaw, path.pitch), everything)
    return float(view.need[seen].sum())


def test_no_look_from_the_path_shows_the_roof(roof: View) -> None:
    top = np.flatnonzero(roof.cloud.normals[:, 2] > 0)
    assert not roof.reach(below_the_roof().positions, top).any()


def test_a_path_rises_to_see_a_roof_and_keeps_its_distance(roof: View) -> None:
    path, airspace = below_the_roof(), Airspace(roof.scene, 2.0, Surroundings(ground_z_m=0.0), 1.0)
    found = with_extra_views(path, roof, airspace, price(0.05))
    assert shown(roof, found) > shown(roof, path) + 0.1
    assert found.positions[:, 2].max() > HIGH
    assert airspace.allowed(found.positions).all()


def test_a_path_stays_where_leaving_it_is_too_dear_or_forbidden(roof: View) -> None:
    path = below_the_roof()
    free = Airspace(roof.scene, 2.0, Surroundings())
    low = Airspace(roof.scene, 2.0, Surroundings(ceiling_z_m=4.5))
    for airspace, aside in ((free, price(100.0)), (low, price(0.05))):
        found = with_extra_views(path, roof, airspace, aside)
        np.testing.assert_array_equal(found.positions, path.positions)


def test_a_path_that_misses_nothing_stays(roof: View) -> None:
    front = np.flatnonzero(roof.cloud.normals[:, 2] == 0)
    need = np.zeros(len(roof.need))
    need[front] = 1 / len(front)
    view = replace(roof, need=need)
    path = below_the_roof()
    assert shown(view, path) == pytest.approx(1)
    assert with_extra_views(path, view, Airspace(roof.scene, 2.0, Surroundings()), price(0.0)) is path


def bent_line() -> Flown:
    """Stations at 0, 10, 30 and 60 m along a line, the camera level."""
    x = np.array([0.0, 10, 30, 60])
    return Flown(np.column_stack([x, 0 * x, 0 * x]), np.zeros(4), np.zeros(4))


def places(*given: tuple[int, list[float], float, float, list[bool]]) -> _Places:
    at, off, yaw, pitch, shows = zip(*given, strict=True)
    return _Places(np.array(at), np.array(off), np.array(yaw), np.array(pitch), np.array(shows))


DEAR = Price(6.0, lambda off: (np.atleast_2d(off) ** 2).sum(axis=1), 0.25, 1.0)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_place_is_taken_where_it_shows_more_than_it_costs(share: float) -> None:
    """Five metres aside of sixty, there and back on twice as much path each, and 0.2 rad turned."""
    price = 2 / 3 * (2 * 5) / 60 * 5**2 + 2 * 0.25 * 0.2 + 5e-3
    found = _taken(bent_line(), places((2, [0, 4, 3], 0.2, 0, [True])), np.array([share * price]), DEAR)
    tent = np.clip(1 - np.abs(np.array([0.0, 10, 30, 60]) - 30) / 10, 0, 1)
    taken = share > 1
    np.testing.assert_allclose(found.positions - bent_line().positions, taken * np.outer(tent, [0, 4, 3]))
    np.testing.assert_allclose(found.yaw, taken * 0.2 * tent)


def test_a_level_camera_turns_by_its_heading_and_a_steep_one_by_less() -> None:
    steep = Flown(bent_line().positions, np.zeros(4), np.full(4, np.arccos(0.5)))
    turned = 2 * 0.25 * np.hypot(0.5 * 0.6, 0.1) + 2 / 3 * 2 / 60 + 5e-3
    for share in (0.99, 1.01):
        one = places((1, [1, 0, 0], 0.6, np.arccos(0.5) - 0.1, [True]))
        found = _taken(steep, one, np.array([share * turned]), DEAR)
        assert found.pitch[1] == pytest.approx(np.arccos(0.5) - 0.1 * (share > 1))


def test_the_dearest_sight_is_taken_first_and_nothing_is_shown_twice() -> None:
    """The first of two places shows what the other one does, too; the third shows something else."""
    free = Price(6.0, lambda off: 0 * np.atleast_2d(off)[:, 0], 0.0, 1.0)
    given = places(
        (1, [0, 1, 0], 0, 0, [True, False, False]), (2, [0, 2, 0], 0, 0, [True, True, False]),
        (3, [0, 0, 3], 0, 0, [False, False, True]),
    )  # fmt: skip
    found = _taken(bent_line(), given, np.array([0.4, 0.1, 0.2]), free)
    moved = found.positions - bent_line().positions
    np.testing.assert_allclose(moved, [[0, 0, 0], [0, 0, 0], [0, 2, 0], [0, 0, 3]])


def test_places_are_tried_all_round_as_the_camera_looks() -> None:
    path = Flown(np.zeros((3, 3)), np.array([0.0, np.pi / 2, np.pi]), np.array([0.0, 1.0, -1.0]))
    at, off = places_beside(path, 10.0)
    assert at.tolist() == [0] * 53 + [1] * 53 + [2] * 53
    assert not off[::53].any()  # the stations themselves
    length = np.linalg.norm(off, axis=1).reshape(3, 53)[:, 1:].reshape(3, 2, 26)
    np.testing.assert_allclose(length, np.broadcast_to(np.array([4.0, 8.0])[:, None], (3, 2, 26)))
    ways = {tuple(np.round(way, 6)) for way in off[1:27] / 4.0}
    every = [np.array(way) for way in itertools.product((-1, 0, 1), repeat=3) if any(way)]
    assert ways == {tuple(np.round(way / np.linalg.norm(way), 6)) for way in every}
    ahead = off.reshape(3, 53, 3)[:, 26]  # ahead, to the left and up, whatever the camera's elevation
    np.testing.assert_allclose(ahead[0], 4 / np.sqrt(3) * np.array([1, 1, 1]))
    np.testing.assert_allclose(ahead[1], 4 / np.sqrt(3) * np.array([-1, 1, 1]), atol=1e-9)
    many = Flown(np.zeros((500, 3)), np.zeros(500), np.zeros(500))
    stations = np.unique(places_beside(many, 1.0)[0])
    assert len(stations) == 48 and stations[[0, -1]].tolist() == [0, 499]


def test_the_camera_turns_on_the_path_to_what_it_looks_away_from(roof: View) -> None:
    """The front lies behind the camera, and leaving the path is too dear."""
    away = replace(below_the_roof(), yaw=np.full(COUNT, -np.pi / 2))
    dear = Price(6.0, lambda off: 1e3 * (off**2).sum(axis=1), 0.001, 2.0)
    found = with_extra_views(away, roof, Airspace(roof.scene, 2.0, Surroundings()), dear)
    assert shown(roof, away) == 0 and shown(roof, found) > 0.4
    np.testing.assert_array_equal(found.positions, away.positions)
    low, high = np.radians([roof.limits.min_gimbal_pitch_deg, roof.limits.max_gimbal_pitch_deg])
    assert found.pitch.min() >= low - 1e-9 and found.pitch.max() <= high + 1e-9
    # A radian takes two metres of the path, and so does the way back.
    still = found.yaw == away.yaw
    assert 0 < still.sum() < COUNT
    dearer = replace(dear, turn=10.0)
    kept = with_extra_views(away, roof, Airspace(roof.scene, 2.0, Surroundings()), dearer)
    np.testing.assert_array_equal(kept.yaw, away.yaw)


def test_a_turn_on_the_path_comes_and_goes_as_steadily_as_the_camera_turns() -> None:
    """Half a radian at ten metres a radian: five metres to each side."""
    x = np.arange(0.0, 21.0)
    path = Flown(np.column_stack([x, 0 * x, 0 * x]), 0 * x, 0 * x)
    free = Price(6.0, lambda off: 0 * np.atleast_2d(off)[:, 0], 0.25, 10.0)
    one = places((10, [0, 0, 0], 0.5, 0, [True]))
    found = _taken(path, one, np.array([1.0]), free)
    np.testing.assert_allclose(found.yaw, 0.5 * np.clip(1 - np.abs(x - 10) / 5, 0, 1))
    for left, taken in ((0.254, False), (0.256, True)):  # there and back
        assert _taken(path, one, np.array([left]), free).yaw.any() == taken


def test_in_the_picture_is_what_both_angles_say() -> None:
    rng = np.random.default_rng(0)
    places, points = rng.normal(0, 4, (3, 3)), rng.normal(0, 4, (60, 3))
    row, turns = rng.integers(0, 3, 12), Rotation.random(12, random_state=1)
    reach, round_ = rng.random((3, 60)) < 0.8, np.arange(12) % 2 == 0
    half = np.column_stack([np.where(round_, 2.0, 0.6), np.full(12, 0.5)])
    found = in_picture(places, row, turns.as_matrix(), points, reach, half, round_)
    for at in range(12):
        x, y, z = turns[at].inv().apply(points - places[row[at]]).T
        ahead = np.hypot(x, y) if round_[at] else x
        within = (np.abs(np.arctan2(y, x)) <= half[at, 0]) & (np.abs(np.arctan2(z, ahead)) <= half[at, 1])
        assert np.array_equal(found[at], within & reach[row[at]])
    assert 0.02 < found.mean() < 0.5
