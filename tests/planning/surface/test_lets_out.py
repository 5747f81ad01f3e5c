"""Rays that tell what is outside: their directions, how many are cast, and the floor that stops them."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from upplied.planning.surface.floor import Floor
from upplied.planning.surface.samples import lets_out
from upplied.records import Bools, Floats
from upplied.scene import Scene

REACH = 50.0
UP, DOWN = np.array([[0.0, 0, 1]]), np.array([[0.0, 0, -1]])


class Asked:
    """A scene that notes the rays, of which so many in a row are free."""

    def __init__(self, free: int = 0) -> None:
        self.free, self.rays = free, np.empty((0, 3))

    def occluded(self, starts: Floats, ends: Floats, slack: float) -> Bools:
        assert slack == 0.0
        number = np.arange(len(starts)) + len(self.rays)
        self.rays = np.vstack([self.rays, (ends - starts) / REACH])
        return np.asarray(number >= self.free, bool)


def out(scene: Asked, normal: Floats = UP, floor: Floor | None = None, few: bool = False) -> bool:
    found = lets_out(np.ones((1, 3)), normal, REACH, cast(Scene, scene), floor or Floor.none(), few)
    return bool(found[0])


def test_directions_are_spread_over_the_whole_sphere() -> None:
    above, below = Asked(), Asked()
    assert not out(above) and not out(below, DOWN)
    rays = np.vstack([above.rays, below.rays])
    assert np.linalg.norm(rays, axis=1) == pytest.approx(np.ones(len(rays)))
    assert 56 <= len(rays) <= 64 and above.rays[:, 2].min() > 0.1 and below.rays[:, 2].max() < -0.1
    assert above.rays.mean(axis=0) == pytest.approx([0, 0, 0.55], abs=0.05)
    apart = np.degrees(np.arccos(np.clip(rays @ rays.T - 2 * np.eye(len(rays)), -1, 1))).min(axis=1)
    assert apart.min() > 15 and apart.max() < 32
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert (rays @ axis).max() > 0.9
    few = Asked()
    assert not out(few, few=True) and 6 <= len(few.rays) <= 9


def test_two_free_rays_of_the_first_settle_it() -> None:
    free = Asked(99)
    assert out(free) and len(free.rays) <= 4
    two = Asked(2)
    assert out(two, few=True)
    one = Asked(1)
    assert not out(one)  # one of 29: less than six in a hundred
    alone = Asked(1)
    assert out(alone, few=True) and len(alone.rays) > 3  # one of eight


def test_a_floor_stops_what_goes_down_through_it() -> None:
    wide = Floor(0.0, np.array([-99.0, -99.0]), 1.0, np.ones((198, 198), bool))
    free = Asked(99)
    assert not out(free, DOWN, wide) and len(free.rays) > 25
    assert out(Asked(99), UP, wide)
