"""The challenge's score: pictures of one point reckoned by hand, hidden, smeared, oblique and far."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.overlap import Frames
from upplied.planning.measures.picture_score import picture_worth
from upplied.planning.plan import plan_transfer
from upplied.planning.visibility.observations import Moments
from upplied.records import Camera, Cloud, Demonstration, Plan, Trajectory
from upplied.samples.pilot import fly
from upplied.samples.surfaces import box

PIXEL = 4.35e-3 / 16.0  # rad, in the middle
EXPOSURE_S = 1e-3
CAMERA = Camera(80.0, 60.0, 0.0, 1e3)  # the challenge's
ONE = np.array([[0.0, 0, 0, 1]])


def scored(at, normal=(-1.0, 0, 0), velocity=(0.0, 0, 0), turn=(0.0, 0, 0), desired_mm=2.0) -> float:
    """The worth of the middle of the near face of a box of 12 m, whose picture is taken along +X."""
    scene = scene_of(box((12.0, 12.0, 12.0), "cube").structure)
    low, high = scene.box
    point = np.array([[low[0], (low[1] + high[1]) / 2, (low[2] + high[2]) / 2]])
    poses = Trajectory(np.zeros(1), point + np.array([at]), ONE)
    steps = Moments(poses, np.ones(1), np.array([velocity], float), np.array([turn], float))
    cloud = Cloud(point, np.array([normal], float))
    seen = Frames(poses, CAMERA, scene).shows(0, point)[None]
    return float(
        picture_worth(steps, seen, cloud, np.array([1e-3 * desired_mm]), np.array([PIXEL]), EXPOSURE_S)[0]
    )


def test_near_and_still_is_worth_one_and_far_less() -> None:
    enough = 2.0e-3 / PIXEL  # m, from which a pixel is 2 mm
    assert scored((-enough * 0.9, 0, 0)) == 1.0
    assert scored((-enough * 2, 0, 0)) == pytest.approx(0.5, rel=1e-6)
    assert scored((-enough * 6, 0, 0)) == 0.0  # below a fifth


def test_motion_smears_by_flight_and_turning() -> None:
    speed = PIXEL * 5.0 / EXPOSURE_S  # a pixel in an exposure, from 5 m
    assert scored((-5.0, 0, 0), velocity=(0, speed * 0.9, 0)) == 1.0
    assert scored((-5.0, 0, 0), velocity=(0, speed * 2, 0)) == pytest.approx(0.5, rel=1e-3)
    assert scored((-5.0, 0, 0), turn=(0, 0, 2 * PIXEL / 1e-3)) == pytest.approx(0.5, rel=1e-2)
    assert scored((-5.0, 0, 0), velocity=(speed, 0, 0)) == 1.0  # straight ahead the middle stands


def test_an_oblique_patch_is_coarser_and_what_is_hidden_or_aside_is_worth_nothing() -> None:
    tilt = np.radians(60.0)
    far = 2.0e-3 / PIXEL * 0.999
    assert scored((-far, 0, 0), (-np.cos(tilt), np.sin(tilt), 0)) == pytest.approx(0.5, rel=1e-2)
    assert scored((-far, 0, 0), (-np.cos(tilt), 0, np.sin(tilt))) == pytest.approx(0.5, rel=1e-2)
    assert scored((20.0, 0, 0)) == 0.0  # behind it
    assert scored((-5.0, 5.0, 0)) == 0.0  # beyond 40 deg aside


@pytest.mark.slow
def test_a_plan_of_the_structure_itself_scores_near_one_and_a_blurred_camera_less() -> None:
    cube = box((12.0, 12.0, 12.0), "cube").structure
    flight = fly(cube, "sides", seed=3)
    slow = replace(flight, camera=replace(flight.camera, exposure_s=1 / 30))

    def plan(preset: str, demonstration: Demonstration) -> Plan:
        return plan_transfer(demonstration, cube, cube, settings_for(preset, clouds={"surface_samples": 400}))

    sharp, blurred = plan("paper", flight).measures, plan("paper", slow).measures
    assert 0.9 < sharp.picture_score <= 1
    assert blurred.picture_score < sharp.picture_score - 0.1
    # `recommended` flies more slowly instead, and says so.
    plans = plan("recommended", flight), plan("recommended", slow)
    assert min(each.measures.picture_score for each in plans) > 0.99
    assert plans[1].measures.duration_s > 1.5 * plans[0].measures.duration_s
    assert [any("refine.longer" in text for text in each.warnings) for each in plans] == [False, True]
