"""Law: no accepted plan breaks a limit of its own, by a ruler that shares no code with the planner."""

from __future__ import annotations

import numpy as np
import pytest
from made_structures import FAMILIES, flight, structure
from planning_ruler import broken_rules, clearance, distance_to_triangles, inside_polygon

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.records import Plan, Structure

SMALL = {"clouds": {"surface_samples": 1000}}


def planned(number: int, preset: str = "recommended") -> tuple[Structure, Plan]:
    """The plan of one made flight on another structure of its form."""
    family, seed = FAMILIES[number % len(FAMILIES)], number // len(FAMILIES)
    source, target = structure(family, seed), structure(family, seed, variant=1 + seed % 3)
    settings = settings_for(preset, **SMALL)
    return target, plan_transfer(flight(source, number), source, target, settings)


def assert_keeps_its_limits(number: int) -> bool:
    target, plan = planned(number)
    if plan.status != "ok":
        assert plan.reason
        return False
    assert broken_rules(target, plan.trajectory, settings_for("recommended", **SMALL)) == {}, number
    assert plan.measures.min_clearance_m == pytest.approx(clearance(target, plan.trajectory), abs=0.01)
    return True


@pytest.mark.ci
@pytest.mark.parametrize("first", [0, pytest.param(6, marks=pytest.mark.slow)])
def test_no_plan_breaks_its_own_limits(first: int) -> None:
    accepted = sum(assert_keeps_its_limits(number) for number in range(first, first + 6))
    assert accepted >= 3  # a planner that refuses everything breaks nothing either


@pytest.mark.slow
@pytest.mark.parametrize("first", range(12, 200, 12))
def test_no_plan_breaks_its_own_limits_on_200_structures(first: int) -> None:
    accepted = sum(assert_keeps_its_limits(number) for number in range(first, min(first + 12, 200)))
    assert accepted >= 4


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["paper", "baseline"])
@pytest.mark.parametrize("number", [0, 3, 5])
def test_presets_that_enforce_nothing_tell_how_near_they_come(preset: str, number: int) -> None:
    target, plan = planned(number, preset)
    if plan.status != "ok":
        pytest.skip(f"refused: {plan.reason}")
    clearance_m = clearance(target, plan.trajectory)
    assert plan.measures.min_clearance_m == pytest.approx(clearance_m, abs=0.01)
    has_warning = any("m are required" in warning for warning in plan.warnings)
    assert has_warning == (clearance_m < 2.0) or abs(clearance_m - 2) < 0.01


def test_the_ruler_tells_what_is_known_in_closed_form() -> None:
    corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    points = np.array([[1.0, 1, 3], [-3, -4, 0], [4, 4, 0], [2, -1, 0], [1, 1, 0]])
    actual = distance_to_triangles(points, corners, np.array([[0, 1, 2]]))
    assert actual == pytest.approx([3, 5, 2 * np.sqrt(2), 1, 0])
    notched = np.array([(0, 0), (10, 0), (10, 10), (7, 10), (7, 2), (3, 2), (3, 10), (0, 10)], float)
    places = np.array([(1, 5), (5, 5), (9, 5), (5, 1), (11, 5)], float)
    assert inside_polygon(notched, places).tolist() == [True, False, True, True, False]
