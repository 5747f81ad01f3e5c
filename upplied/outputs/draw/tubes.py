"""Paths and camera frusta as slender triangle meshes, so that rays draw them like everything else."""

from dataclasses import dataclass

import numpy as np

from upplied.geometry.polylines import arc_length
from upplied.geometry.poses import matrices
from upplied.geometry.vectors import across
from upplied.records import Camera, Floats, Ints

_SIDES = 6
Colour = tuple[float, float, float]  # red, green and blue in 0 .. 1


@dataclass(frozen=True)
class Tubes:
    """Triangles (T, 3) over vertices (V, 3), m, with a colour (T, 3) in 0 .. 1 for each triangle."""

    vertices: Floats
    triangles: Ints
    colours: Floats


def joined(parts: list[Tubes]) -> Tubes:
    """Several meshes as one."""
    parts = [Tubes(np.empty((0, 3)), np.empty((0, 3), np.int64), np.empty((0, 3))), *parts]
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Tubes(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + offset for part, offset in zip(parts, offsets, strict=False)]),
        np.concatenate([part.colours for part in parts]),
    )


def tubes(starts: Floats, ends: Floats, radius_m: float, colour: tuple[float, float, float]) -> Tubes:
    """A six-sided tube with pointed caps around each segment, from starts (N, 3) to ends (N, 3), m."""
    along = ends - starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    long_enough = length[:, 0] > 1e-9
    starts, ends, along = (each[long_enough] for each in (starts, ends, along / np.maximum(length, 1e-9)))
    side, up = across(along)
    here = np.arange(_SIDES)
    after, angle = (here + 1) % _SIDES, here * 2 * np.pi / _SIDES
    rim = radius_m * (np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * up[:, None])
    tips = np.stack([starts - radius_m * along, ends + radius_m * along], axis=1)
    vertices = np.concatenate([starts[:, None] + rim, ends[:, None] + rim, tips], axis=1)
    pattern = np.concatenate(
        [
            np.stack([here, after, here + _SIDES], axis=1),
            np.stack([after, after + _SIDES, here + _SIDES], axis=1),
            np.stack([after, here, np.full(_SIDES, 2 * _SIDES)], axis=1),
            np.stack([here + _SIDES, after + _SIDES, np.full(_SIDES, 2 * _SIDES + 1)], axis=1),
        ]
    )
    triangles = (np.arange(len(starts)) * (2 * _SIDES + 2))[:, None, None] + pattern
    triangles = triangles.reshape(-1, 3)
    return Tubes(vertices.reshape(-1, 3), triangles, np.tile(np.asarray(colour, float), (len(triangles), 1)))


def path(positions: Floats, radius_m: float, colour: tuple[float, float, float]) -> Tubes:
    """A polyline (N, 3), m, as tubes; pieces shorter than half the radius are left out."""
    places = thinned(positions, radius_m / 2)
    if np.ptp(places, axis=0).max() < 1e-9:  # hovering: a dot
        places = places[:1] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1e-3]])
    return tubes(places[:-1], places[1:], radius_m, colour)


def thinned(positions: Floats, step_m: float) -> Floats:
    """The first and last position, and between them those at least a step apart along the path."""
    if len(positions) < 3 or step_m <= 0:
        return positions
    keep = np.append(True, np.diff(np.floor(arc_length(positions) / step_m)) > 0)
    keep[-1] = True
    return positions[keep]


def frusta(
    positions: Floats, quat_xyzw: Floats, camera: Camera, depth_m: float, radius_m: float, colour: Colour
) -> Tubes:
    """The edges of each camera's pyramid of sight, cut off at a depth."""
    corners = frustum_corners(positions, quat_xyzw, camera, depth_m)
    apex = np.repeat(positions[:, None], 4, axis=1)
    starts = np.concatenate([apex.reshape(-1, 3), corners.reshape(-1, 3)])
    ends = np.concatenate([corners.reshape(-1, 3), np.roll(corners, -1, axis=1).reshape(-1, 3)])
    return tubes(starts, ends, radius_m, colour)


def frustum_corners(positions: Floats, quat_xyzw: Floats, camera: Camera, depth_m: float) -> Floats:
    """Where each pyramid of sight ends at a depth, (N, 4, 3), m; angles are held under 150 deg."""
    half = np.tan(np.radians(np.minimum([camera.hfov_deg, camera.vfov_deg], 150.0)) / 2) * depth_m
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    local = np.concatenate([np.full((4, 1), depth_m), signs], axis=1)
    return positions[:, None] + np.einsum("nij,kj->nki", matrices(quat_xyzw), local)
