"""Whole paths: bounded in shape, whatever they show; refused where there is nothing to be about."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import FIDELITIES, settings_for
from upplied.errors import RefusedError
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.plan import plan_transfer
from upplied.planning.trajectory.complete import _changed_safely, _within_bound
from upplied.planning.trajectory.state import Flown, State
from upplied.records import Plan
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@cache
def planned(inspection: str, target: str, fidelity: str) -> Plan:
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    source = fleet["a320-v1"]
    settings = settings_for("recommended", refine={"fidelity": fidelity}, verdict={"enforce": False})
    return plan_transfer(fly(source, inspection), source, fleet[target], settings)


@pytest.mark.parametrize("fidelity", list(FIDELITIES))
def test_no_path_departs_further_from_the_demonstrated_shape_than_its_fidelity_allows(fidelity: str):
    plan = planned("engine_left", "b747-v1", fidelity)
    assert plan.status == "ok", plan.reason
    assert plan.measures.frechet_floored <= FIDELITIES[fidelity].deviation * (1 + 1e-3)
    assert plan.measures.min_clearance_m >= 2.0


def test_a_bound_of_ones_own_is_kept_too():
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    source = fleet["a320-v1"]
    settings = settings_for("recommended", refine={"deviation": 0.12})
    plan = plan_transfer(fly(source, "engine_left"), source, fleet["b747-v1"], settings)
    assert plan.status != "ok" or plan.measures.frechet_floored <= 0.12 * (1 + 1e-3)


def test_what_has_no_counterpart_is_not_planned_for():
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    source = fleet["a320-v1"]
    settings = settings_for("recommended", refine={"least_counterpart": 1.0}, route={"clearance_m": 2.0})
    demonstration = fly(source, "wings")
    plan = plan_transfer(demonstration, source, fleet["b777-v1"], settings)
    assert plan.status == "refused" and "counterpart" in plan.reason
    loose = replace(settings, refine=replace(settings.refine, least_counterpart=0.5))
    assert plan_transfer(demonstration, source, fleet["b777-v1"], loose).status == "ok"


def test_the_camera_turns_little_more_than_the_experts():
    plan = planned("engine_left", "b747-v1", "balanced")
    assert plan.measures.camera_turn_ratio < 2.5
    assert np.isfinite(plan.measures.coverage_inspected_pct)


def test_a_path_beyond_the_bound_is_drawn_to_the_demonstrated_shape_just_as_far_as_needed():
    turn = np.linspace(0, 1.5 * np.pi, 120)
    reference = 10 * np.column_stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(3 * turn)])
    strayed = reference + np.outer(np.sin(turn) ** 2, [0.0, 0.0, 6.0])
    nowhere = np.eye(3)
    whole = frechet_floored(reference, strayed)
    drawn = _within_bound(strayed, reference, nowhere, reference, whole / 2)
    assert frechet_floored(reference, drawn) == pytest.approx(whole / 2, rel=1e-3)
    assert frechet_floored(reference, drawn) <= whole / 2
    np.testing.assert_array_equal(_within_bound(strayed, reference, nowhere, reference, whole), strayed)
    np.testing.assert_allclose(
        _within_bound(strayed, reference, nowhere, reference, 0.0), reference, atol=1e-4
    )


@pytest.mark.parametrize(("bound", "share"), [(4.0, 1.0), (3.99, 0.5), (2.0, 0.5), (1.99, 0.0), (0.0, 0.0)])
def test_as_much_of_the_change_is_made_as_is_safe_within_the_bound(bound: float, share: float):
    """A straight path that the optimisation lifts by 4 m everywhere; its height is how far it departs."""
    base = Flown(np.column_stack([np.arange(20.0), np.zeros((20, 2))]), np.zeros(20), np.zeros(20))
    state = State.of(base, np.ones(3), 6, 5)
    lifted = state.nearest(Flown(base.positions + np.array([0.0, 0, 4]), base.yaw + 1, base.pitch))
    asked: list[np.ndarray] = []

    def bounded(positions: np.ndarray) -> np.ndarray:
        asked.append(positions)
        return positions + np.array([0.0, 7, 0])

    def departs(positions: np.ndarray) -> float:
        assert positions[0, 1] == 7  # what is judged is the path as it is safe
        return float(np.round(positions[:, 2].max(), 2))

    at, curve, positions = _changed_safely(state, state.nearest(base), lifted, bounded, departs, bound)
    assert at[0] == 0 and at[-1] == 19 and len(at) == 39  # legs of half a metre
    np.testing.assert_allclose(curve.positions[:, 2], 4 * share, atol=0.01)
    np.testing.assert_allclose(curve.yaw, share, atol=0.01)
    np.testing.assert_allclose(positions, curve.positions + np.array([0.0, 7, 0]))
    assert len(asked) == {1.0: 1, 0.5: 2, 0.0: 3}[share]


def test_a_path_that_no_change_leaves_safe_within_the_bound_is_refused():
    base = Flown(np.column_stack([np.arange(20.0), np.zeros((20, 2))]), np.zeros(20), np.zeros(20))
    state = State.of(base, np.ones(3), 6, 5)
    still = state.nearest(base)
    with pytest.raises(
        RefusedError, match=r"departs .* by 0.75 of its spread where it is safe.*at most 0.7 "
    ):
        _changed_safely(state, still, still + 1, lambda positions: positions, lambda _: 0.75, 0.7)
