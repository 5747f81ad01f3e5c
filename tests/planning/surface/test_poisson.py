"""Thinning to even spacing, and the area that each sample stands for."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.surface.lattice import shares, thin
from upplied.records import Floats


def square(number: int, seed: int = 0) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(0, 10, (number, 2)), np.zeros(number)])
    return points, np.tile([0.0, 0, 1], (number, 1))


@pytest.mark.parametrize("number", [40, 150])
def test_what_is_kept_keeps_apart_and_leaves_no_gap(number: int) -> None:
    points, normals = square(1500)
    index = thin(points, normals, number, 100.0)
    assert (np.diff(index) > 0).all() and number * 0.93 <= len(index) <= number
    apart = np.linalg.norm(points[index][:, None] - points[index], axis=2) + 99 * np.eye(len(index))
    least = apart.min()
    assert least > 0.6 * np.sqrt(100 / number)
    gap = np.linalg.norm(points[:, None] - points[index], axis=2).min(axis=1)
    assert gap.max() <= least * (1 + 1e-3)  # else one more would have been kept


def test_the_first_of_those_that_crowd_stays() -> None:
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5.1, 0, 0], [0, 5, 0]])
    index = thin(points, np.tile([0.0, 0, 1], (5, 1)), 3, 27.0)
    assert index.tolist() == [0, 2, 4]


def test_two_sides_of_a_sheet_do_not_crowd_each_other() -> None:
    points, normals = square(600)
    both, facing = np.vstack([points, points]), np.vstack([normals, -normals])
    index = thin(both, facing, 100, 200.0)
    assert np.array_equal(index[index < 600], index[index >= 600] - 600)
    assert 92 <= len(index) <= 104


def test_few_candidates_are_all_kept() -> None:
    points, normals = square(30)
    assert thin(points, normals, 30, 100.0).tolist() == list(range(30))
    assert len(thin(points, normals, 29, 100.0)) <= 29


def test_each_area_goes_to_the_nearest_kept_samples_on_its_side() -> None:
    rng = np.random.default_rng(2)
    points, _ = square(80)
    facing = np.where(rng.random((80, 1)) < 0.5, [[0.0, 0, 1]], [[0.0, 0, -1]])
    area, index = rng.uniform(0.5, 2, 80), np.arange(0, 80, 5)
    known = np.zeros(len(index))
    for point, normal, size in zip(points, facing, area, strict=True):
        apart = np.maximum(np.linalg.norm(points[index] - point, axis=1), 1e-9)
        order = np.argsort(apart)[:8]
        mine = [at for at in order if facing[index[at]] @ normal > 0] or list(order)
        # Whole at the nearest, and less the farther others are, up to half as far again.
        part = np.array(
            [
                max(0.0, 1 - (apart[at] / apart[mine[0]] - 1) / 0.5) ** 2 if at != mine[0] else 1.0
                for at in mine
            ]
        )
        known[mine] += size * part / part.sum()
    assert shares(points, facing, area, index) == pytest.approx(known)
    assert shares(points, facing, area, index).sum() == pytest.approx(area.sum())
    alone = shares(points[:3], facing[:3], area[:3], np.array([1]))
    assert alone == pytest.approx([area[:3].sum()])


@pytest.mark.parametrize("seed", range(3))
def test_thinning_keeps_what_asking_every_candidate_in_turn_keeps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = rng.uniform(0, 4, (300, 3)) * [1, 1, 0.05], np.zeros((300, 3))
    normals[np.arange(300), 2] = rng.choice([-1.0, 1.0], 300)
    area = 32.0
    index = thin(points, normals, 60, area)

    def greedy(radius: float) -> list[int]:
        left: list[int] = []
        for one in range(300):
            if all(
                np.linalg.norm(points[one] - points[other]) >= radius or normals[one] @ normals[other] <= 0
                for other in left
            ):
                left.append(one)
        return left

    low, high = 0.0, float(np.sqrt(area / 60))
    for _ in range(12):
        radius = (low + high) / 2
        low, high = (radius, high) if len(greedy(radius)) > 60 else (low, radius)
    assert index.tolist() == greedy(radius)
