"""Speed, clearance and stand-off at each pose of a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.geometry.polylines import leg_lengths
from upplied.geometry.poses import interpolate, matrices
from upplied.geometry.scene import Scene
from upplied.records import Camera, Floats, Record, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Record):
    """A path at display density, with its values along it."""

    path: Trajectory
    speed_mps: Floats  # (N,)
    clearance_m: Floats  # (N,) to the nearest surface
    standoff_m: Floats  # (N,) to the surface in the picture, nearest to its middle


_MOST = 600
_HALF_PICTURE = 2  # rays on each side of the middle of a picture, across and upwards


def profile(trajectory: Trajectory, scene: Scene, camera: Camera | None = None) -> Profile:
    """The values along a trajectory, at its own poses or at 600 even times where it has more.

    Parameters
    ----------
    trajectory : Trajectory
    scene : Scene
        Of the structure it is flown around.
    camera : Camera, optional
        Its field of view bounds the picture; by default the optical axis alone counts.
    """
    path = trajectory
    if len(path) > _MOST:
        path = interpolate(path, np.linspace(path.t_s[0], path.t_s[-1], _MOST))
    clearance = scene.distance(path.positions)
    return Profile(path, speeds(path), clearance, standoff(path, scene, camera, clearance))


def standoff(path: Trajectory, scene: Scene, camera: Camera | None, clearance_m: Floats) -> Floats:
    """Distance (N,), m, to the surface nearest to the middle of each picture.

    For a picture without surface it is the distance of the nearest surface.
    """
    across, upwards = np.zeros(1), np.zeros(1)
    if camera is not None:
        steps = np.linspace(-1, 1, 2 * _HALF_PICTURE + 1)
        half = np.tan(np.radians(np.minimum([camera.hfov_deg, camera.vfov_deg], 150.0)) / 2)
        across, upwards = (axis.ravel() for axis in np.meshgrid(steps * half[0], steps * half[1]))
    rays = np.stack([np.ones_like(across), across, upwards], axis=1)
    rays = rays[np.argsort(np.linalg.norm(rays, axis=1), kind="stable")]  # from the middle outwards
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    turned = np.einsum("nij,kj->nki", matrices(path.quat_xyzw), rays)
    origins = np.repeat(path.positions, len(rays), axis=0)
    reach = scene.cast(origins, turned.reshape(-1, 3))[0].reshape(len(path), len(rays))
    hits = np.isfinite(reach)
    first = reach[np.arange(len(path)), hits.argmax(axis=1)]
    return np.where(hits.any(axis=1), first, clearance_m)


def speeds(path: Trajectory) -> Floats:
    """Speed (N,), m/s, at each pose: of the steps on both of its sides together."""
    if len(path) < 2:
        return np.zeros(len(path))
    step = leg_lengths(path.positions)
    dt = np.diff(path.t_s)
    distance = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])
    duration = np.concatenate([[0.0], dt]) + np.concatenate([dt, [0.0]])
    return distance / np.maximum(duration, 1e-9)
