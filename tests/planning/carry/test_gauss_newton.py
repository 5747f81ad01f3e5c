"""Gauss-Newton of Eq. 3 against geometry whose answer is known, and scipy's solver."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from upplied.config import RefineSettings
from upplied.planning.carry.affine import _solve, gauss_newton
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
    actual = gauss_newton(right, view, source, target, pairs, RefineSettings())
    np.testing.assert_allclose(actual, right, atol=1e-8)


def test_a_start_that_is_off_comes_back():
    for seed in range(5):
        source, target, pairs, view, right = scene(seed, (2.0, 0.7, 1.4))
        start = right + np.random.default_rng(seed).normal(size=(1, 3))
        actual = gauss_newton(start, view, source, target, pairs, RefineSettings(iterations=50))
        np.testing.assert_allclose(actual, right, atol=1e-6)


def test_with_wrong_counterparts_it_finds_the_least_squares_answer():
    source, target, pairs, view, right = scene(2)
    shuffled = Cloud(target.points + np.random.default_rng(9).normal(size=target.points.shape) * 0.3)
    actual = gauss_newton(right, view, source, shuffled, pairs, RefineSettings(iterations=100))
    sigma_d = source.points.std(axis=0)
    mean_t, sigma_t = shuffled.points.mean(axis=0), shuffled.points.std(axis=0)
    distance = np.linalg.norm((source.points - view.positions[0]) / sigma_d, axis=1)
    standard = (shuffled.points - mean_t) / sigma_t

    def residual(camera):
        return np.linalg.norm(standard - camera, axis=1) - distance

    answer = least_squares(residual, (right[0] - mean_t) / sigma_t, xtol=1e-14, ftol=1e-14).x
    np.testing.assert_allclose((actual[0] - mean_t) / sigma_t, answer, atol=1e-5)


def test_a_viewpoint_that_sees_too_little_stays():
    source, target, pairs, view, right = scene(1)
    few = Viewpoints(
        view.positions, view.quat_xyzw, view.seen & (np.arange(120) < 2), *[view.start, view.stop, view.t_s]
    )
    start = right + 1.0
    np.testing.assert_array_equal(gauss_newton(start, few, source, target, pairs, RefineSettings()), start)


def by_hand(start, view, source, target, pairs, iterations):
    """Eq. 3 in numpy: standardised clouds, least-norm steps, the best of all iterates."""

    def scored(cloud):
        sigma = cloud.points.std(axis=0)
        return cloud.points.mean(axis=0), np.where(sigma > 1e-9 * sigma.max(), sigma, 1.0)

    (mean_d, sigma_d), (mean_t, sigma_t) = scored(source), scored(target)
    poses = start.copy()
    for row in range(len(start)):
        seen = view.seen[row] & (pairs.target_index >= 0)
        if seen.sum() < 3:
            continue
        there = (target.points[pairs.target_index[seen]] - mean_t) / sigma_t
        camera = (view.positions[row] - mean_d) / sigma_d
        goal = np.linalg.norm((source.points[seen] - mean_d) / sigma_d - camera, axis=1)
        here = (start[row] - mean_t) / sigma_t
        tried = []
        for _ in range(iterations + 1):
            ray = here - there
            distance = np.linalg.norm(ray, axis=1)
            residual = distance - goal
            tried.append((residual @ residual, here))
            here = here - np.linalg.lstsq(ray / distance[:, None], residual, rcond=1e-6)[0]
        best = min(tried, key=lambda each: each[0])[1]
        poses[row] = best * sigma_t + mean_t
    return poses


def views(seed, count=40, number=6):
    rng = np.random.default_rng(seed)
    source = Cloud(rng.normal(size=(count, 3)) * [5, 3, 2])
    target = Cloud(rng.normal(size=(count + 5, 3)) * [7, 2, 4] + [1, 2, 3])
    index = rng.integers(-1, count + 5, count)
    pairs = Correspondences(index, np.zeros(count), np.zeros((count, 3)))
    seen = rng.random((number, count)) < 0.5
    seen[0] = False
    seen[0, np.flatnonzero(index >= 0)[:2]] = True  # two distances place nothing
    seen[1] = False
    seen[1, np.flatnonzero(index >= 0)[:3]] = True
    at = np.arange(number)
    view = Viewpoints(
        rng.normal(0, 9, (number, 3)), np.tile([0.0, 0, 0, 1], (number, 1)), seen, at, at + 1, at * 1.0
    )
    return source, target, pairs, view, rng.normal(0, 9, (number, 3))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("iterations", [1, 3, 8])
def test_viewpoints_are_refined_as_the_equation_says(seed, iterations):
    source, target, pairs, view, start = views(seed)
    actual = gauss_newton(start, view, source, target, pairs, RefineSettings(iterations=iterations))
    np.testing.assert_allclose(
        actual, by_hand(start, view, source, target, pairs, iterations), rtol=1e-6, atol=1e-6
    )
    assert np.array_equal(actual[0], start[0])
    assert iterations < 3 or not np.array_equal(actual[1], start[1])


def test_points_in_a_plane_run_nobody_off():
    source, target, pairs, view, start = views(7)
    flat = Cloud(source.points * [1, 1, 0]), Cloud(target.points * [1, 1, 0])
    actual = gauss_newton(start, view, *flat, pairs, RefineSettings(iterations=8))
    np.testing.assert_allclose(actual, by_hand(start, view, *flat, pairs, 8), rtol=1e-5, atol=1e-5)
    assert np.abs(actual).max() < 100


@pytest.mark.parametrize(("ratio", "determined"), [(1.5e-6, True), (0.7e-6, False)])
def test_directions_that_the_points_hardly_determine_are_left_as_they_are(ratio, determined):
    """Eight points round a camera, a little above and below it in turn: its height changes little."""
    turn, off = np.arange(8) * np.pi / 4, ratio / np.sqrt(2)
    height = off * (-1.0) ** np.arange(8)
    points = np.column_stack([np.cos(turn), np.sin(turn), height])
    distance = np.linalg.norm(points, axis=1) + 1e-7 * height
    step = _solve(np.zeros(3), points, distance, 1)
    assert step[2] == pytest.approx(-1e-7 if determined else 0.0, rel=0.02, abs=1e-12)
    assert np.abs(step[:2]).max() < 1e-10
