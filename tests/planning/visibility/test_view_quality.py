"""Nearest and most frontal views, and what is shown well, against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.visibility.view_quality import nearest, nearest_views, shown_well
from upplied.records import Bools, Floats


def made(seed: int) -> tuple[Floats, Floats, Floats, Bools]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(12, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.normal(0, 6, (9, 3)), rng.normal(0, 2, (12, 3)), normals, rng.random((9, 12)) < 0.4


@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_and_the_most_frontal_view_of_each_point(seed: int) -> None:
    at, points, normals, seen = made(seed)
    seen[:, 0] = False
    coarse = np.random.default_rng(seed + 20).uniform(1, 4, 9)
    ray = at[:, None] - points
    distance = np.linalg.norm(ray, axis=2)
    cosine = (ray * normals).sum(axis=2) / distance
    near, frontal = nearest_views(at, points, normals, seen, coarse)
    assert near == pytest.approx(np.where(seen, distance * coarse[:, None], np.inf).min(axis=0))
    assert frontal == pytest.approx(np.where(seen, cosine, -1.0).max(axis=0))
    assert nearest(at, np.ascontiguousarray(points.T), seen, coarse) == pytest.approx(near)
    assert near[0] == np.inf and frontal[0] == -1


@pytest.mark.parametrize("seed", range(3))
def test_shown_well_is_near_frontal_and_sharp_at_once(seed: int) -> None:
    at, points, normals, seen = made(seed)
    rng = np.random.default_rng(seed + 10)
    velocity, turn = rng.normal(0, 1, (9, 3)), rng.normal(0, 0.1, (9, 3))
    farthest = rng.uniform(6, 14, 12)
    farthest[3] = np.nan
    coarse = rng.choice([1.0, 1.3], 9)
    known = np.zeros(12, bool)
    for pose in range(9):
        for index in range(12):
            ray = points[index] - at[pose]
            distance = np.linalg.norm(ray)
            way = ray / distance
            motion = np.linalg.norm(
                np.cross(turn[pose], way) + (velocity[pose] - way * (way @ velocity[pose])) / distance
            )
            known[index] |= bool(
                seen[pose, index]
                and distance * coarse[pose] <= farthest[index]
                and -way @ normals[index] >= 0.2
                and motion <= 0.35
            )
    moving, facing = (at, velocity, turn), (points, normals, seen, coarse, farthest, 0.2, 0.35)
    assert np.array_equal(shown_well(*moving, *facing), known)
    assert not known[3] and known.any() and not known.all()


def test_a_limit_that_is_just_kept_is_kept() -> None:
    at, point, normal = np.zeros((1, 3)), np.array([[4.0, 0, 0]]), np.array([[-1.0, 0, 0]])
    still, seen, one = np.zeros((1, 3)), np.ones((1, 1), bool), np.ones(1)
    assert shown_well(at, still, still, point, normal, seen, one, np.array([4.0]), 1.0, 0.0)[0]
    assert not shown_well(at, still, still, point, normal, seen, one, np.array([3.99]), 1.0, 0.0)[0]
