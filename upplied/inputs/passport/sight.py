"""How a flight lies against its structure: clearance, height over ground, and what the camera meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.scene import Scene
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
    rays = picture_rays(camera)
    directions = turns.as_matrix() @ rays.T  # (M, 3, R)
    starts = np.repeat(positions, len(rays), axis=0)
    depth = scene.cast(starts, np.swapaxes(directions, 1, 2).reshape(-1, 3))[0].reshape(-1, len(rays))
    return Sight(
        clearance_m=scene.distance(positions),
        inside=inside(positions, scene),
        height_m=positions[:, 2] - ground_of(structure),
        range_m=range_m,
        shown=(depth <= camera.max_range_m).mean(axis=1),
    )


def ground_of(structure: Structure) -> float:
    """The declared ground, or the lowest point of the structure, m."""
    ground = structure.surroundings.ground_z_m
    return float(structure.vertices[:, 2].min()) if ground is None else float(ground)


def picture_rays(camera: Camera) -> Floats:
    """Unit vectors (R, 3) spread over the picture, camera frame."""
    across, up = (
        np.radians(angle) / 2 * np.linspace(-0.9, 0.9, _PICTURE)
        for angle in (min(camera.hfov_deg, 340.0), min(camera.vfov_deg, 170.0))
    )
    yaw, pitch = (part.ravel() for part in np.meshgrid(across, up))
    return np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])


def inside(positions: Floats, scene: Scene) -> Bools:
    """Which positions (M,) the surface surrounds.

    Rays in 26 directions: all but two must hit, and of those most must cross the surface an odd
    number of times, which tells the inside of a body from a place between its parts.
    """
    surrounded = np.zeros(len(positions), bool)
    low, high = scene.box
    maybe = np.flatnonzero(((positions > low) & (positions < high)).all(axis=1))
    if len(maybe):
        starts = np.repeat(positions[maybe], len(_AROUND), axis=0)
        crossed = scene.hits(starts, np.tile(_AROUND, (len(maybe), 1))).reshape(-1, len(_AROUND))
        surrounded[maybe] = ((crossed > 0).mean(axis=1) > 0.9) & ((crossed % 2 == 1).mean(axis=1) > 0.6)
    return surrounded
