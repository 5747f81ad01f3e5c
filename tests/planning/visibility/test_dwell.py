"""Sharp looks counted pose by pose and point by point, in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.geometry.poses import look_at
from upplied.geometry.vectors import sphere
from upplied.planning.visibility.looks import sharp_looks, widened
from upplied.planning.visibility.observations import Moments, Views, moments, stations_at
from upplied.records import Camera, Cloud, Floats, Trajectory

SHARP, COSINE = 0.2, 0.5


def scene(seed: int) -> tuple[Moments, Views, Cloud]:
    rng = np.random.default_rng(seed)
    t_s = np.linspace(0, 6, 25)
    at = np.array([8.0, 0, 0]) + np.cumsum(rng.normal(0, 0.35, (25, 3)), axis=0)
    flight = Trajectory(t_s, at, look_at(at, rng.normal(0, 0.3, (25, 3))))
    normals = np.array([2.0, 0, 0]) + rng.normal(size=(30, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    steps = moments(flight)
    return steps, Views(flight, rng.random((25, 30)) < 0.5), Cloud(rng.normal(0, 1, (30, 3)), normals)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("stretch", [None, np.diag([2.0, 1.0, 0.5])])
def test_looks_are_counted_as_they_are_defined(seed: int, stretch: Floats | None) -> None:
    steps, shown, cloud = scene(seed)
    looks = sharp_looks(steps, shown, cloud, Camera(), SHARP, COSINE, stretch)
    assert cloud.normals is not None
    carry = np.eye(3) if stretch is None else stretch
    ways, counted = sphere(60), 0
    for index, (point, normal) in enumerate(zip(cloud.points, cloud.normals, strict=True)):
        near, carried, frontal, dwell, moment, sides = np.inf, np.inf, -1.0, 0.0, 0.0, np.zeros(60, bool)
        for pose, at in enumerate(steps.poses.positions):
            station = int(np.abs(shown.stations.t_s - steps.poses.t_s[pose]).argmin())
            ray = point - at
            distance = np.linalg.norm(ray)
            across = steps.velocity[pose] - ray * (ray @ steps.velocity[pose]) / distance**2
            motion = np.linalg.norm(np.cross(steps.turn[pose], ray / distance) + across / distance)
            cosine = -ray @ normal / distance
            if not shown.seen[station, index] or cosine < COSINE or motion > SHARP:
                continue
            counted += 1
            near, frontal = min(near, distance / cosine), max(frontal, cosine)
            carried = min(carried, np.linalg.norm(carry @ ray) / cosine)
            dwell += steps.step_s[pose]
            moment += steps.step_s[pose] * steps.poses.t_s[pose]
            sides[np.argmax(-ways @ carry @ ray)] = True
        assert looks.sampled_m[index] == pytest.approx(near)
        assert looks.carried_m[index] == pytest.approx(carried)
        assert looks.frontal[index] == pytest.approx(frontal)
        assert looks.held_s[index] == pytest.approx(dwell)
        assert np.array_equal(looks.sides[index], sides)
        if dwell:
            assert looks.time_s[index] == pytest.approx(moment / dwell)
        else:
            assert np.isnan(looks.time_s[index])
    assert counted > 30


def test_each_moment_has_its_nearest_station() -> None:
    steps, shown, _ = scene(0)
    times = shown.stations.t_s
    index = stations_at(shown, steps)
    assert np.abs(times[index] - steps.poses.t_s) == pytest.approx(
        np.abs(times[:, None] - steps.poses.t_s).min(axis=0)
    )
    alone = Views(Trajectory(times[:1], np.zeros((1, 3)), np.zeros((1, 4))), shown.seen[:1])
    assert stations_at(alone, steps).tolist() == [0] * len(steps)
    two = Views(Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 4))), shown.seen[:2])
    # Before the first and after the last; half-way the earlier one.
    at = np.array([-1.0, 0.2, 0.5, 0.7, 9.0])
    moments = Moments(
        Trajectory(at, np.zeros((5, 3)), np.zeros((5, 4))), at, np.zeros((5, 3)), np.zeros((5, 3))
    )
    assert stations_at(two, moments).tolist() == [0, 0, 0, 1, 1]


def test_directions_are_spread_evenly() -> None:
    ways = sphere(60)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(np.ones(60))
    assert ways.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.02)
    apart = np.degrees(np.arccos(np.clip(ways @ ways.T - 2 * np.eye(60), -1, 1))).min(axis=1)
    assert apart.min() > 20 and apart.max() < 32
    assert ways[:, 2] == pytest.approx(1 - (2 * np.arange(60) + 1) / 60)


def test_sides_are_widened_to_those_within_30_degrees() -> None:
    ways = sphere(60)
    wide = widened(np.eye(60, dtype=bool))
    assert np.array_equal(wide, ways @ ways.T >= np.cos(np.radians(30)))
    assert not widened(np.zeros((2, 60), bool)).any()
    assert wide.sum(axis=1).max() <= 9 and wide.sum(axis=1).min() >= 4
