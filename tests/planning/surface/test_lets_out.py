"""Rays that tell what is outside: their directions, how many are cast, and the floor that stops them."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from upplied.geometry.scene import Scene
from upplied.geometry.vectors import sphere
from upplied.planning.surface.escape import Floor, lets_out
from upplied.records import Bools, Floats

REACH = 50.0
UP, DOWN = np.array([[0.0, 0, 1]]), np.array([[0.0, 0, -1]])


class Rays:
    """A scene that notes the rays, of which so many in a row are free."""

    def __init__(self, free: int = 0) -> None:
        self.free, self.rays = free, np.empty((0, 3))

    origin = np.array([7.0, 8.0, 9.0])

    def blocked(self, rays: Floats, slack: float) -> Bools:
        assert slack == 0.0
        assert rays[:, :3] == pytest.approx(np.tile(1 - self.origin, (len(rays), 1)))
        number = np.arange(len(rays)) + len(self.rays)
        self.rays = np.vstack([self.rays, rays[:, 3:] / REACH])
        return np.asarray(number >= self.free, bool)


def out(scene: Rays, normal: Floats = UP, floor: Floor | None = None, few: bool = False) -> bool:
    outside = lets_out(np.ones((1, 3)), normal, REACH, cast(Scene, scene), floor or Floor.none(), few)
    return bool(outside[0])


def test_directions_are_spread_over_the_whole_sphere() -> None:
    above, below = Rays(), Rays()
    assert not out(above) and not out(below, DOWN)
    rays = np.vstack([above.rays, below.rays])
    assert np.linalg.norm(rays, axis=1) == pytest.approx(np.ones(len(rays)))
    assert 54 <= len(rays) <= 62 and above.rays[:, 2].min() > 0.1 and below.rays[:, 2].max() < -0.1
    assert above.rays.mean(axis=0) == pytest.approx([0, 0, 0.55], abs=0.05)
    apart = np.degrees(np.arccos(np.clip(rays @ rays.T - 2 * np.eye(len(rays)), -1, 1))).min(axis=1)
    assert apart.min() > 15 and apart.max() < 32
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert (rays @ axis).max() > 0.9
    few = Rays()
    assert not out(few, few=True) and 6 <= len(few.rays) <= 9


def test_two_free_rays_of_the_first_settle_it() -> None:
    free = Rays(99)
    assert out(free) and len(free.rays) == 2
    assert free.rays[:, 2].min() > 0.85  # those along the normal come first
    one = Rays(1)
    assert not out(one)  # one of 29: less than six in a hundred
    alone = Rays(1)
    assert out(alone, few=True)  # one of eight


def test_a_floor_stops_what_goes_down_through_it() -> None:
    wide = Floor(0.0, np.array([-99.0, -99.0]), 1.0, np.ones((198, 198), bool))
    free = Rays(99)
    assert not out(free, DOWN, wide) and not len(free.rays)
    below = Rays(99)
    assert out(below, DOWN, replace(wide, z_m=2.0)) and len(below.rays) == 2
    assert out(Rays(99), UP, wide)


def crossed(floor: Floor, origins: Floats, directions: Floats) -> Bools:
    """Which rays (N,) from above go down through the lid."""
    down = (origins[:, 2] > floor.z_m) & (directions[:, 2] < 0)
    with np.errstate(divide="ignore"):
        along = (floor.z_m - origins[:, 2]) / directions[:, 2]
    return np.asarray(down & floor.covers(origins[:, :2] + along[:, None] * directions[:, :2]), bool)


@pytest.mark.parametrize("few", [False, True])
def test_as_many_rays_escape_as_when_all_are_cast(few: bool) -> None:
    """Between crates on a floor: sides that all, some and none of the rays leave."""
    rng = np.random.default_rng(5)
    corners, faces = [], []
    for low in rng.uniform(-4, 4, (60, 3)):
        high = low + rng.uniform(0.2, 3.0, 3)
        base = len(corners)
        corners += [[(low, high)[bit][axis] for axis, bit in enumerate(bits)] for bits in np.ndindex(2, 2, 2)]
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        faces += [[base + a, base + b, base + c] for q in sides for a, b, c in (q[:3], (q[0], q[2], q[3]))]
    scene = Scene(np.array(corners), np.array(faces), 1)
    enclosed = np.zeros((20, 20), bool)
    enclosed[4:15, 6:18] = True
    floor = Floor(-3.0, np.array([-10.0, -10.0]), 1.0, enclosed)
    origins, normals = rng.uniform(-5, 7, (400, 3)), rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    directions = sphere(64)[:: 4 if few else 1]
    free = np.zeros(400, bool)
    for side in range(400):
        rays = directions[directions @ normals[side] > 0.1]
        starts = np.tile(origins[side], (len(rays), 1))
        escaped = ~scene.occluded(starts, starts + REACH * rays, slack=0.0) & ~crossed(floor, starts, rays)
        free[side] = escaped.mean() >= 0.06
    assert 0.2 < free.mean() < 0.9
    assert lets_out(origins, normals, REACH, scene, floor, few).tolist() == free.tolist()
