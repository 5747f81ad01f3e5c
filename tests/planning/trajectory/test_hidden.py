"""What a path misses draws it to places beside it, where that is allowed, and as strongly as it counts."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.coverage import Hidden, _shared
from upplied.planning.trajectory.view import View, places_beside
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


def shown(view: View, path: Flown) -> float:
    everything = np.arange(len(view.need))
    seen = view.shown(path.positions, from_yaw_pitch(path.yaw, path.pitch), everything)
    return float(view.need[seen].sum())


def test_no_look_from_the_path_shows_the_roof(roof: View) -> None:
    top = np.flatnonzero(roof.cloud.normals[:, 2] > 0)
    assert not roof.reach(below_the_roof().positions, top).any()


def free_above(view: View, **bounds: float) -> Airspace:
    return Airspace(view.scene, 2.0, Surroundings(**bounds), 1.0)


def test_the_roof_draws_the_path_up_to_where_it_is_seen(roof: View) -> None:
    path, airspace = below_the_roof(), free_above(roof, ground_z_m=0.0)
    hidden = Hidden.of(roof, airspace, path, 6.0)
    assert len(hidden.station) and (hidden.place[:, 2] > HIGH).all()
    assert airspace.allowed(hidden.place).all()
    # Each place shows of what is missed as much as it counts for, and together they show it all.
    missed = roof.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    seen = roof.reach(hidden.place, missed, station=hidden.station)
    assert (hidden.need <= seen @ roof.need[missed] + 1e-12).all()
    assert hidden.need.sum() <= roof.need[missed].sum() + 1e-12
    downhill = hidden.value(path)[1].positions
    assert (downhill[hidden.station, 2] < 0).all()
    led = replace(path, positions=path.positions.copy())
    led.positions[hidden.station] = hidden.place
    assert shown(roof, led) > shown(roof, path) + 0.05
    # All of the need is to be won, and from where the path is now there is as much to win as it counts for.
    assert hidden.value(path)[0] == pytest.approx(hidden.need.sum())
    assert hidden.value(led)[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("share", "draws"), [(0.2, 0.2 / 1.05), (0.01, 0.005), (1e-4, 1e-4 / 101)])
def test_little_hidden_surface_draws_the_path_by_less_than_its_share(
    roof: View, share: float, draws: float
) -> None:
    """By half where it is a percent of what is to be shown: one sample of thousands draws nothing."""
    path, airspace = below_the_roof(), free_above(roof, ground_z_m=0.0)
    missed = roof.missed(path.positions, from_yaw_pitch(path.yaw, path.pitch))
    hidden = Hidden.of(roof, airspace, path, 6.0)
    shows = roof.reach(hidden.place, missed, station=hidden.station).any(axis=0)
    less = replace(roof, need=roof.need * share / roof.need[missed][shows].sum())
    assert Hidden.of(less, airspace, path, 6.0).need.sum() == pytest.approx(draws, rel=1e-3)


def test_nothing_draws_a_path_to_where_it_may_not_fly(roof: View) -> None:
    path = below_the_roof()
    for airspace in (free_above(roof, ceiling_z_m=4.5), free_above(roof, ceiling_z_m=0.5)):
        hidden = Hidden.of(roof, airspace, path, 6.0)
        value, slope = hidden.value(path)
        assert value == 0 and not slope.positions.any() and not slope.yaw.any() and not slope.pitch.any()


def test_a_path_that_misses_nothing_is_not_drawn(roof: View) -> None:
    front = np.flatnonzero(roof.cloud.normals[:, 2] == 0)
    need = np.zeros(len(roof.need))
    need[front] = 1 / len(front)
    view, path = replace(roof, need=need), below_the_roof()
    assert shown(view, path) == pytest.approx(1)
    assert Hidden.of(view, free_above(roof), path, 6.0).value(path)[0] == 0


def test_the_slope_is_that_of_the_value() -> None:
    rng = np.random.default_rng(1)
    station = np.array([0, 2, 2])
    hidden = Hidden(station, rng.normal(0, 2, (3, 3)), np.array([0.1, 0.02, 0.3]), np.array([1.0, 2.0, 3.0]))
    positions = rng.normal(0, 2, (4, 3))
    slope = hidden.value(Flown(positions, np.zeros(4), np.zeros(4)))[1]
    for place in np.ndindex(4, 3):
        ends = []
        for step in (-1e-6, 1e-6):
            moved = positions.copy()
            moved[place] += step
            ends.append(hidden.value(Flown(moved, np.zeros(4), np.zeros(4)))[0])
        assert slope.positions[place] == pytest.approx((ends[1] - ends[0]) / 2e-6, abs=1e-8)
    assert not slope.yaw.any() and not slope.pitch.any()


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


def test_what_several_places_show_is_shared_and_nothing_hangs_on_a_hair() -> None:
    """The first two show the same, the third shows half of it and something of its own, the last nothing."""
    shows = np.array([[1, 1, 0, 0], [1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0]], bool)
    need, away_m = np.array([0.4, 0.1, 0.2, 0.3]), np.array([1.0, 1.0, 1.0, 1.0])
    share = _shared(shows, need, away_m)
    assert share.sum() == pytest.approx(0.7)  # of what any of them shows
    assert share[0] == share[1] and share[3] == 0
    assert 0.2 <= share[2] < 0.21 < share[0]
    nearly = _shared(shows, need * np.array([1 + 1e-9, 1, 1, 1]), away_m * np.array([1, 1 + 1e-9, 1, 1]))
    np.testing.assert_allclose(nearly, share, rtol=1e-7)
    assert _shared(shows, need, np.array([0.5, 1.0, 1.0, 1.0]))[0] > 0.48  # twice as near as the other
    assert not _shared(shows[:0], need, away_m[:0]).size
