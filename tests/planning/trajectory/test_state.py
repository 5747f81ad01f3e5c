"""The state: slopes go back as the path comes forth, curves turn steadily."""

import numpy as np
import pytest

from upplied.planning.trajectory.state import Flown, State


def base(count: int = 60) -> Flown:
    angle = np.linspace(0, 1.5 * np.pi, count)
    positions = np.column_stack([20 * np.cos(angle), 20 * np.sin(angle), 5 + angle])
    return Flown(positions, angle + np.pi, 0.2 * np.sin(angle))


def state(count: int = 60, unit=(20.0, 20.0, 20.0)) -> State:
    return state_of(base(count), np.array(unit), 9)


def state_of(path: Flown, unit_m: np.ndarray, pieces: int) -> State:
    """The state of a path whose stations lie evenly along it."""
    return State.of(path, np.linspace(0, 1, len(path)), unit_m, pieces)


def sharpest(positions: np.ndarray) -> float:
    """Largest turn at a vertex, rad."""
    leg = np.diff(positions, axis=0)
    leg /= np.linalg.norm(leg, axis=1, keepdims=True)
    return float(np.arccos(np.clip((leg[1:] * leg[:-1]).sum(axis=1), -1, 1)).max())


def random_slope(rng: np.random.Generator, count: int) -> Flown:
    return Flown(rng.normal(size=(count, 3)), rng.normal(size=count), rng.normal(size=count))


@pytest.mark.parametrize("seed", range(3))
def test_the_slope_goes_back_as_the_path_comes_forth(seed: int):
    rng, one = np.random.default_rng(seed), state()
    slope = random_slope(rng, 60)
    variables, change = rng.normal(size=60) * 0.1, rng.normal(size=60)
    before, after = one.flown(variables), one.flown(variables + change)
    directional = sum(
        float((getattr(slope, name) * (getattr(after, name) - getattr(before, name))).sum())
        for name in ("positions", "yaw", "pitch")
    )
    assert one.pulled_back(slope) @ change == pytest.approx(directional)


def test_no_change_is_the_base_path():
    np.testing.assert_allclose(state().flown(np.zeros(60)).positions, base().positions)


def test_a_level_path_stays_level():
    one = state(unit=(20.0, 20.0, 0.0))
    variables = np.random.default_rng(5).normal(size=60)
    np.testing.assert_array_equal(one.flown(variables).positions[:, 2], base().positions[:, 2])


def test_the_curve_passes_through_the_stations_and_turns_no_more():
    one, variables = state(20), np.random.default_rng(6).normal(size=60) * 0.05
    at, curve = one.curve(variables, 0.5)
    own = at == np.round(at)
    path = one.flown(variables)
    assert own.sum() == 20
    np.testing.assert_allclose(curve.positions[own], path.positions, atol=1e-9)
    np.testing.assert_allclose(curve.yaw[own], path.yaw, atol=1e-9)
    assert np.linalg.norm(np.diff(curve.positions, axis=0), axis=1).max() < 0.75
    assert sharpest(curve.positions) < 0.5 * sharpest(path.positions)


def test_what_displaces_a_path_does_not_depend_on_where_its_stations_lie():
    """Dense ones on the first half are displaced as even ones there, and the curve as either."""
    even, variables = base(61), np.random.default_rng(7).normal(size=60) * 0.05
    places = np.concatenate([np.linspace(0, 30, 91), np.arange(31.0, 61)])
    many, few = even.between(places), state_of(even, np.full(3, 20.0), 9)
    dense = State.of(many, places / 60, np.full(3, 20.0), 9)
    np.testing.assert_allclose(dense.flown(variables).columns[::3][:31], few.flown(variables).columns[:31])
    curves = [one.curve(variables, 0.5)[1].positions for one in (few, dense)]
    off = np.linalg.norm(curves[0][:, None] - curves[1], axis=2)
    assert max(off.min(axis=0).max(), off.min(axis=1).max()) < 0.3


def test_a_hover_stays_where_it_is_and_short_paths_are_straight():
    still = base(30)
    still.positions[10:14] = still.positions[10]
    at, curve = state_of(still, np.full(3, 20.0), 3).curve(np.zeros(30), 0.5)
    during = (at >= 10) & (at <= 13)
    np.testing.assert_allclose(curve.positions[during], np.tile(still.positions[10], (4, 1)), atol=1e-9)
    short = Flown(np.array([[0.0, 0, 0], [3, 0, 0], [3, 3, 0]]), np.zeros(3), np.zeros(3))
    _, curve = state_of(short, np.ones(3), 1).curve(np.zeros(20), 0.5)
    assert np.linalg.norm(np.diff(curve.positions, axis=0), axis=1).sum() == pytest.approx(6)


def test_between_two_stations_the_curve_is_straight_and_turns_evenly():
    two = Flown(np.array([[0.0, 0, 0], [4, 0, 3]]), np.array([0.0, 1.0]), np.array([0.2, -0.2]))
    at, curve = state_of(two, np.ones(3), 1).curve(np.zeros(20), 0.5)
    np.testing.assert_allclose(at, np.linspace(0, 1, 11))
    np.testing.assert_allclose(curve.positions, np.outer(np.linspace(0, 1, 11), [4.0, 0, 3]), atol=1e-9)
    np.testing.assert_allclose(curve.yaw, np.linspace(0, 1, 11), atol=1e-9)
    np.testing.assert_allclose(curve.pitch, np.linspace(0.2, -0.2, 11), atol=1e-9)
    one = Flown(np.array([[1.0, 2, 3]]), np.array([0.5]), np.array([0.1]))
    at, curve = state_of(one, np.ones(3), 1).curve(np.zeros(20), 0.5)
    assert at.tolist() == [0] and curve.positions.tolist() == [[1, 2, 3]] and curve.yaw.tolist() == [0.5]
