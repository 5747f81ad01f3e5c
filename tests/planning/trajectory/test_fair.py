"""Fairing: smoother, near, and no rule broken that was kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.planning.airspace.rules import Airspace
from upplied.planning.demonstration.stations import turning_deg_per_m
from upplied.planning.trajectory.fair import faired
from upplied.records import Floats, Surroundings
from upplied.scene import Scene

SHEET = Scene(np.array([[-100.0, 0, -50], [100, 0, -50], [0, 0, 90]]), np.array([[0, 1, 2]]), 1)


def airspace(clearance_m: float = 2.0) -> Airspace:
    return Airspace(SHEET, clearance_m, Surroundings())


def rippled(seed: int = 0) -> Floats:
    """Along the sheet at 4 m, with ripples of half a metre."""
    x = np.linspace(-20, 20, 121)
    ripple = 0.4 * np.sin(2.5 * x) + np.random.default_rng(seed).normal(0, 0.05, 121)
    return np.column_stack([x, np.full(121, 4.0) + ripple, np.zeros(121)])


def sharpest_deg(path: Floats) -> float:
    leg = np.diff(path, axis=0)
    leg /= np.linalg.norm(leg, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((leg[1:] * leg[:-1]).sum(axis=1), -1, 1))).max())


def test_ripples_go_and_long_curves_stay() -> None:
    fair = faired(rippled(), airspace(), 1.0)
    assert turning_deg_per_m(fair, 0.5) < 0.15 * turning_deg_per_m(rippled(), 0.5)
    assert fair[[0, -1]] == pytest.approx(rippled()[[0, -1]], abs=1e-5)
    angle = np.linspace(0, np.pi, 200)
    arc = np.column_stack([15 * np.cos(angle), 5 + 15 * np.sin(angle), np.zeros(200)])
    assert np.linalg.norm(faired(arc, airspace(), 1.0) - arc, axis=1).max() < 0.05
    line = np.column_stack([np.linspace(0, 9, 30), np.full(30, 5.0), np.zeros(30)])
    assert faired(line, airspace(), 1.0) == pytest.approx(line, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_no_rule_is_broken_that_was_kept_and_nothing_moves_far(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = rippled(seed)
    path[:, 1] += rng.uniform(-1.4, 0.0)
    space = airspace()
    before, fair = space.broken(path), faired(path, space, float(rng.uniform(0.1, 2.0)))
    assert not (space.broken(fair) & ~before).any()
    assert np.linalg.norm(fair - path, axis=1).max() <= 2.0 + 1e-9


def test_a_corner_round_an_edge_is_cut_only_as_far_as_allowed() -> None:
    rise = np.column_stack([np.zeros(40), np.full(40, 2.2), np.linspace(80, 92.5, 40)])
    over = np.column_stack([np.zeros(20), np.linspace(2.2, -6, 20), np.full(20, 92.5)])
    path = np.vstack([rise, over[1:]])
    assert not airspace().broken(path).any()
    fair = faired(path, airspace(), 3.0)
    assert not airspace().broken(fair).any()
    assert sharpest_deg(fair) < 0.9 * sharpest_deg(path)


def test_turning_and_moving_the_path_turns_and_moves_the_result() -> None:
    free = Airspace(SHEET, 0.0, Surroundings())
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    path = np.add(rippled(), [0, 300, 0])
    moved = faired(path @ turn.T + 50, free, 1.0)
    assert moved == pytest.approx(faired(path, free, 1.0) @ turn.T + 50, abs=1e-6)


def test_short_paths_and_hovering_are_left_alone() -> None:
    few = rippled()[:4]
    assert faired(few, airspace(), 1.0) is few
    still = np.repeat([[0.0, 5, 0]], 20, axis=0)
    assert faired(still, airspace(), 1.0) == pytest.approx(still)
    with_stops = np.repeat(rippled(), 3, axis=0)
    assert np.isfinite(faired(with_stops, airspace(), 1.0)).all()
    assert faired(rippled(), airspace(), 0.0) == pytest.approx(rippled())
