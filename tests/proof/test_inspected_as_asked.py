"""Inspected as asked is what an independent ray caster finds as near, as frontal and as sharp as planned."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from upplied.config import CloudSettings, InspectionSettings
from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.observations import Views
from upplied.proof.align import align
from upplied.proof.as_flown import AsFlown, as_flown
from upplied.proof.inspected import CORRECTED_RIM_DEG, PlannedLooks, looks_at, planned_looks
from upplied.proof.looks import looks_of
from upplied.records import Bools, Camera, Cloud, Floats, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import Wind, fly_trajectory

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
from proof_truth import truly_seen

CUBE = member("cube-v1").structure
CAMERA = Camera(70.0, 55.0, 1.0, 25.0, 4000, 3000)
SCENE = scene_of(CUBE)
SURFACE = surface_samples(CUBE, SCENE, CloudSettings(surface_samples=400))
BEAT_S = 0.5


@pytest.fixture(scope="module")
def plan() -> Trajectory:
    flown = fly(CUBE, "sides", seed=1).trajectory
    return interpolate(flown, np.arange(0.0, min(flown.t_s[-1], 120.0), 0.5))


@pytest.fixture(scope="module")
def flown(plan) -> Trajectory:
    return fly_trajectory(plan, wind=Wind(2.0), seed=3)


def at_beats(path: Trajectory) -> Trajectory:
    return interpolate(path, np.arange(path.t_s[0], path.t_s[-1], BEAT_S))


def finest_mm(path: Trajectory) -> Floats:
    """What the middle pixel covers at best (N,), mm: distance over the cosine of the incidence."""
    finest = np.full(len(SURFACE), np.inf)
    poses = at_beats(path)
    normal, pixel = SURFACE.outward, np.tan(np.radians(CAMERA.hfov_deg / 2)) / (CAMERA.width_px / 2)
    for index in range(len(poses)):
        one = poses.take(slice(index, index + 1))
        seen = truly_seen(CUBE, one, SURFACE, CAMERA)
        ray = SURFACE.points - one.positions[0]
        squared, facing = (ray**2).sum(axis=1), -(ray * normal).sum(axis=1)
        covered = 1e3 * pixel * squared / np.where(seen, facing, 1.0)
        finest = np.where(seen, np.minimum(finest, covered), finest)
    return finest


@pytest.fixture(scope="module")
def planned_mm(plan) -> Floats:
    return finest_mm(plan)


def judged(plan: Trajectory, log: Trajectory, **more) -> AsFlown:
    return as_flown(plan, plan.t_s[::4], align(plan, log), log, SURFACE, CAMERA, SCENE, **more)


def shares(report: AsFlown, truth_mm: Floats, planned_mm: Floats) -> tuple[float, float, Bools]:
    """Of the planned surface, %: inspected as planned by its claim; truly; and wrong claims (N,)."""
    need = np.isfinite(planned_mm)
    claimed, true = report.looks.inspected[need], (truth_mm <= 1.1 * planned_mm)[need]
    wrong = claimed & ~(truth_mm <= 1.2 * planned_mm)[need]  # looks lie half a beat apart
    return 100 * claimed.mean(), 100 * true.mean(), wrong


@pytest.mark.ci
def test_a_flight_of_its_plan_is_inspected_as_asked(plan, flown, planned_mm):
    report = judged(plan, flown)
    claimed, true, wrong = shares(report, finest_mm(flown), planned_mm)
    assert claimed > 90 and claimed == pytest.approx(true, abs=5) and wrong.mean() < 0.01
    assert (report.looks.inspected <= report.looks.seen).all()


def test_a_flight_farther_than_planned_does_not_claim_what_it_saw_from_afar(plan, planned_mm):
    """In view it is all; as near and frontal as planned, hardly anything."""
    middle = CUBE.vertices.mean(axis=0)
    off = (plan.positions - middle) * [1, 1, 0]
    wide = plan.positions + 2.8 * off / np.linalg.norm(off, axis=1, keepdims=True)
    log = at_log_rate(replace(plan, positions=wide))
    report = judged(plan, log)
    claimed, true, wrong = shares(report, finest_mm(log), planned_mm)
    in_view = 100 * report.looks.seen[np.isfinite(planned_mm)].mean()
    assert in_view > 95 and true < 70 and claimed <= true + 5 and wrong.mean() < 0.01


def test_a_stuck_camera_claims_only_what_it_truly_looked_at(plan, flown, planned_mm):
    stuck = flown.t_s >= 40
    quats = flown.quat_xyzw.copy()
    quats[stuck] = quats[stuck.argmax()]
    log = replace(flown, quat_xyzw=quats)
    report = judged(plan, log)
    claimed, true, wrong = shares(report, finest_mm(log), planned_mm)
    assert claimed <= true + 3 and wrong.mean() < 0.01 and claimed < 80


def test_a_camera_that_shakes_beyond_the_rule_inspects_nothing(plan, flown):
    yaw, pitch = yaw_pitch(flown.quat_xyzw)
    turning = from_yaw_pitch(yaw + np.radians(8) * np.sin(2 * np.pi * flown.t_s / 4), pitch)
    shaken = replace(flown, quat_xyzw=turning)
    slow, fast = (
        judged(plan, shaken, rule=replace(InspectionSettings(), exposure_s=seconds)).looks
        for seconds in (1 / 500, 1 / 30)
    )
    assert fast.seen.sum() == slow.seen.sum()
    assert fast.inspected.sum() < 0.8 * slow.inspected.sum()


def test_only_photos_inspect_where_their_times_are_known(plan, flown):
    every, few = np.arange(0.0, flown.t_s[-1], 1.0), np.arange(0.0, 30.0, 1.0)
    all_of_it, part = (judged(plan, flown, photo_s=photos).looks for photos in (every, few))
    assert (part.inspected <= part.seen).all() and (part.inspected <= all_of_it.inspected).all()
    assert part.inspected.sum() < 0.6 * all_of_it.inspected.sum()
    none = judged(plan, flown, photo_s=np.array([-5.0])).looks
    assert not none.inspected.any()


def test_a_coarser_camera_asks_for_a_nearer_flight(plan, flown):
    """Half the pixels: from the same place a pixel covers twice as much."""
    alignment = align(plan, flown)
    coarse = replace(CAMERA, width_px=2000, height_px=1500)
    arguments = plan, plan.t_s[::4], alignment, flown, SURFACE, coarse, SCENE
    assert as_flown(*arguments, planned_with=CAMERA).looks.inspected.mean() < 0.1
    unknown = replace(CAMERA, width_px=0, height_px=0)
    same = as_flown(plan, plan.t_s[::4], alignment, flown, SURFACE, unknown, SCENE, planned_with=CAMERA)
    assert same.looks.inspected.sum() == judged(plan, flown).looks.inspected.sum()


def test_of_a_corrected_log_only_what_both_paths_match_is_certain(plan, flown):
    beside = replace(flown, positions=flown.positions + np.array([1.6, -1.2, 0.0]))
    alignment = align(plan, beside)
    assert alignment.corrected
    report = as_flown(plan, plan.t_s[::4], alignment, beside, SURFACE, CAMERA, SCENE)
    usual = planned_looks(plan, SURFACE, CAMERA, SCENE, InspectionSettings())
    rule = replace(usual, rim_deg=CORRECTED_RIM_DEG)  # which no log that is right must keep
    alone = [
        looks_of(path, SURFACE, CAMERA, SCENE, plan=rule).inspected for path in (alignment.flown, beside)
    ]
    assert usual.rim_deg < CORRECTED_RIM_DEG
    assert np.array_equal(report.looks.inspected, alone[0] & alone[1]) and (alone[0] != alone[1]).any()


def test_the_motion_of_a_photo_is_that_around_it_and_not_across_a_silence():
    """2 m/s for 5 s, a silence of 20 s and 40 m, and 5 s of standing."""
    t_s = np.concatenate([np.arange(0, 5.05, 0.1), np.arange(25, 30.05, 0.1)])
    place = np.zeros((len(t_s), 3))
    place[:, 0] = np.where(t_s < 10, 2 * t_s, 50.0)
    yaw = np.where(t_s < 10, 0.3 * t_s, 0.0)
    path = Trajectory(t_s, place, from_yaw_pitch(yaw, np.zeros(len(t_s))))
    looks = looks_at(path, np.array([0.1, 2.0, 4.9, 25.1, 29.0]), np.array([51]))
    assert np.allclose(looks.velocity, [[2, 0, 0]] * 3 + [[0, 0, 0]] * 2, atol=1e-6)
    assert np.allclose(looks.turn, [[0, 0, 0.3]] * 3 + [[0, 0, 0]] * 2, atol=1e-6)
    stops = Trajectory(t_s[:101], np.minimum(place, 6.0)[:101], path.quat_xyzw[:101])
    assert looks_at(stops, np.array([2.45])).velocity[0, 0] == pytest.approx(2.0, abs=0.01)


def test_what_lies_at_the_rim_or_the_largest_incidence_is_not_claimed():
    """A pose that is off by the noise of its log would not show it as asked."""
    rule, rim_deg = InspectionSettings(), CAMERA.hfov_deg / 2
    angle = np.radians([0.0, rim_deg - 0.2, rim_deg - 0.1])
    aslant = np.radians(rule.max_incidence_deg - np.array([0.2, 0.1]))
    rays = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])[[0, 1, 2, 0, 0]]
    normals = -rays
    normals[3:] = -np.column_stack([np.cos(aslant), np.sin(aslant), 0 * aslant])
    still = Trajectory(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)))
    shown, surface = Views(still, np.ones((3, 5), bool)), Cloud(8 * rays, normals)
    looks = PlannedLooks(np.full(5, 30.0), np.ones(5, bool), CAMERA, rule)
    claimed = looks.matched(shown, looks_at(still, still.t_s), surface, CAMERA)
    assert claimed.tolist() == [True, True, False, True, False]


def at_log_rate(path: Trajectory) -> Trajectory:
    fine = interpolate(path, np.arange(0.0, path.t_s[-1], 0.1))
    noise = np.random.default_rng(0).normal(0, 0.02, fine.positions.shape)
    return replace(fine, positions=fine.positions + noise)
