"""A placed box and a plan round it, for tests of missions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_catalog import box_structure

from upplied.geometry.poses import from_yaw_pitch, look_at
from upplied.records import Measures, Placement, Plan, Structure, SurfaceStates, Trajectory

PLACE = Placement(47.3977, 8.5456, 488.0, 30.0, "ellipsoid")


def placed_box(placement: Placement | None = PLACE, **around) -> Structure:
    """A box of 12 x 8 x 10 m on the ground, its +X 30 deg east of north."""
    structure = box_structure("box", (12.0, 8.0, 10.0))
    return replace(structure, placement=placement, surroundings=replace(structure.surroundings, **around))


def rounds(turns: int = 3, count: int = 240, away: float = 6.0, speed: float = 2.0) -> Trajectory:
    """A spiral round the box, looking at its axis."""
    angle = np.linspace(0, 2 * np.pi * turns, count)
    radius = np.hypot(6.0, 4.0) + away
    height = np.linspace(3.0, 9.0, count)
    positions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    axis = np.stack([0 * angle, 0 * angle, height - 1.0], axis=1)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    t_s = np.concatenate([[0.0], np.cumsum(steps / speed)])
    return Trajectory(t_s, positions, look_at(positions, axis))


def turning_on_the_spot() -> Trajectory:
    """Straight past the box, with a turn of 120 deg in 4 s half way."""
    t_s = np.array([0.0, 10.0, 14.0, 24.0])
    positions = np.array([[-10.0, -12, 5], [0, -12, 5], [0, -12, 5], [10, -12, 5]])
    return Trajectory(t_s, positions, from_yaw_pitch(np.radians([90.0, 30.0, 150.0, 90.0]), np.zeros(4)))


def made_plan(path: Trajectory | None = None, every: int = 12, **changes) -> Plan:
    """A plan for the box with a viewpoint at every so many waypoints, its sides seen."""
    path = path or rounds()
    sides = np.random.default_rng(0).uniform(-1, 1, (300, 3)) * [6, 4, 5] + [0, 0, 5]
    sides[:150, 0], sides[150:, 1] = 6.0, 4.0
    fields = {
        "status": "ok",
        "trajectory": path,
        "is_viewpoint": np.arange(len(path)) % every == 0,
        "measures": Measures(min_clearance_m=6.0),
        "surface": SurfaceStates(sides, np.ones(300, np.int64)),
    } | changes
    return Plan("demo", "cube", "box", "cube", "recommended", **fields)
