"""Leaving the path for what all of it misses: only where that is hidden, allowed, and worth its price."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.moves import Aside, moves_aside
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.poses import from_yaw_pitch
from upplied.records import Camera, Cloud, Surroundings
from upplied.scene import Scene

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
        farthest_m=np.full(len(points), 14.0),
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


def price(of: float) -> Aside:
    return Aside(6.0, lambda off: of * (off**2).sum(axis=1) / 36, 0.001)


def shown(view: View, path: Flown) -> float:
    everything = np.arange(len(view.need))
    seen = view.sees(path.positions, from_yaw_pitch(path.yaw, path.pitch), everything)
    return float(view.need[seen.any(axis=0)].sum())


def test_no_look_from_the_path_shows_the_roof(roof: View) -> None:
    top = np.flatnonzero(roof.cloud.normals[:, 2] > 0)
    assert not roof.reach(below_the_roof().positions, top).any()


def test_a_path_rises_to_see_a_roof_and_keeps_its_distance(roof: View) -> None:
    path, airspace = below_the_roof(), Airspace(roof.scene, 2.0, Surroundings(ground_z_m=0.0), 1.0)
    found = moves_aside(path, roof, airspace, price(0.05))
    assert shown(roof, found) > shown(roof, path) + 0.1
    assert found.positions[:, 2].max() > HIGH
    assert airspace.allowed(found.positions).all()


def test_a_path_stays_where_leaving_it_is_too_dear_or_forbidden(roof: View) -> None:
    path = below_the_roof()
    free = Airspace(roof.scene, 2.0, Surroundings())
    low = Airspace(roof.scene, 2.0, Surroundings(ceiling_z_m=4.5))
    for airspace, aside in ((free, price(100.0)), (low, price(0.05))):
        found = moves_aside(path, roof, airspace, aside)
        np.testing.assert_array_equal(found.positions, path.positions)


def test_a_path_that_misses_nothing_stays(roof: View) -> None:
    front = np.flatnonzero(roof.cloud.normals[:, 2] == 0)
    need = np.zeros(len(roof.need))
    need[front] = 1 / len(front)
    view = replace(roof, need=need)
    path = below_the_roof()
    assert shown(view, path) == pytest.approx(1)
    assert moves_aside(path, view, Airspace(roof.scene, 2.0, Surroundings()), price(0.0)) is path
