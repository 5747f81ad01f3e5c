"""The floor under "ok": what falls short is refused by `recommended`, and said by plans for comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remembered import study_pair

from upplied.config import settings_for
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.measures.verdict import shortfalls
from upplied.planning.plan import plan_transfer
from upplied.records import Measures
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly

GOOD = Measures(
    coverage_inspected_pct=99.0, min_clearance_m=3.0, path_length_m=50.0, duration_s=60.0, peak_speed_mps=1.0,
    peak_acceleration_mps2=1.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def case():
    fleet = {each.structure_id: each for each in sample_structures()}
    settings = settings_for("recommended")
    flown = fly(fleet["cube-v1"], "sides")
    pair = study_pair(fleet["cube-v1"], fleet["cuboid-v1"], settings)
    takes = takes_of(flown, pair, settings)
    path = takes[0].inspection.flight
    return path, takes, settings, flown, fleet


def test_a_good_plan_falls_short_of_nothing(case):
    path, takes, settings, *_ = case
    assert shortfalls(path, GOOD, takes, settings) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coverage_inspected_pct": 59.0}, "shows 59.0 % of what was inspected"),
        ({"coverage_inspected_pct": float("nan")}, "was not measured"),
        ({"min_clearance_m": 1.9}, "comes within 1.90 m"),
        ({"path_length_m": 81_000.0}, "flies 81000 m"),
        ({"duration_s": 90_000.0}, "takes 90000 s"),
        ({"peak_speed_mps": 30.0}, "flies 30.0 m/s"),
        ({"peak_acceleration_mps2": 182.0}, "asks for 182.0 m/s2"),
        ({"duration_s": float("inf")}, "not finite"),
    ],
)
def test_each_floor_says_what_is_short_and_by_how_much(case, change, words):
    path, takes, settings, *_ = case
    (sentence,) = shortfalls(path, replace(GOOD, **change), takes, settings)
    assert words in sentence


def test_a_waypoint_that_is_no_place_is_never_flown(case):
    path, takes, settings, *_ = case
    positions = path.positions.copy()
    positions[3] = np.nan
    assert shortfalls(replace(path, positions=positions), GOOD, takes, settings) == (
        "a waypoint is not finite",
    )


def test_rules_of_the_airspace_hold_for_every_preset(case):
    path, takes, settings, *_ = case
    around = replace(takes[0].pair.target.surroundings, ceiling_z_m=float(path.positions[:, 2].min()) - 1)
    below = replace(takes[0].pair, target=replace(takes[0].pair.target, surroundings=around))
    (sentence,) = shortfalls(path, GOOD, [replace(takes[0], pair=below)], settings)
    assert "above the ceiling" in sentence


@pytest.mark.slow
def test_recommended_is_refused_and_comparisons_carry_the_verdict(case, monkeypatch):
    *_, flown, fleet = case
    target = fleet["cuboid-v1"]
    plan = plan_transfer(
        flown, fleet["cube-v1"], target, settings_for("baseline", route={"clearance_m": 30.0})
    )
    assert plan.status == "ok" and not plan.flyable and "30 m are required" in plan.not_flyable
    plan = plan_transfer(flown, fleet["cube-v1"], target, settings_for("recommended"))
    assert plan.status == "ok" and plan.flyable and plan.not_flyable == ""
    monkeypatch.setattr("upplied.planning.plan.shortfalls", lambda *_: ("too little", "too near"))
    plan = plan_transfer(flown, fleet["cube-v1"], target, settings_for("recommended"))
    assert plan.status == "refused" and plan.reason == "too little; too near" and plan.trajectory is None
    assert not plan.flyable and plan.measures.coverage_inspected_pct > 90


@pytest.mark.slow
def test_a_target_of_another_size_than_its_source_is_refused_or_warned_of(case):
    """A unit that was mistaken: millimetres, inches and feet as metres, or a model of 3 to 10."""
    *_, flown, fleet = case
    source, target, settings = fleet["cube-v1"], fleet["cuboid-v1"], settings_for("recommended")

    def scaled(factor):
        return replace(target, vertices=target.vertices * factor)

    for factor in (1000, 39.37, 0.001):
        plan = plan_transfer(flown, source, scaled(factor), settings)
        assert plan.status == "refused" and "verdict.most_size_ratio" in plan.reason
    tight = settings_for("recommended", verdict={"odd_size_ratio": 1.1})
    assert "verdict.odd_size_ratio" in plan_transfer(flown, source, target, tight).warnings[0]
    compared = settings_for("baseline", verdict={"most_size_ratio": 1.1})
    plan = plan_transfer(flown, source, target, compared)
    assert plan.status == "ok" and not plan.flyable and "verdict.most_size_ratio" in plan.not_flyable
