"""Repetitions: on each matching part, and mirrored to the other side."""

from dataclasses import replace

import numpy as np
import pytest
from moved_scenes import about_z, moved_structure
from remembered import study_pair

from upplied.config import settings_for
from upplied.errors import SettingsError
from upplied.geometry.poses import optical_axis
from upplied.planning.carry.carried import carry
from upplied.planning.demonstration.repetition import begins_of, demonstrated_part, joined, mirrored, takes_of
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.parts import labels_of, parts_of
from upplied.planning.trajectory.complete import propose
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def fleet():
    return {structure.structure_id: structure for structure in sample_structures()}


@pytest.fixture(scope="module")
def engine(fleet):
    return fly(fleet["a320-v1"], "engine_left")


def test_mirroring_twice_gives_the_flight_back(fleet, engine):
    once = mirrored(engine, fleet["a320-v1"])
    twice = mirrored(once, fleet["a320-v1"])
    np.testing.assert_allclose(twice.positions, engine.positions, atol=1e-12)
    np.testing.assert_allclose(optical_axis(twice.quat_xyzw), optical_axis(engine.quat_xyzw), atol=1e-9)
    np.testing.assert_allclose(
        optical_axis(once.quat_xyzw), optical_axis(engine.quat_xyzw) * [1, -1, 1], atol=1e-9
    )


@pytest.mark.ci
def test_the_engine_is_what_the_flight_round_it_is_about(fleet, engine):
    settings = settings_for("recommended")
    pair = study_pair(fleet["a320-v1"], fleet["b747-v1"], settings)
    (take,) = takes_of(engine, pair, settings)
    part = parts_of(pair.surface.source).middle[demonstrated_part(take.attended)]
    assert 4 < part[1] < 8 and part[2] < 3  # under the left wing of an A320


@pytest.mark.slow
def test_each_engine_of_a_747_is_inspected(fleet, engine):
    settings = settings_for("recommended", correspondence={"repeat": "each"})
    plan = plan_transfer(engine, fleet["a320-v1"], fleet["b747-v1"], settings)
    assert plan.status == "ok", plan.reason
    assert plan.measures.min_clearance_m >= 2
    assert plan.measures.coverage_inspected_pct > 99  # what lay beside the engines counts nothing
    across = plan.trajectory.positions[:, 1]
    for engine_y in (20.8, 11.7, -11.7, -20.8):  # of the sample 747
        assert np.abs(across - engine_y).min() < 8
    once = plan_transfer(engine, fleet["a320-v1"], fleet["b747-v1"], settings_for("recommended"))
    assert once.trajectory.positions[:, 1].min() > 0


@pytest.mark.ci
def test_presets_that_know_no_parts_say_so(fleet, engine):
    settings = settings_for("paper", correspondence={"repeat": "mirror"})
    with pytest.raises(SettingsError, match="recommended"):
        plan_transfer(engine, fleet["a320-v1"], fleet["b747-v1"], settings)


def test_joined_flights_follow_one_another(engine):
    flight = engine.trajectory
    both = joined([flight, replace(flight, positions=flight.positions + 1)])
    assert len(both) == 2 * len(flight) and (np.diff(both.t_s) > 0).all()
    np.testing.assert_array_equal(both.positions[len(flight) :], flight.positions + 1)


@pytest.mark.slow
def test_between_the_takes_nothing_crawls_and_nobody_hovers(fleet, engine):
    """The flight closed to a loop: each take ends where it began, which is no hover of anybody."""
    share = np.linspace(0, 1, 41)[1:, None]
    back = engine.positions[-1] + share * (engine.positions[0] - engine.positions[-1])
    closed = replace(
        engine,
        positions=np.vstack([engine.positions, back]),
        quat_xyzw=np.vstack([engine.quat_xyzw, np.repeat(engine.quat_xyzw[-1:], 40, axis=0)]),
        t_ns=np.concatenate([engine.t_ns, engine.t_ns[-1] + (np.arange(40) + 1) * 10**8]),
        sha256="",
    )
    settings = settings_for("recommended", correspondence={"repeat": "each"})
    pair = study_pair(fleet["a320-v1"], fleet["b747-v1"], settings)
    takes = takes_of(closed, pair, settings)
    trajectory, _, answers, _ = propose(carry(takes, settings), settings)
    begins = begins_of([take.inspection.flight for take in takes])
    ends = begins + [np.ptp(take.inspection.flight.t_s) for take in takes]
    for end, begin in zip(ends[:-1], begins[1:], strict=True):
        between = np.flatnonzero((answers > end - 1e-6) & (answers < begin + 1e-6))
        step = np.linalg.norm(np.diff(trajectory.positions[between], axis=0), axis=1)
        spent = np.diff(trajectory.t_s[between])
        assert not ((step < 0.05) & (spent > 1.0)).any()
        # The demonstration's mean is 0.4 m/s, and its pictures are sharp: neither binds in between.
        assert step.sum() / spent.sum() > 1.0


@pytest.mark.slow
def test_each_engine_is_found_on_a_target_that_is_turned(fleet, engine):
    """Which parts lie on the demonstrated side is asked where the target lies on the source."""
    turn = about_z(180)
    settings = settings_for(
        "recommended", correspondence={"repeat": "each"}, registration={"search": "heading"}
    )
    pair = study_pair(fleet["a320-v1"], moved_structure(fleet["b747-v1"], turn), settings)
    straight = study_pair(fleet["a320-v1"], fleet["b747-v1"], settings)
    centres = []
    for each, back in ((pair, turn), (straight, np.eye(3))):
        places = []
        for take in takes_of(engine, each, settings):
            fit = take.pair.surface
            mine = labels_of(fit.source) == demonstrated_part(take.attended)
            points = fit.correspondences.target_points[mine & (fit.correspondences.target_index >= 0)]
            places.append((points @ back).mean(axis=0))
        centres.append(np.array(places))
    np.testing.assert_allclose(centres[0], centres[1], atol=0.5)


@pytest.mark.slow
def test_each_engine_is_flown_from_its_own_side(fleet, engine):
    """The flight at the left engine goes to the left engines, its mirror image to the right ones."""
    settings = settings_for("recommended", correspondence={"repeat": "each"})
    pair = study_pair(fleet["a320-v1"], fleet["b747-v1"], settings)
    takes = takes_of(engine, pair, settings)
    assert len(takes) == 4
    middle = np.ptp(fleet["a320-v1"].vertices[:, 1]) / 2 + fleet["a320-v1"].vertices[:, 1].min()
    flown = [np.sign(take.inspection.flight.positions[:, 1].mean() - middle) for take in takes]
    assert flown == [1, 1, -1, -1]
    for take, side in zip(takes, flown, strict=True):
        seen = take.inspection.visibility.total & (take.pair.surface.correspondences.target_index >= 0)
        part = demonstrated_part(take.attended)
        own = seen & (labels_of(take.pair.surface.source) == part)
        there = take.pair.surface.correspondences.target_points[own, 1]
        assert np.sign(np.median(there)) == side
