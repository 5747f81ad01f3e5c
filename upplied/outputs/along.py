"""What happens along a path: speed, clearance and stand-off at each of its poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.polylines import leg_lengths
from upplied.poses import interpolate, optical_axis
from upplied.records import Floats, Record, Trajectory
from upplied.scene import Scene


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Record):
    """A path at display density, with its values along it; NaN where there is none."""

    path: Trajectory
    speed_mps: Floats  # (N,)
    clearance_m: Floats  # (N,) to the nearest surface
    standoff_m: Floats  # (N,) to the surface along the optical axis; NaN where the camera looks past it


def profile(trajectory: Trajectory, scene: Scene, most: int = 600) -> Profile:
    """The values along a trajectory, at its own poses or at `most` even times where it has more.

    Parameters
    ----------
    trajectory : Trajectory
    scene : Scene
        Of the structure it is flown around.
    """
    path = trajectory
    if len(path) > most:
        path = interpolate(path, np.linspace(path.t_s[0], path.t_s[-1], most))
    reach, _, _ = scene.cast(path.positions, optical_axis(path.quat_xyzw))
    return Profile(
        path,
        speeds(path),
        scene.distance(path.positions),
        np.where(np.isfinite(reach), reach, np.nan),
    )


def speeds(path: Trajectory) -> Floats:
    """Speed (N,), m/s, at each pose: of the steps on both of its sides together."""
    if len(path) < 2:
        return np.zeros(len(path))
    step = leg_lengths(path.positions)
    dt = np.diff(path.t_s)
    distance = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])
    duration = np.concatenate([[0.0], dt]) + np.concatenate([dt, [0.0]])
    return distance / np.maximum(duration, 1e-9)
