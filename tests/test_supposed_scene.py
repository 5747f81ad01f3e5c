"""Surface that is supposed counts as near as it may be, wherever it is asked."""

from __future__ import annotations

import numpy as np

from upplied.discs import surfels
from upplied.scene import Scene
from upplied.supposed_scene import SupposedScene

ERROR_M = 0.4


def ball(middle: list[float], number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    normals = np.random.default_rng(seed).normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return surfels(middle + 2 * normals, normals)


def test_the_nearer_surface_is_that_of_asking_both() -> None:
    known, more = Scene(*ball([0, 0, 0], 800, 0)), ball([3.0, 1.0, 0.0], 300, 1)
    both, supposed = SupposedScene(known, *more, ERROR_M), Scene(*more, error_m=ERROR_M)
    places = np.random.default_rng(2).uniform(-9, 9, (4000, 3))
    nearest = np.minimum(known.distance(places), supposed.distance(places))
    np.testing.assert_array_equal(both.distance(places), nearest)
    foot, triangle = both.closest(places)
    one, other = (scene.closest(places)[0] for scene in (known, supposed))
    nearer = np.linalg.norm(other - places, axis=1) < np.linalg.norm(one - places, axis=1)
    np.testing.assert_array_equal(foot, np.where(nearer[:, None], other, one))
    np.testing.assert_array_equal(triangle < 0, nearer)
    assert 0.2 < nearer.mean() < 0.8
