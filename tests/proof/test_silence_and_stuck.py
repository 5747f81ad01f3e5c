"""What is not known of a flight is not counted, and a camera that stood is told of after seconds."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import CloudSettings
from upplied.geometry.poses import interpolate, look_at
from upplied.geometry.scene import scene_of
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import align
from upplied.proof.as_flown import as_flown
from upplied.proof.looks import looks_of
from upplied.records import Camera, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE = member("cube-v1").structure
CAMERA = Camera(70.0, 55.0, 1.0, 25.0)
SCENE = scene_of(CUBE)
SURFACE = surface_samples(CUBE, SCENE, CloudSettings(surface_samples=600))


@pytest.fixture(scope="module")
def plan() -> Trajectory:
    flown = fly(CUBE, "sides", seed=1).trajectory
    return interpolate(flown, np.arange(0.0, min(flown.t_s[-1], 150.0), 0.5))


def silent(flown: Trajectory, first_s: float, last_s: float) -> Trajectory:
    rest = (flown.t_s < first_s) | (flown.t_s > last_s)
    return flown.take(np.flatnonzero(rest))


def test_photos_that_were_taken_while_the_log_was_silent_do_not_count(plan):
    log, middle = silent(plan, 40.0, 80.0), np.arange(45.0, 76.0)
    outside = np.array([10.0, 20.0, 100.0])
    both, known = (looks_of(log, SURFACE, CAMERA, SCENE, photo_s=photos)
                   for photos in (np.sort(np.concatenate([outside, middle])), outside))  # fmt: skip
    assert known.seen.any() and np.array_equal(both.seen, known.seen)
    assert np.array_equal(both.pictures, known.pictures)


def orbit(seconds: float = 60.0) -> Trajectory:
    """Once around in a minute, looking at the middle: the camera turns by 6 degrees a second."""
    t_s = np.arange(0.0, seconds, 0.1)
    angle = 2 * np.pi * t_s / 60.0
    positions = np.stack([14 * np.cos(angle), 14 * np.sin(angle), 4 + 0.02 * t_s], axis=1)
    return Trajectory(t_s, positions, look_at(positions, np.tile([0.0, 0.0, 4.0], (len(t_s), 1))))


@pytest.mark.parametrize(("seconds", "expected"), [(3.0, False), (7.0, True), (10.0, True)])
def test_a_camera_that_stood_for_seconds_while_its_plan_turned_is_told(seconds, expected):
    path = orbit()
    stuck = (path.t_s >= 20.0) & (path.t_s < 20.0 + seconds)
    quats = path.quat_xyzw.copy()
    quats[stuck] = quats[stuck.argmax()]
    log = Trajectory(path.t_s, path.positions, quats)
    report = as_flown(path, path.t_s[::50], align(path, log), log, SURFACE, CAMERA, SCENE)
    assert any(text.startswith("the camera stood for") for text in report.findings) == expected
