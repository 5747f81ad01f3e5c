"""The floor under a structure that is open below: where it lies, what is beneath it."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.surface.escape import Floor, floor_of
from upplied.records import Floats, Structure


def walls(outline: Floats, height: float, base: float = 0.0) -> Structure:
    """Upright walls on a closed outline (K, 2), without roof or floor."""
    count = len(outline)
    low, high = (np.column_stack([outline, np.full(count, z)]) for z in (base, base + height))
    here = np.arange(count)
    there = (here + 1) % count
    triangles = np.vstack(
        [np.column_stack([here, there, there + count]), np.column_stack([here, there + count, here + count])]
    )
    return Structure("walls", "box", np.vstack([low, high]), triangles)


L_SHAPE = np.array([(0, 0), (8, 0), (8, 4), (4, 4), (4, 6), (0, 6)], float)


def inside_l(xy: Floats) -> Floats:
    x, y = xy.T
    return ((x > 0) & (x < 8) & (y > 0) & (y < 4)) | ((x > 0) & (x < 4) & (y > 0) & (y < 6))


def test_the_floor_closes_what_the_walls_enclose() -> None:
    floor = floor_of(walls(L_SHAPE, 10.0, base=3.0))
    assert floor.z_m == pytest.approx(3.1)
    assert floor.cell_m == pytest.approx(8 / 256)
    grid = np.stack(np.meshgrid(np.linspace(-1, 9, 83), np.linspace(-1, 7, 71)), axis=-1).reshape(-1, 2)
    near_wall = np.zeros(len(grid), bool)
    for a, b in zip(L_SHAPE, np.roll(L_SHAPE, -1, axis=0), strict=True):
        share = np.clip((grid - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        near_wall |= np.linalg.norm(grid - a - share[:, None] * (b - a), axis=1) < 2 * floor.cell_m
    points = np.column_stack([grid, np.full(len(grid), 3.0)])
    assert np.array_equal(floor.beneath(points)[~near_wall], inside_l(grid)[~near_wall])
    assert not floor.beneath(points + np.array([0, 0, 0.2])).any()
    assert floor.beneath(np.array([[1.0, 1, floor.z_m]])).all()


def test_a_diagonal_wall_leaves_no_gap() -> None:
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    floor = floor_of(walls(L_SHAPE @ turn.T, 2.0))
    middle = np.array([[2.0, 2.0], [6, 2], [2, 5], [6, 5], [9, 2]]) @ turn.T
    assert floor.beneath(np.column_stack([middle, np.zeros(5)])).tolist() == [True, True, True, False, False]


def test_an_open_outline_encloses_nothing() -> None:
    outline = walls(L_SHAPE, 2.0)
    open_ = Structure("open", "box", outline.vertices, outline.triangles[[0, 1, 2, 3, 4, 6, 7, 8, 9, 10]])
    floor = floor_of(open_)
    assert not floor.beneath(np.array([[2.0, 2, 0], [6, 2, 0]])).any()


def test_what_the_plane_does_not_cut_has_no_floor() -> None:
    flat = Structure("flat", "box", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    for floor in (floor_of(flat), Floor.none()):
        assert not floor.beneath(np.array([[0.0, 0, -1], [0.2, 0.2, 0], [0.5, 0.5, 0]])).any()
        assert not floor.covers(np.array([[0.2, 0.2]])).any()


def test_the_cut_is_where_the_triangles_meet_the_plane() -> None:
    """A pyramid that stands on its tip widens with height: its floor is as wide as it is there."""
    square = np.array([[-5.0, -5, 10], [5, -5, 10], [5, 5, 10], [-5, 5, 10], [0, 0, 0]])
    tip = Structure("tip", "box", square, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))
    floor = floor_of(tip)
    assert floor.z_m == pytest.approx(0.1)
    cells = floor.enclosed.sum(axis=0)
    assert cells.max() * floor.cell_m == pytest.approx(0.1, abs=2 * floor.cell_m)
    where = np.argwhere(floor.enclosed).mean(axis=0) * floor.cell_m + floor.low + floor.cell_m / 2
    assert where == pytest.approx(np.zeros(2), abs=floor.cell_m)
