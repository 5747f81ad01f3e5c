"""Surface that is supposed counts as near as it may be, wherever it is asked."""

from __future__ import annotations

import numpy as np

from upplied.geometry.discs import Discs
from upplied.geometry.scene import Scene
from upplied.geometry.supposed_scene import SupposedScene

ERROR_M = 0.4


def ball(middle: list[float], number: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    normals = np.random.default_rng(seed).normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Discs.of(middle + 2 * normals, normals).mesh()


def test_the_nearer_surface_is_that_of_asking_both() -> None:
    known, more = Scene(*ball([0, 0, 0], 800, 0)), ball([3.0, 1.0, 0.0], 300, 1)
    supposed = Scene(*more, error_m=ERROR_M)
    both = SupposedScene(known, supposed)
    places = np.random.default_rng(2).uniform(-9, 9, (4000, 3))
    nearest = np.minimum(known.distance(places), supposed.distance(places))
    np.testing.assert_array_equal(both.distance(places), nearest)
    exact = np.minimum(known.apart(places), supposed.apart(places))
    np.testing.assert_array_equal(both.apart(places), exact)
    assert (exact > nearest + ERROR_M / 2).any()
    foot, triangle = both.closest(places)
    one, other = (scene.closest(places)[0] for scene in (known, supposed))
    nearer = np.linalg.norm(other - places, axis=1) < np.linalg.norm(one - places, axis=1)
    np.testing.assert_array_equal(foot, np.where(nearer[:, None], other, one))
    np.testing.assert_array_equal(triangle < 0, nearer)
    assert 0.2 < nearer.mean() < 0.8


def test_surface_that_may_be_there_is_kept_clear_of_and_blocks_no_ray() -> None:
    known = Scene(*ball([0, 0, 0], 800, 0))
    likely, doubtful = Scene(*ball([6.0, 0, 0], 800, 1)), Scene(*ball([0, 6.0, 0], 800, 2), error_m=ERROR_M)
    places = np.random.default_rng(3).uniform(-9, 9, (2000, 3))
    every = SupposedScene(known, likely, doubtful)
    apart = np.min([scene.distance(places) for scene in (known, likely, doubtful)], axis=0)
    np.testing.assert_array_equal(every.distance(places), apart)
    triangle = every.closest(places)[1]
    nearest = np.argmin([np.linalg.norm(scene.closest(places)[0] - places, axis=1) for scene in
                         (known, likely, doubtful)], axis=0)  # fmt: skip
    np.testing.assert_array_equal(triangle < 0, nearest > 0)
    for axis, blocked in ((0, True), (1, False)):
        across = np.zeros((2, 3))
        across[:, axis], across[:, 2] = 6.0, (-5.0, 5.0)
        assert every.occluded(across[:1], across[1:])[0] == blocked
    alone = SupposedScene(known, None, doubtful)
    ends = np.array([[6.0, 0, -5]]), np.array([[6.0, 0, 5]])
    assert not alone.occluded(*ends)[0] and alone.distance(np.array([[0, 9.0, 0]]))[0] < 1 + 0.1
