"""Gauss-Newton of Eq. 3 against geometry whose answer is known, and scipy's solver."""

import numpy as np
from scipy.optimize import least_squares

from upplied.config import RefineSettings
from upplied.planning.carry.gauss_newton import gauss_newton
from upplied.records import Cloud, Correspondences, Viewpoints


def scene(seed, scale=(1.0, 1.0, 1.0), count=120):
    """A bumpy patch seen by one camera, and the same patch scaled."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * [5, 3, 2]
    camera = np.array([[12.0, 1.0, 3.0]])
    source, target = Cloud(points), Cloud(points * scale + [4.0, 5.0, 6.0])
    everything = Correspondences(np.arange(count), np.zeros(count), target.points)
    view = Viewpoints(
        camera,
        np.array([[0.0, 0, 1, 0]]),
        np.ones((1, count), bool),
        np.array([0]),
        np.array([1]),
        np.zeros(1),
    )
    return source, target, everything, view, camera * scale + [4.0, 5.0, 6.0]


def test_the_right_place_is_a_fixed_point():
    source, target, pairs, view, right = scene(0, (2.0, 0.7, 1.4))
    found = gauss_newton(right, view, source, target, pairs, RefineSettings())
    np.testing.assert_allclose(found, right, atol=1e-8)


def test_a_start_that_is_off_comes_back():
    for seed in range(5):
        source, target, pairs, view, right = scene(seed, (2.0, 0.7, 1.4))
        start = right + np.random.default_rng(seed).normal(size=(1, 3))
        found = gauss_newton(start, view, source, target, pairs, RefineSettings(iterations=50))
        np.testing.assert_allclose(found, right, atol=1e-6)


def test_with_wrong_counterparts_it_finds_the_least_squares_answer():
    source, target, pairs, view, right = scene(2)
    shuffled = Cloud(target.points + np.random.default_rng(9).normal(size=target.points.shape) * 0.3)
    found = gauss_newton(right, view, source, shuffled, pairs, RefineSettings(iterations=100))
    sigma_d = source.points.std(axis=0)
    mean_t, sigma_t = shuffled.points.mean(axis=0), shuffled.points.std(axis=0)
    wanted = np.linalg.norm((source.points - view.positions[0]) / sigma_d, axis=1)
    standard = (shuffled.points - mean_t) / sigma_t

    def residual(camera):
        return np.linalg.norm(standard - camera, axis=1) - wanted

    answer = least_squares(residual, (right[0] - mean_t) / sigma_t, xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose((found[0] - mean_t) / sigma_t, answer, atol=1e-5)


def test_a_viewpoint_that_sees_too_little_stays():
    source, target, pairs, view, right = scene(1)
    few = Viewpoints(
        view.positions, view.quat_xyzw, view.seen & (np.arange(120) < 2), *[view.start, view.stop, view.t_s]
    )
    start = right + 1.0
    np.testing.assert_array_equal(gauss_newton(start, few, source, target, pairs, RefineSettings()), start)
