"""Turn: a plan does not depend on the axes that structures and flights are given in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moved_scenes import ANY, about_z, moved_flight, moved_structure, strays_m
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.frames import demonstration_in, own_frame, structure_in
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly

PAIRS = {
    "cube": ("cube-v1", "cuboid-v1", "sides"),
    "ship": ("cruise-v1", "yacht-1-v1", "hull"),
    "engine": ("a320-v1", "b747-v1", "engine_left"),
    "turbine": ("turbine-1-v1", "turbine-2-v1", "tower"),
    "bridge": ("bridge-1-v1", "bridge-2-v1", "piers"),
    "fuselage": ("a320-v1", "beluga-v1", "fuselage"),
}


@pytest.fixture(scope="module")
def fleet():
    return {structure.structure_id: structure for structure in sample_structures()}


def scene(fleet, kind, seed):
    source, target, part = PAIRS[kind]
    return fly(fleet[source], part, seed=seed), fleet[source], fleet[target]


def all_turned(scene, turn):
    flight, source, target = scene
    return moved_flight(flight, turn), moved_structure(source, turn), moved_structure(target, turn)


def same_measures(turned, plan, share):
    """Within the share of what the law allows."""
    assert turned.status == plan.status == "ok", (turned.reason, plan.reason)
    a, b = turned.measures, plan.measures
    assert turned.flyable == plan.flyable, (turned.not_flyable, plan.not_flyable)
    for name in ("coverage_paper_pct", "coverage_seen_pct", "coverage_attainable_pct"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), abs=0.5 * share)
    assert a.min_clearance_m == pytest.approx(b.min_clearance_m, abs=0.2 * share)
    assert a.duration_s == pytest.approx(b.duration_s, rel=0.05 * share)


def check_all_turned(fleet, kind, preset, seed, degrees):
    before = scene(fleet, kind, seed)
    turn, options = about_z(degrees), settings_for(preset, verdict=ANY)
    plan, turned = plan_transfer(*before, options), plan_transfer(*all_turned(before, turn), options)
    same_measures(turned, plan, 0.1 if degrees % 90 == 0 else 1.0)
    if preset == "recommended":
        assert strays_m(turned, plan, turn) < 1e-3
        carried = turn @ plan.registration.matrix @ turn.T
        np.testing.assert_allclose(turned.registration.matrix, carried, atol=1e-6)


@pytest.mark.ci
@pytest.mark.parametrize(("kind", "degrees"), [("cube", 90.0), ("engine", 37.0)])
def test_all_turned_together_gives_the_turned_plan(fleet, kind, degrees):
    check_all_turned(fleet, kind, "recommended", 1, degrees)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["paper", "baseline"])
def test_published_plans_turn_with_structures_that_stand_askew(fleet, preset):
    check_all_turned(fleet, "cube", preset, 1, 37.0)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["paper", "baseline"])
def test_published_plans_turn_with_a_ship_that_stands_askew(fleet, preset):
    check_all_turned(fleet, "ship", preset, 1, 37.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(PAIRS))
@pytest.mark.parametrize("seed", [2, 3])
def test_all_turned_together_gives_the_turned_plan_of_every_kind(fleet, kind, seed):
    for degrees in (-152.3, 5.0, 37.0, 44.0, 90.0, 180.0, 270.0):
        check_all_turned(fleet, kind, "recommended", seed, degrees)


def check_turned_target(fleet, kind, turn, search, seed=1, **changes):
    flight, source, target = scene(fleet, kind, seed)
    options = settings_for("recommended", verdict=ANY, registration={"search": search}, **changes)
    plan = plan_transfer(flight, source, target, options)
    turned = plan_transfer(flight, source, moved_structure(target, turn), options)
    assert turned.status == plan.status == "ok", (turned.reason, plan.reason)
    assert turned.flyable == plan.flyable, (turned.not_flyable, plan.not_flyable)
    assert strays_m(turned, plan, turn) < 0.02 * target.diagonal_m
    assert turned.measures.coverage_seen_pct == pytest.approx(plan.measures.coverage_seen_pct, abs=1)
    assert turned.measures.coverage_paper_pct == pytest.approx(plan.measures.coverage_paper_pct, abs=1)
    assert turned.measures.frechet_z == pytest.approx(plan.measures.frechet_z, abs=1e-6)
    assert turned.measures.frechet_m == pytest.approx(plan.measures.frechet_m, abs=1e-3)
    assert turned.counterpart_summary == plan.counterpart_summary


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [29.0, pytest.param(180.0, marks=pytest.mark.slow)])
def test_the_plan_on_a_turned_target_is_the_turned_plan(fleet, degrees):
    """An engine named by its place is the same engine, at any heading that the search finds."""
    outer = (("engine_left", "outer"),)
    assert "engine_left" in fleet["a320-v1"].landmarks
    check_turned_target(fleet, "engine", about_z(degrees), "heading", correspondence={"counterparts": outer})


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ship", "engine", "fuselage"])
def test_the_plan_on_a_turned_target_is_the_turned_plan_at_any_heading(fleet, kind):
    for degrees in (-101.7, 3.0, 29.0, 35.0, 90.0):
        check_turned_target(fleet, kind, about_z(degrees), "heading")


@pytest.mark.slow
def test_the_frechet_distance_of_a_turned_ship_on_itself_is_small(fleet):
    """29 degrees were once no turn at all, and the reported distance 104.7 m."""
    ship = fleet["cruise-v1"]
    flight = fly(ship, "hull", seed=1)
    options = settings_for("recommended", verdict=ANY, registration={"search": "heading"})
    plans = [
        plan_transfer(flight, ship, moved_structure(ship, about_z(degrees)), options) for degrees in (0, 29)
    ]
    straight, turned = (plan.measures for plan in plans)
    assert turned.frechet_m < 5
    assert turned.frechet_m == pytest.approx(straight.frechet_m, abs=1e-3)
    assert turned.frechet_z == pytest.approx(straight.frechet_z, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [25.0, 35.0])
def test_a_target_that_stands_upright_is_turned_alike_where_any_orientation_is_sought(fleet, degrees):
    check_turned_target(fleet, "ship", about_z(degrees), "orientation")


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "degrees"), [("x", 180), ("y", -90), ("y", 60)])
def test_the_path_on_a_tipped_target_is_the_turned_path(fleet, axis, degrees):
    """Waypoints and what they show; the camera has no roll against the ground that it is flown over."""
    tower = fleet["turbine-1-v1"]
    flight, turn = fly(tower, "tower", seed=1), Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    ungrounded = replace(tower, surroundings=replace(tower.surroundings, ground_z_m=None), sha256="")
    options = settings_for("recommended", verdict=ANY, registration={"search": "orientation"})
    plan = plan_transfer(flight, tower, ungrounded, options)
    turned = plan_transfer(flight, tower, replace(ungrounded, vertices=ungrounded.vertices @ turn.T), options)
    assert strays_m(turned, plan, turn) < 0.02 * tower.diagonal_m
    assert turned.measures.coverage_seen_pct == pytest.approx(plan.measures.coverage_seen_pct, abs=1)
    assert turned.measures.frechet_z == pytest.approx(plan.measures.frechet_z, abs=0.05)


@pytest.mark.ci
@given(
    degrees=st.floats(-180, 180),
    east=st.floats(-2000, 2000),
    north=st.floats(-2000, 2000),
    kind=st.sampled_from(sorted(PAIRS)),
)
@settings(max_examples=60, deadline=None)
def test_a_structures_own_frame_turns_and_moves_with_it(fleet, degrees, east, north, kind):
    structure, turn = fleet[PAIRS[kind][0]], about_z(degrees)
    other = moved_structure(structure, turn, np.array([east, north, 0.0]))
    here, there = structure_in(own_frame(structure), structure), structure_in(own_frame(other), other)
    np.testing.assert_allclose(there.vertices, here.vertices, atol=2e-6)  # a grid of a micrometre
    np.testing.assert_allclose(there.frame.to_declared(there.vertices), other.vertices, atol=2e-6)
    flight = fly(structure, PAIRS[kind][2], seed=0) if kind == "cube" else None
    if flight is not None:
        also = demonstration_in(there.frame, moved_flight(flight, turn, np.array([east, north, 0.0])))
        same = demonstration_in(here.frame, flight)
        np.testing.assert_allclose(also.positions, same.positions, atol=2e-6)
        np.testing.assert_allclose(also.quat_xyzw, same.quat_xyzw, atol=1e-8)
