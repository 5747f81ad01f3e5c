"""The error stated of a flight covers how far its positions are off, whatever its path can tell."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from upplied.config import CloudSettings
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import align
from upplied.proof.as_flown import as_flown
from upplied.records import Camera, Trajectory
from upplied.samples.fleet import member, sample_demonstrations

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
from proof_flights import Flight, Manner, flown

PLANS = {
    each.demonstration_id: interpolate(each.trajectory, np.arange(0.0, each.trajectory.t_s[-1], 0.5))
    for each in sample_demonstrations()
}


def off_m(positions: np.ndarray, flight: Flight) -> float:
    truth = interpolate(flight.truth, flight.log.t_s).positions
    return float(np.percentile(np.linalg.norm(positions - truth, axis=1), 90))


@pytest.fixture(params=PLANS, scope="module")
def plan(request) -> Trajectory:
    return PLANS[request.param]


@pytest.mark.parametrize(
    "manner",
    [Manner(off_deg=3.0), Manner(off_m=(-1.3, 1.6, 0.5), ends=0.4, pace=1.1)],
    ids=["turned", "moved, broken off"],
)
def test_a_log_whose_frame_is_off_is_within_the_stated_error(plan, manner):
    flight = flown(plan, manner, 1)
    alignment = align(plan, flight.log)
    assert off_m(alignment.flown.positions, flight) <= alignment.place_error_m
    moved = np.linalg.norm(alignment.flown.positions - flight.log.positions, axis=1).max()
    assert moved <= alignment.place_error_m


def test_a_frame_that_is_off_is_told_by_half_a_minute_of_flight():
    plan = PLANS["a320-engine-left-v1"]
    flight = flown(plan, Manner(off_m=(-1.3, 1.6, 0.5), ends=0.4, pace=1.1), 1)
    assert flight.log.t_s[-1] < 40 and off_m(flight.log.positions, flight) > 2.0
    assert off_m(align(plan, flight.log).flown.positions, flight) < 0.5


def test_a_turn_about_a_tower_is_not_told_by_its_path_and_so_stated():
    tower = PLANS["turbine-1-tower-v1"]
    flight = flown(tower, Manner(off_deg=3.0), 1)
    alignment = align(tower, flight.log)
    assert alignment.heading_deg == 0 and 0.4 < off_m(flight.log.positions, flight) < alignment.place_error_m


def test_what_a_log_states_of_its_accuracy_bounds_the_error():
    tower = PLANS["turbine-1-tower-v1"]
    log = flown(tower, Manner(), 1).log
    assert align(tower, log, accuracy_m=0.05).place_error_m == pytest.approx(0.1)
    assert 0.2 < align(tower, log).place_error_m < 1.0


def test_a_vehicle_that_flew_5_m_beside_its_plan_and_knows_it_is_on_its_plan_and_left_there():
    plan = PLANS["cube-sides-v1"]
    flight = flown(plan, Manner(beside_m=(4.0, 2.8, 0.0)), 3)
    alignment = align(plan, flight.log, accuracy_m=0.05)
    assert alignment.on_plan.mean() > 0.95 and np.array_equal(alignment.flown.positions, flight.log.positions)
    assert alignment.beside_m == pytest.approx(np.hypot(4.0, 2.8), abs=0.3)
    assert alignment.place_error_m == pytest.approx(0.1) and not alignment.corrected


def test_the_clearance_of_a_corrected_log_is_not_more_than_the_true_one():
    """The true path is neither the logged nor the corrected one, and may come nearer than both."""
    plan, structure = PLANS["a320-engine-left-v1"], member("a320-v1").structure
    scene, camera = scene_of(structure), Camera(70.0, 55.0, 1.0, 25.0)
    surface = surface_samples(structure, scene, CloudSettings(surface_samples=50))
    for seed in range(3):
        flight = flown(plan, Manner(off_m=(0.4, 0.3, 0.0), off_deg=1.0), seed)
        alignment = align(plan, flight.log)
        report = as_flown(plan, np.empty(0), alignment, flight.log, surface, camera, scene)
        truth_m = path_clearance(scene, flight.truth.positions).distance_m
        assert alignment.corrected and truth_m - 1.5 < report.clearance_m <= truth_m


def test_the_clearance_of_a_log_that_is_not_corrected_allows_for_its_stated_error():
    """A frame that is off by less than is corrected, and satellites that are said to be off by so much."""
    plan, structure = PLANS["a320-engine-left-v1"], member("a320-v1").structure
    scene, camera = scene_of(structure), Camera(70.0, 55.0, 1.0, 25.0)
    surface = surface_samples(structure, scene, CloudSettings(surface_samples=50))
    flight = flown(plan, Manner(off_m=(0.06, -0.05, 0.02)), 1)
    truth_m, logged_m = (
        path_clearance(scene, path.positions).distance_m for path in (flight.truth, flight.log)
    )
    for accuracy_m in (None, 0.2):
        alignment = align(plan, flight.log, accuracy_m)
        report = as_flown(plan, np.empty(0), alignment, flight.log, surface, camera, scene)
        assert not alignment.corrected and report.clearance_m <= min(
            truth_m, logged_m - alignment.place_error_m
        )
        assert report.clearance_m > truth_m - 1.0
