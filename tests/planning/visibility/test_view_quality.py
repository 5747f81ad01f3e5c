"""Nearest and most frontal views, and what is shown well, against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.poses import look_at
from upplied.planning.visibility.observations import Views, rates
from upplied.records import Bools, Cloud, Floats, Trajectory


def samples(seed: int) -> tuple[Floats, Floats, Floats, Bools]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(12, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.normal(0, 6, (9, 3)), rng.normal(0, 2, (12, 3)), normals, rng.random((9, 12)) < 0.4


def seen_from(at: Floats, seen: Bools, coarse: Floats | None = None) -> Views:
    """Views of poses a second apart that turn, (P, 3)."""
    quats = look_at(at, np.random.default_rng(5).normal(size=(len(at), 3)))
    return Views(Trajectory(np.arange(float(len(at))), at, quats), seen, coarse)


@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_and_the_most_frontal_view_of_each_point(seed: int) -> None:
    at, points, normals, seen = samples(seed)
    seen[:, 0] = False
    coarse = np.random.default_rng(seed + 20).uniform(1, 4, 9)
    ray = at[:, None] - points
    distance = np.linalg.norm(ray, axis=2)
    cosine = (ray * normals).sum(axis=2) / distance
    near, frontal = seen_from(at, seen, coarse).nearest(points, normals)
    assert near == pytest.approx(np.where(seen, distance * coarse[:, None], np.inf).min(axis=0))
    assert frontal == pytest.approx(np.where(seen, cosine, -1.0).max(axis=0))
    carry = np.diag([2.0, 1.0, 0.5])
    carried = np.linalg.norm(ray @ carry.T, axis=2) * coarse[:, None]
    near_there, without = seen_from(at, seen, coarse).nearest(points, carry=carry)
    assert near_there == pytest.approx(np.where(seen, carried, np.inf).min(axis=0))
    assert without.tolist() == np.where(seen.any(axis=0), 0.0, -1.0).tolist()
    assert near[0] == np.inf and frontal[0] == -1


@pytest.mark.parametrize("seed", range(3))
def test_shown_well_is_near_frontal_and_sharp_at_once(seed: int) -> None:
    at, points, normals, seen = samples(seed)
    rng = np.random.default_rng(seed + 10)
    views = seen_from(at, seen, rng.choice([1.0, 1.3], 9))
    (velocity, turn), coarse = rates(views.stations), views.coarseness
    farthest = rng.uniform(6, 14, 12)
    farthest[3] = np.nan
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
                and -way @ normals[index] >= 0.2
                and distance * coarse[pose] / (-way @ normals[index]) <= farthest[index]
                and motion <= 2.0
            )
    assert np.array_equal(views.shown_well(Cloud(points, normals), farthest, 2.0, 0.2), known)
    assert not known[3] and known.any() and not known.all()


def test_a_limit_that_is_just_kept_is_kept() -> None:
    views = seen_from(np.zeros((1, 3)), np.ones((1, 1), bool))
    ahead = Cloud(np.array([[4.0, 0, 0]]), np.array([[-1.0, 0, 0]]))
    assert views.shown_well(ahead, np.array([4.0]), 0.0, 1.0)[0]
    assert not views.shown_well(ahead, np.array([3.99]), 0.0, 1.0)[0]
