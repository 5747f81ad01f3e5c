"""The plane of a flight on the ground or the water, at the target."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from upplied.config import TransferSettings
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.affine import at_height, plane_height
from upplied.planning.correspondence.pair import Pair
from upplied.records import Surroundings, Trajectory, Waypoints

CARRIED = np.array([[0.0, 0, 6.0], [1, 0, 7.0], [2, 0, 11.0]])
FLOWN = Trajectory(np.arange(3.0), np.array([[0.0, 0, 2.0], [1, 0, 3.0], [2, 0, 4.0]]), np.zeros((3, 4)))


def pair(here: float | None, there: float | None) -> Pair:
    grounds = (SimpleNamespace(surroundings=Surroundings(ground_z_m=z)) for z in (here, there))
    return cast(Pair, SimpleNamespace(**dict(zip(("source", "target"), grounds, strict=True))))


def test_a_robot_does_not_grow_where_both_grounds_are_known() -> None:
    unscaled, scaled = TransferSettings(standoff="kept"), TransferSettings(standoff="scaled")
    assert plane_height(FLOWN, pair(1.0, 20.0), CARRIED, unscaled) == pytest.approx(22.0)
    assert plane_height(FLOWN, pair(0.0, 0.0), CARRIED, unscaled) == pytest.approx(3.0)
    assert plane_height(FLOWN, pair(1.0, 20.0), CARRIED, scaled) == pytest.approx(8.0)
    for known in (pair(None, 20.0), pair(1.0, None), pair(None, None)):
        assert plane_height(FLOWN, known, CARRIED, unscaled) == pytest.approx(8.0)


def test_the_airspace_is_a_few_centimetres_about_the_plane() -> None:
    far = Scene(np.array([[0.0, 0, -900], [1, 0, -900], [0, 1, -900]]), np.array([[0, 1, 2]]), 1)
    fence = np.array([[-9.0, -9], [9, -9], [0, 9]])
    wide = Airspace(far, 2.0, Surroundings(ground_z_m=-5.0, ceiling_z_m=99.0, geofence_m=fence), 3.0)
    band = wide.in_plane(7.0)
    heights = np.array([6.94, 6.951, 7.0, 7.049, 7.06])
    at = np.column_stack([np.zeros((5, 2)), heights])
    assert band.in_bounds(at).tolist() == [False, True, True, True, False]
    assert not band.in_bounds(at + np.array([50.0, 0, 0])).any() and band.clearance_m == 2.0
    assert band.floor_m == pytest.approx(6.95) and band.ceiling_m == pytest.approx(7.05)


def test_all_waypoints_are_put_at_one_height() -> None:
    path = Waypoints(CARRIED, np.zeros((3, 4)), np.arange(3.0), np.array([True, False, True]))
    level = at_height(path, 4.0)
    assert level.positions.tolist() == [[0, 0, 4], [1, 0, 4], [2, 0, 4]] and CARRIED[2, 2] == 11
    assert level.is_viewpoint is path.is_viewpoint and level.t_s is path.t_s
