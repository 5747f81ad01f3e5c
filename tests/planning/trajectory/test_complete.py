"""Whole paths: an odd shape is a warning unless a bound is set."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from cases import slow_after

from upplied.config import FIDELITIES, settings_for
from upplied.errors import RefusedError
from upplied.planning.geometry.frechet import frechet_floored
from upplied.planning.measures.verdict import odd_shape
from upplied.planning.plan import plan_transfer
from upplied.planning.trajectory import complete
from upplied.planning.trajectory.added_passes import Beside, Extended
from upplied.planning.trajectory.flyable import Result, _within
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import Sight
from upplied.records import Plan
from upplied.samples.fleet import member, sample_structures
from upplied.samples.pilot import fly

STRICT = {"refine": {"fidelity": "strict"}}


@cache
def planned(inspection: str, target: str, fidelity: str) -> Plan:
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    source = fleet["a320-v1"]
    settings = settings_for("recommended", refine={"fidelity": fidelity}, verdict={"enforce": False})
    return plan_transfer(fly(source, inspection), source, fleet[target], settings)


@pytest.mark.slow
def test_a_shape_that_departs_further_than_usual_is_a_warning_and_no_refusal():
    plans = {fidelity: planned("engine_left", "b747-v1", fidelity) for fidelity in FIDELITIES}
    for fidelity, plan in plans.items():
        assert plan.status == "ok", plan.reason
        assert plan.measures.min_clearance_m >= 2.0
        usual = FIDELITIES[fidelity].deviation
        said = [warning for warning in plan.warnings if "the shape of the path departs" in warning]
        assert bool(said) == (plan.measures.frechet_floored > usual)
        assert all(f"--fidelity {fidelity} {usual:g} is usual" in warning for warning in said)
    # Both are near the demonstrated shape here: within a fiftieth of its spread they are as like it.
    assert plans["strict"].measures.frechet_floored <= plans["coverage"].measures.frechet_floored + 0.02
    beyond = replace(plans["strict"].measures, frechet_floored=0.26)
    assert "by 0.26 of its spread" in odd_shape(beyond, settings_for("recommended", **STRICT))[0]
    assert odd_shape(replace(beyond, frechet_floored=0.25), settings_for("recommended", **STRICT)) == ()
    assert odd_shape(beyond, settings_for("baseline", **STRICT)) == ()


@pytest.mark.ci
@pytest.mark.parametrize("bound", slow_after(1, [0.05, 0.12]))
def test_a_bound_of_ones_own_is_kept_or_refused(bound: float):
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    source = fleet["a320-v1"]
    settings = settings_for("recommended", refine={"deviation": bound})
    plan = plan_transfer(fly(source, "engine_left"), source, fleet["b747-v1"], settings)
    if plan.status == "ok":
        assert plan.measures.frechet_floored <= bound * (1 + 1e-3)
    else:
        assert f"at most {bound:g} (refine.deviation)" in plan.reason


@pytest.mark.slow
def test_what_has_no_counterpart_is_not_planned_for():
    """A fuselage with its fin, on a structure without one."""
    source, other = member("a320-v1").structure, member("b777-v1")
    without = other.part_of_triangle != other.part_names.index("fin")
    target = replace(other.structure, triangles=other.structure.triangles[without], sha256="")
    settings = settings_for("recommended", refine={"least_counterpart": 1.0}, route={"clearance_m": 2.0})
    demonstration = fly(source, "fuselage")
    plan = plan_transfer(demonstration, source, target, settings)
    assert plan.status == "refused" and "least_counterpart" in plan.reason
    loose = replace(settings, refine=replace(settings.refine, least_counterpart=0.5))
    plan = plan_transfer(demonstration, source, target, loose)
    assert plan.status == "ok" and plan.measures.inspected_without_counterpart_pct > 5


@pytest.mark.ci
def test_on_the_demonstrated_structure_the_camera_looks_aside_as_far_as_the_experts(monkeypatch):
    """Else a path would be worth more for looking where the expert did not, by a hair, on some processors."""
    problems = []

    def stopped(problem, *_):
        problems.append(problem)
        raise RefusedError("the search", "is not begun", "this test reads its problem", "none")

    monkeypatch.setattr("upplied.planning.trajectory.complete.optimise", stopped)
    source = {structure.structure_id: structure for structure in sample_structures()}["cruise-v1"]
    settings = settings_for("recommended")
    assert plan_transfer(fly(source, "hull"), source, source, settings).status == "refused"
    (problem,) = problems
    path, stations = problem.starts[0], len(problem.starts[0])
    sampled = problem.view.sampled(settings.optimise.samples)
    sight = Sight.of(path, problem.view, *sampled, problem.aside_rad)
    assert sight.axis.value(path)[0] == pytest.approx(0, abs=1e-5)
    straight = replace(sight.axis, demonstrated=np.zeros(stations))  # round bow and stern the expert did
    assert straight.value(path)[0] > 0.01


def test_the_camera_turns_little_more_than_the_experts():
    plan = planned("engine_left", "b747-v1", "balanced")
    assert plan.measures.camera_turn_ratio < 2.5
    assert np.isfinite(plan.measures.coverage_inspected_pct)


def bounded(path, shape, bound: float, safe=lambda positions: positions):
    goal = SimpleNamespace(flown=shape, standing=np.eye(3), reference=shape)
    return _within(bound, path, np.arange(float(len(shape))), goal, safe)


def test_a_path_beyond_a_bound_is_drawn_to_the_demonstrated_shape_just_as_far_as_needed():
    turn = np.linspace(0, 1.5 * np.pi, 120)
    shape = 10 * np.column_stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(3 * turn)])
    strayed = shape + np.outer(np.sin(turn) ** 2, [0.0, 0.0, 6.0])
    whole = frechet_floored(shape, strayed)
    drawn = bounded(strayed, shape, whole / 2)
    assert frechet_floored(shape, drawn) == pytest.approx(whole / 2, rel=1e-3)
    assert frechet_floored(shape, drawn) <= whole / 2
    np.testing.assert_array_equal(bounded(strayed, shape, whole), strayed)


def test_a_path_that_is_not_safe_within_a_bound_is_refused():
    turn = np.linspace(0, 1.5 * np.pi, 120)
    shape = 10 * np.column_stack([np.cos(turn), np.sin(turn), 0.3 * np.sin(3 * turn)])
    aside = np.outer(np.sin(turn) ** 2, [0.0, 0.0, 6.0])
    with pytest.raises(RefusedError, match=r"departs .* where it is safe.*at most 0.1 \(refine.deviation"):
        bounded(shape, shape, 0.1, safe=lambda positions: positions + aside)


@pytest.mark.parametrize(
    ("more", "taken_s", "flown"),
    [(-0.005, 110, False), (0.005, 110, False), (0.015, 110, True), (0.015, 150, False), (0.03, 150, True)],
)
def test_passes_are_flown_where_they_show_a_percent_more_and_pay_for_their_time(
    monkeypatch, more: float, taken_s: float, flown: bool
):
    """Half as long again has to show a twentieth of that, 2.5 points more."""
    alone, longer = (SimpleNamespace(positions=0, quat_xyzw=0) for _ in range(2))
    result, nothing = (
        Result(longer, taken_s, 0.95 + more),
        SimpleNamespace(path=None, origin=None, added=None),
    )
    monkeypatch.setattr(Beside, "of", lambda *_: SimpleNamespace())
    monkeypatch.setattr(Extended, "alone", lambda _: nothing)
    for name, value in (("_longer", nothing), ("_pace", None), ("_half_rad", 0.3), ("optimise", None)):
        monkeypatch.setattr(complete, name, lambda *_, value=value: value)
    flyable = SimpleNamespace(
        settings=settings_for("recommended"),
        carried=SimpleNamespace(take=None),
        ways=None,
        seconds_of=lambda _: 100.0,
        in_time=lambda *_: result,
        safe=lambda positions: positions,
    )
    problem = SimpleNamespace(
        starts=[None],
        view=SimpleNamespace(missed=lambda *_: []),
        along=lambda *_: None,
    )
    best = SimpleNamespace(path=Flown(np.zeros((2, 3)), np.zeros(2), np.zeros(2)))
    waypoints = complete._with_passes(problem, best, Result(alone, 100.0, 0.95), flyable, 200.0)
    assert waypoints is (longer if flown else alone)
