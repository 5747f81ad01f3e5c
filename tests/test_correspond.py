"""Laws of the correspondences."""

from __future__ import annotations

import numpy as np

from upplied.config import settings_for
from upplied.planning.correspond import correspond
from upplied.planning.register import register
from upplied.records import Cloud

PAPER = settings_for("paper")


def cloud(seed: int) -> Cloud:
    points = np.random.default_rng(seed).normal(size=(300, 3)) * [9.0, 4.0, 2.0]
    return Cloud(points=points, leaf_m=1.0)


def test_nearest_of_itself_is_itself() -> None:
    one = cloud(0)
    found = correspond(one, one, register(one, one, PAPER.registration), PAPER.correspondence)
    np.testing.assert_array_equal(found.target_index, np.arange(len(one)))
    np.testing.assert_allclose(found.distance_m, 0, atol=1e-9)


def test_nearest_is_the_one_of_brute_force() -> None:
    source, target = cloud(0), cloud(1)
    registration = register(source, target, PAPER.registration)
    found = correspond(source, target, registration, PAPER.correspondence)
    aligned = registration.to_demo(target.points)
    distances = np.linalg.norm(source.points[:, None] - aligned[None], axis=2)
    np.testing.assert_array_equal(found.target_index, distances.argmin(axis=1))
    np.testing.assert_allclose(found.distance_m, distances.min(axis=1))
    np.testing.assert_array_equal(found.target_points, target.points[found.target_index])
