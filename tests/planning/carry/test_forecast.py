"""The gate asks of the inspected region: who may pass, who may not; evidence only ever counts against."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remembered import study_pair

from upplied.config import Settings, settings_for
from upplied.planning.carry.forecast import (
    CAPS,
    WEIGHTS,
    Evidence,
    evidence_of,
)
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.plan import plan_transfer
from upplied.records import Plan, Structure
from upplied.samples.fleet import member, shape_of
from upplied.samples.parametric import ship
from upplied.samples.pilot import fly
from upplied.samples.surfaces import stamped

SETTINGS: Settings = settings_for("recommended", clouds={"surface_samples": 2000})
LEAST = SETTINGS.registration.least_probability or 0.0


def likely(source: Structure, target: Structure, inspection: str) -> float:
    pair = study_pair(source, target, SETTINGS)
    return evidence_of(takes_of(fly(source, inspection, seed=4), pair, SETTINGS)[0]).probability


def without(name: str, parts: tuple[str, ...]) -> Structure:
    """A sample structure that lacks some parts."""
    whole = member(name)
    gone = [number for number, part in enumerate(whole.part_names) if part.startswith(parts)]
    rest = ~np.isin(whole.part_of_triangle, gone)
    return stamped(replace(whole.structure, triangles=whole.structure.triangles[rest]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "target", "inspection"),
    [
        ("a320-v1", "b777-v1", "engine_left"),
        pytest.param("a320-v1", "b747-v1", "wings", marks=pytest.mark.slow),
        ("turbine-1-v1", "turbine-3-v1", "tower"),
        ("cube-v1", "cuboid-v1", "sides"),
        pytest.param("bridge-1-v1", "bridge-2-v1", "piers", marks=pytest.mark.slow),
    ],
)
def test_structures_of_one_form_pass(source: str, target: str, inspection: str) -> None:
    assert likely(member(source).structure, member(target).structure, inspection) > 0.9


@pytest.mark.ci
@pytest.mark.parametrize(
    ("source", "target", "inspection", "most"),
    [
        ("cube-v1", "yacht-1-v1", "sides", 0.5),
        pytest.param("a320-v1", "cruise-v1", "engine_left", 0.5, marks=pytest.mark.slow),
        # Long things in a box of one form: near what is required. Their kinds are what refuses them.
        pytest.param("cruise-v1", "cuboid-v1", "hull", LEAST, marks=pytest.mark.slow),
        pytest.param("turbine-1-v1", "b777-v1", "tower", LEAST, marks=pytest.mark.slow),
        ("bridge-1-v1", "a320-v1", "piers", LEAST),
    ],
)
def test_strangers_do_not(source: str, target: str, inspection: str, most: float) -> None:
    assert likely(member(source).structure, member(target).structure, inspection) < most


@pytest.mark.ci
def test_another_superstructure_does_not_refuse_a_hull() -> None:
    bare = without("cruise-v1", ("funnel", "mast", "deck_4", "lifeboat"))
    assert likely(ship(shape_of("cruise-v1"), "liner").structure, bare, "hull") > 0.9


@pytest.mark.ci
def test_an_engine_that_is_not_there_is_refused_in_words() -> None:
    source, target = member("a320-v1").structure, without("b777-v1", ("engine", "pylon"))
    plan = plan_transfer(fly(source, "engine_left", seed=4), source, target, SETTINGS)
    assert plan.status == "refused" and "what was inspected cannot be shown" in plan.reason
    assert plan.measures.acceptance_probability < 0.5 and plan.acceptance_evidence in plan.reason
    assert plan.inspected is not None  # the report still shows what it was about


@pytest.mark.ci
def test_every_preset_says_how_likely_it_is() -> None:
    source, target = member("cube-v1").structure, member("cuboid-v1").structure
    flight = fly(source, "sides", seed=4)
    plans: list[Plan] = [
        plan_transfer(flight, source, target, settings_for(preset)) for preset in ("paper", "baseline")
    ]
    known = [plan.measures.acceptance_probability for plan in plans]
    assert known[0] == known[1] > 0.9


def test_evidence_only_counts_against() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        values = rng.random(len(CAPS)) * CAPS
        worse = values.copy()
        worse[rng.integers(len(CAPS))] += 0.1
        assert Evidence(*worse).probability <= Evidence(*values).probability + 1e-12
    assert min(WEIGHTS) >= 0
    perfect = Evidence(*np.zeros(len(CAPS)))
    assert perfect.probability > 0.95 and "matched surface 100 %" in perfect.in_words
