"""Where the camera looks beside the nearest surface over the flight: a heading that drifts or is off.

Who inspects looks at the surface before the camera, now a little to the left and now to the right. A
heading that drifts turns that steadily to one side; one that is off holds it on one side from end to end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.polylines import chosen_evenly
from upplied.records import Floats
from upplied.scene import Scene

_POSES = 300  # spread evenly over the flight
_LEVEL = 0.5  # least horizontal part of a direction that has a heading
_LEAST = 60  # poses that tell of a heading
_CLOSE_DEG = 12.0  # of the line: farther is a look at something else
_SHARE = 0.7  # of the poses that the line must explain
_ROUNDS = 5  # of fitting again, what lies far off counting less
_WIDTH_DEG = 10.0  # beyond which it counts less


@dataclass(frozen=True)
class Aim:
    """The straight line through the aim over time; both zero where there is none."""

    drift_deg: float = 0.0  # from end to end, to the left of the nearest surface
    off_deg: float = 0.0  # in the middle


def aim_of(positions: Floats, quat_xyzw: Floats, scene: Scene) -> Aim:
    """How far the camera looks to the left of the nearest surface, and how that changes, deg.

    Parameters
    ----------
    positions : array, shape (M, 3), m, structure frame
    quat_xyzw : array, shape (M, 4), camera to structure
    scene : Scene
        Of the structure.
    """
    some = chosen_evenly(len(positions), _POSES)
    ahead = Rotation.from_quat(quat_xyzw[some]).apply([1.0, 0.0, 0.0])
    near = scene.closest(positions[some])[0] - positions[some]
    length = np.maximum(np.linalg.norm(near, axis=1), 1e-9)
    level = (np.hypot(*ahead[:, :2].T) > _LEVEL) & (np.hypot(*near[:, :2].T) > _LEVEL * length)
    if level.sum() < _LEAST:
        return Aim()
    across = near[:, 0] * ahead[:, 1] - near[:, 1] * ahead[:, 0]
    left = np.degrees(np.arctan2(across, (ahead[:, :2] * near[:, :2]).sum(axis=1)))[level]
    time = np.linspace(-0.5, 0.5, len(some))[level]
    rows = np.column_stack([time, np.ones(len(time))])
    weight = np.ones(len(time))
    for _ in range(_ROUNDS):
        line = np.linalg.lstsq(rows * weight[:, None], left * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(left - rows @ line) / _WIDTH_DEG, 1.0))
    near_line = np.abs(left - rows @ line) < _CLOSE_DEG
    thirds = [near_line[(time >= at) & (time < at + 1 / 3)] for at in (-0.5, -1 / 6, 1 / 6 - 1e-9)]
    if near_line.mean() < _SHARE or any(len(third) < _LEAST // 6 or third.mean() < 0.5 for third in thirds):
        return Aim()
    return Aim(float(line[0]), float(line[1]))
