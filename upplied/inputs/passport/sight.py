"""How a flight lies against its structure: clearance, height over ground, what the camera meets, its aim.

A pilot looks a little left and right of the nearest surface; a wrong heading holds or turns the aim aside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.records import Bools, Camera, Floats, Record, Structure

_PICTURE = 5  # rays along each side of a picture
# To the corners of a cube, the middles of its edges and faces, all a little askew: no grid of a mesh is hit.
_AROUND = np.stack(np.meshgrid(*[(-1.03, 0.02, 0.97)] * 3), axis=-1).reshape(-1, 3)
_AROUND = np.delete(_AROUND, 13, axis=0)


@dataclass(frozen=True, eq=False, repr=False)
class Sight(Record):
    """What is true of each of M poses."""

    clearance_m: Floats  # (M,) distance from the surface
    inside: Bools  # (M,) surrounded by the structure's surface
    height_m: Floats  # (M,) over the ground, or over the lowest point of the structure where none is declared
    range_m: Floats  # (M,) along the camera's axis to the structure; inf where it meets nothing
    shown: Floats  # (M,) share of the picture that shows the structure within the camera's range

    @property
    def meets(self) -> Bools:
        """(M,) whether the camera's axis meets the structure."""
        return np.asarray(np.isfinite(self.range_m))


def sight_of(
    positions: Floats, quat_xyzw: Floats, camera: Camera, structure: Structure, scene: Scene
) -> Sight:
    """Measure the camera's poses, (M, 3), m, and (M, 4), against the structure of this scene."""
    turns = Rotation.from_quat(quat_xyzw)
    ahead = turns.apply([1.0, 0.0, 0.0])
    range_m = scene.cast(positions, ahead)[0]
    across, up = (
        np.radians(angle) / 2 * np.linspace(-0.9, 0.9, _PICTURE)
        for angle in (min(camera.hfov_deg, 340.0), min(camera.vfov_deg, 170.0))
    )
    yaw, pitch = (part.ravel() for part in np.meshgrid(across, up))
    rays = optical_axis(from_yaw_pitch(yaw, pitch))
    directions = (turns.as_matrix() @ rays.T).swapaxes(1, 2).reshape(-1, 3)
    depth = scene.cast(np.repeat(positions, len(rays), axis=0), directions)[0].reshape(-1, len(rays))
    height_m, shown = positions[:, 2] - structure.floor_z_m, (depth <= camera.max_range_m).mean(axis=1)
    return Sight(scene.distance(positions), inside(positions, scene), height_m, range_m, shown)


def inside(positions: Floats, scene: Scene) -> Bools:
    """Which positions (M,) the surface surrounds, by rays in 26 directions.

    All but two must hit, and most of those must cross it an odd number of times: not so between its parts.
    """
    surrounded = np.zeros(len(positions), bool)
    low, high = scene.box
    maybe = np.flatnonzero(((positions > low) & (positions < high)).all(axis=1))
    if len(maybe):
        starts = np.repeat(positions[maybe], len(_AROUND), axis=0)
        crossed = scene.hits(starts, np.tile(_AROUND, (len(maybe), 1))).reshape(-1, len(_AROUND))
        surrounded[maybe] = ((crossed > 0).mean(axis=1) > 0.9) & ((crossed % 2 == 1).mean(axis=1) > 0.6)
    return surrounded


_POSES = 300  # spread evenly over the flight
_LEVEL = 0.5  # least horizontal part of a direction that has a heading
_LEAST = 60  # poses that have a heading
_CLOSE_DEG = 12.0  # of the line: farther is a look at something else
_SHARE = 0.7  # of the poses that the line must explain
_ROUNDS = 5  # of fitting again, outliers counting less
_WIDTH_DEG = 10.0  # beyond which it counts less
_PITCHES_DEG = 8.0  # standard deviation of pitch and of the surface's elevation that is compared


@dataclass(frozen=True)
class Aim:
    """The straight line through the aim over time, both zero where there is none; and the pitch."""

    aim_drift_deg: float = 0.0  # from end to end, to the left of the nearest surface
    aim_off_deg: float = 0.0  # in the middle
    pitch_fit_pct: float = float("nan")  # correlation of the pitch with the elevation of the nearest surface
    pitch_span_deg: float = float("nan")  # of the pitch, nine tenths of the poses
    pitch_want_deg: float = 0.0  # elevation of the nearest surface, up or down, 75th percentile


def aim_of(positions: Floats, quat_xyzw: Floats, scene: Scene) -> Aim:
    """The camera's heading and pitch beside the nearest surface; poses are (M, 3), m, and (M, 4)."""
    some = chosen_evenly(len(positions), _POSES)
    ahead = optical_axis(quat_xyzw[some])
    near = unit(scene.closest(positions[some])[0] - positions[some])
    pitch, want = (np.degrees(np.arcsin(np.clip(part[:, 2], -1, 1))) for part in (ahead, near))
    fit = float("nan")
    if len(some) >= _LEAST and min(np.std(pitch), np.std(want)) > _PITCHES_DEG:
        fit = 100 * float(np.corrcoef(pitch, want)[0, 1])
    span = float(np.ptp(np.percentile(pitch, [5, 95]))) if len(some) >= _LEAST else float("nan")
    left = left_of(ahead, near)
    level = np.isfinite(left)
    line = _line(np.linspace(-0.5, 0.5, len(some))[level], left[level])
    return Aim(*line, fit, span, float(np.percentile(np.abs(want), 75)))


def left_of(ahead: Floats, near: Floats) -> Floats:
    """How far unit vectors (N, 3) point to the left of others, deg; NaN where one of the two is steep."""
    level = (np.hypot(*ahead[:, :2].T) > _LEVEL) & (np.hypot(*near[:, :2].T) > _LEVEL)
    across = near[:, 0] * ahead[:, 1] - near[:, 1] * ahead[:, 0]
    left = np.degrees(np.arctan2(across, (ahead[:, :2] * near[:, :2]).sum(axis=1)))
    return np.where(level, left, np.nan)


def _line(time: Floats, left: Floats) -> tuple[float, float]:
    """Slope and middle of the line that most angles (K,), deg, lie on; zeros where there is none."""
    if len(time) < _LEAST:
        return 0.0, 0.0
    rows, weight = np.column_stack([time, np.ones(len(time))]), np.ones(len(time))
    for _ in range(_ROUNDS):
        line = np.linalg.lstsq(rows * weight[:, None], left * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(left - rows @ line) / _WIDTH_DEG, 1.0))
    near_line = np.abs(left - rows @ line) < _CLOSE_DEG
    thirds = [near_line[(time >= at) & (time < at + 1 / 3)] for at in (-0.5, -1 / 6, 1 / 6 - 1e-9)]
    if near_line.mean() < _SHARE or any(len(third) < _LEAST // 6 or third.mean() < 0.5 for third in thirds):
        return 0.0, 0.0
    return float(line[0]), float(line[1])
