"""Strips beside a path: lines of places over the surface next to what the path looks at, in its manner.

A strip runs as the flight does, at its distance and angle from the surface, half a swath further to the
side than the one before. The swath is what the camera shows finely enough across its way. Strips follow the
surface: round a hull they bend with it, and they end where it ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from upplied.planning.airspace.rules import Airspace
from upplied.planning.constants import SAME_FACE
from upplied.planning.trajectory.extra_views import in_picture
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.polylines import arc_length
from upplied.poses import from_yaw_pitch, matrices, optical_axis
from upplied.records import Bools, Floats, Ints, Record

_STEPS = 8  # half swaths, to each side, that strips lie apart from the path at most
_NEAREST = 12  # samples of the surface, whose mean plane a place is put on
_OFF = 0.8  # of a step, that the next place may lie off the surface: an edge may be looked past


@dataclass(frozen=True, eq=False, repr=False)
class Strip(Record):
    """A strip, place by place in the order of flight."""

    station: Ints  # (K,) of the path, that each place lies beside
    poses: Flown  # of K places
    shows: Bools  # (K, m) of what is missed


@dataclass(frozen=True, eq=False, repr=False)
class _Places(Record):
    """Places on the surface, and how a camera stands before each."""

    points: Floats  # (K, 3) m, on the surface
    normals: Floats  # (K, 3)
    ways: Floats  # (K, 3) unit, along the flight, in the surface


def strips_beside(
    path: Flown, view: View, airspace: Airspace, half_rad: float, missed: Ints
) -> tuple[list[Strip], float]:
    """Strips beside a path, and how far their places are apart, m.

    Parameters
    ----------
    path : Flown
        M stations.
    view : View
    airspace : Airspace
        Whose rules the places keep.
    half_rad : float
        Half the angle across the way of flight within which a look at a wall is fine enough.
    missed : array of int, shape (m,)
        Samples that the strips are asked about.
    """
    axis = optical_axis(from_yaw_pitch(path.yaw, path.pitch))
    away = view.scene.cast(path.positions, axis)[0]
    hit = np.isfinite(away) & (away <= view.camera.max_range_m)
    if hit.sum() < 2:
        return [], 0.0
    step_m = float(np.median(away[hit])) * np.tan(half_rad)
    station = _apart(path.positions, hit, step_m)
    surface, tree = view.cloud, cKDTree(view.cloud.points)
    way = np.gradient(gaussian_filter1d(path.positions, 2.0, axis=0, mode="nearest"), axis=0)[station]
    axis, away = axis[station], away[station]
    points = path.positions[station] + away[:, None] * axis
    samples = tree, surface.points, surface.outward
    points, first, on = _on_surface(points, -axis, samples, np.inf)
    within = way - (way * first).sum(axis=1, keepdims=True) * first
    on &= np.linalg.norm(within, axis=1) > SAME_FACE * np.linalg.norm(way, axis=1)  # not towards the surface
    along = _unit(within)
    share = np.stack([(axis * of).sum(axis=1) for of in (along, np.cross(first, along), first)], axis=1)
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    strips = []
    for side in (1.0, -1.0):
        here, alive = _Places(points, first, along), on.copy()
        for _ in range(_STEPS):
            here, still = _next_to(here, side * step_m, samples)
            alive &= still
            across = np.cross(here.normals, here.ways)
            looks = share[:, :1] * here.ways + share[:, 1:2] * across + share[:, 2:] * here.normals
            yaw, pitch = np.arctan2(looks[:, 1], looks[:, 0]), np.arcsin(np.clip(looks[:, 2], -1, 1))
            pitch = np.clip(pitch, low, high)
            looks = optical_axis(from_yaw_pitch(yaw, pitch))
            positions = here.points - away[:, None] * looks
            chosen = np.flatnonzero(alive)
            chosen = chosen[airspace.allowed(positions[chosen])]
            if len(chosen) < 2:
                continue
            poses = Flown(positions[chosen], np.unwrap(yaw[chosen]), pitch[chosen])
            strips.append(Strip(station[chosen], poses, _shown(poses, station[chosen], view, missed)))
    return strips, step_m


def _apart(positions: Floats, useful: Bools, step_m: float) -> Ints:
    """Useful stations about a step apart along the path."""
    along = arc_length(positions)
    number = max(int(along[-1] / max(step_m, 1e-6)), 2)
    chosen = np.unique(np.searchsorted(along, np.linspace(0, along[-1], number)))
    return chosen[useful[np.clip(chosen, 0, len(useful) - 1)]]


def _next_to(here: _Places, step_m: float, samples: tuple[cKDTree, Floats, Floats]) -> tuple[_Places, Bools]:
    """Places on the surface a step to the left of the way, and which of them there are."""
    aside = here.points + step_m * np.cross(here.normals, here.ways)
    points, normals, on = _on_surface(aside, here.normals, samples, _OFF * abs(step_m))
    ways = _unit(here.ways - (here.ways * normals).sum(axis=1, keepdims=True) * normals)
    return _Places(points, normals, ways), on


def _on_surface(
    places: Floats, like: Floats, samples: tuple[cKDTree, Floats, Floats], most_m: float
) -> tuple[Floats, Floats, Bools]:
    """Places (K, 3) put on the side of the surface that faces as `like` does, its normals, which are near."""
    tree, points, normals = samples
    distance, near = tree.query(places, k=min(_NEAREST, len(points)))
    weight = (np.einsum("kni,ki->kn", normals[near], like) > 0).astype(float)
    whole = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
    normal = np.einsum("kn,kni->ki", weight, normals[near]) / whole
    on = (np.linalg.norm(normal, axis=1) > SAME_FACE) & (
        np.where(weight > 0, distance, np.inf).min(axis=1) <= most_m
    )
    normal = _unit(np.where(on[:, None], normal, like))
    middle = np.einsum("kn,kni->ki", weight, points[near]) / whole
    off = ((places - middle) * normal).sum(axis=1, keepdims=True)
    return places - np.where(on[:, None], off, 0.0) * normal, normal, on


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _shown(poses: Flown, station: Ints, view: View, missed: Ints) -> Bools:
    """Which of the missed samples (K, m) each place shows."""
    reach = view.reach(poses.positions, missed, station=station)
    count = len(view.fov_deg) if view.fov_deg is not None else int(station.max(initial=0)) + 1
    half = view.halves_rad(count)[station]
    axes = matrices(from_yaw_pitch(poses.yaw, poses.pitch))
    row, wide = np.arange(len(poses)), half[:, 0] >= np.pi / 2
    return np.asarray(
        in_picture(poses.positions, row, axes, view.cloud.points[missed], reach, half, wide), bool
    )
