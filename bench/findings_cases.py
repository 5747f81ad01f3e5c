"""Structures, flights and places of `findings.py`: sample kinds, real meshes, and scans of both."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from random_members import random_member
from real_data import real_folder, real_structure

from upplied.catalog import Catalog, open_catalog
from upplied.config import digest
from upplied.findings.adding import escaping, on_surface
from upplied.findings.looks import Spot
from upplied.findings.place import Errors
from upplied.geometry.poses import look_at
from upplied.geometry.scene import scene_of
from upplied.geometry.vectors import points_on_triangles
from upplied.records import Camera, Demonstration, Structure, Trajectory
from upplied.samples.pilot import fly

KINDS = {"airliner": "fuselage", "wind_turbine": "tower", "ship": "hull", "box": "sides", "bridge": "piers"}
CAMERA = Camera(70.0, 55.0, 1.0, 60.0, 4000, 2973)
ERRORS = Errors(pose_m=0.3, attitude_deg=0.4, pixel_px=1.0)
NOISE_M = 0.02  # of scans, one sigma along the normal
_LARGE_M = 120.0  # of what a ring within the camera's range goes round
_FREE = 0.02  # share of the directions before a place that lead outside, from which on a photo can show it


def members_of(seed: int) -> Iterator[tuple[str, Structure]]:
    """A member of each sample kind that is in no fleet."""
    for kind in KINDS:
        yield kind, random_member(kind, seed).structure


def real_meshes(seed: int, count: int) -> list[Structure]:
    """Some real meshes, in an order by the seed; none, which is printed, where their folder is absent."""
    folder = real_folder()
    if folder is None or not count:
        print("real meshes left out: --real 0, or UPPLIED_REAL_DATA names no folder", flush=True)
        return []
    names = sorted(f"{path.parent.name}/{path.stem}" for path in (folder / "meshes").glob("[a-z]*/*.ply"))
    order = np.random.default_rng(seed).permutation(len(names))
    every = (real_structure(folder, names[at]) for at in order)
    return list(islice((one for one in every if one.diagonal_m < _LARGE_M), count))


def grounds(seed: int, real: int) -> Iterator[tuple[str, Structure, Structure]]:
    """Names, structures, and what is known of them: their mesh, or a scan of it with noise."""
    rng = np.random.default_rng(seed)
    for kind, structure in members_of(seed):
        yield f"{kind}, drawn", structure, structure
    for kind, structure in members_of(seed + 100):
        yield f"{kind}, scan", structure, scan_of(structure, rng)
    for structure in real_meshes(seed, real):
        yield f"{structure.structure_id}, drawn", structure, structure
        yield f"{structure.structure_id}, scan", structure, scan_of(structure, rng)


def scan_of(structure: Structure, rng: np.random.Generator) -> Structure:
    """The structure with noise along its normals, and many more vertices: as a scanner has it."""
    points, triangle = points_on_triangles(structure, 60_000, rng)
    corners = structure.vertices[structure.triangles[triangle]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    points = points + rng.normal(0, NOISE_M, (len(points), 1)) * normals
    none = np.empty((0, 3), np.int64)
    return replace(
        structure, vertices=points, triangles=none, normals=normals, sha256=digest(structure.sha256)
    )


def path_round(structure: Structure) -> Trajectory:
    """An inspection of the structure by a simulated pilot; round what has none, a ring."""
    if "-random-" in structure.structure_id:
        return fly(structure, KINDS[structure.kind], seed=1).trajectory
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    angle, middle = np.linspace(0, 2 * np.pi, 400), (low + high) / 2
    radius = np.linalg.norm((high - low)[:2]) / 2 + 0.1 * structure.diagonal_m + 3
    ring = middle + radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    ring[:, 2] += 0.3 * (high - low)[2] * np.sin(5 * angle) + 0.2 * radius
    return Trajectory(np.arange(400.0), ring, look_at(ring, np.broadcast_to(middle, ring.shape)))


def demonstration_of(structure: Structure, path: Trajectory) -> Demonstration:
    """A flight along a path."""
    t_ns = 1_770_000_000_000_000_000 + np.round(path.t_s * 1e9).astype(np.int64)
    return Demonstration("flight", structure.structure_id, t_ns, path.positions, path.quat_xyzw, CAMERA,
                         sha256=digest(structure.structure_id))  # fmt: skip


def catalog_of(structures: list[Structure], flown: list[Demonstration] | None = None) -> Catalog:
    """A catalog of them in a folder of its own."""
    catalog = open_catalog(tempfile.mkdtemp(prefix="findings-"))
    catalog.add_structures(structures)
    catalog.add_demonstrations(flown or [])
    return catalog


def spots_on(structure: Structure, count: int, rng: np.random.Generator, hidden: bool = False) -> list[Spot]:
    """Places spread over what a photo can show of a structure; or over what lies inside of other parts."""
    points = points_on_triangles(structure, 4 * count, rng)[0]
    places, normals = on_surface(scene_of(structure), points)
    free = escaping(scene_of(structure), places, normals, structure.diagonal_m) > _FREE
    chosen = rng.permutation(np.flatnonzero(free != hidden))[:count]  # points come by triangles, in order
    return [Spot(structure.structure_id, places[at], normals[at], places[at][None]) for at in chosen]
