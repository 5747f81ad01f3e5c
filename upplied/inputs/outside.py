"""What can be seen from outside: patches wound the wrong way, parts that nobody sees, outside area.

Almost no real mesh is watertight, so inside tests say nothing. What works is a vote of rays that
escape: a side of a surface is outside where rays from it leave the structure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.geometry.scene import Scene
from upplied.geometry.vectors import across, area_vectors
from upplied.inputs.repair import Topology
from upplied.records import Bools, Floats, Ints, Record

_RAYS = 24  # from each side of each sample, weighted by the cosine: as parallel light from all around
_SPREAD = 4096  # samples over the whole surface, by area
_LEAST = 12  # samples on each patch besides
_MOST_PATCHES = 10_000  # judged, the largest first: more are fragments
_HITS = 8  # outside rays that a patch must get before it is judged
_INVERTED = 0.6  # share of them on its back above which it is turned; sheets and open shells stay below


@dataclass(frozen=True, eq=False, repr=False)
class Outside(Record):
    """What rays from outside found."""

    inverted: Bools  # (T,) of patches that show outside rays their back
    hidden: Bools  # (T,) of components that no outside ray reaches
    area_m2: float  # that can be seen from outside, each face counted once


def look(
    vertices: Floats, triangles: Ints, topology: Topology, ground_z_m: float | None = None, seed: int = 0
) -> Outside:
    """Cast rays from both sides of samples on every patch of triangles (T, 3) and see which escape.

    Where the height of the ground is known, nothing is seen from below it.
    """
    corners = vertices[triangles]
    area = np.linalg.norm(area_vectors(corners), axis=1) / 2
    patch = topology.patch
    patch_area = np.bincount(patch, area)
    wanted = _LEAST + np.floor(_SPREAD * patch_area / patch_area.sum()).astype(np.int64)
    fragments = np.argsort(-patch_area, kind="stable")[_MOST_PATCHES:]
    wanted[fragments] = 0
    rng = np.random.default_rng(seed)
    sample = _chosen(patch, area, wanted, rng)
    points, normals = _sample_points(corners[sample], rng)
    scene = Scene(vertices, triangles)
    reach = 2 * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    front, back = (
        _escaped(scene, points + sign * 0.5e-5 * reach * normals, sign * normals, reach, ground_z_m)
        for sign in (1.0, -1.0)
    )
    number = len(wanted)
    fronts, backs = (np.bincount(patch[sample], hits, number) for hits in (front, back))
    judged = fronts + backs >= _HITS
    inverted = judged & (backs > _INVERTED * (fronts + backs))
    component = topology.component
    seen = np.bincount(component[sample], front + back, component.max(initial=-1) + 1) > 0
    seen[component[np.isin(patch, fragments)]] = True
    share = patch_area / np.maximum(wanted, 1)
    outside_area = share[patch[sample]][front + back > 0].sum() + patch_area[fragments].sum()
    return Outside(inverted[patch], ~seen[component], float(outside_area))


def _chosen(patch: Ints, area: Floats, wanted: Ints, rng: np.random.Generator) -> Ints:
    """Triangles for the samples of each patch, stratified by area, patch after patch."""
    order = np.argsort(patch, kind="stable")
    cumulated = np.cumsum(area[order])
    last = np.cumsum(np.bincount(patch, minlength=len(wanted))) - 1
    end = cumulated[last]
    begin = np.concatenate([[0.0], end[:-1]])
    owner = np.repeat(np.arange(len(wanted)), wanted)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    at = begin[owner] + (step + rng.random(len(owner))) / wanted[owner] * (end - begin)[owner]
    first = np.concatenate([[0], last[:-1] + 1])
    return order[np.clip(np.searchsorted(cumulated, at), first[owner], last[owner])]


def _sample_points(corners: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """A random point in each triangle, and its unit normal."""
    root, along = np.sqrt(rng.random(len(corners)))[:, None], rng.random(len(corners))[:, None]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normals = area_vectors(corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return a * (1 - root) + root * (b * (1 - along) + c * along), normals


def _escaped(scene: Scene, origins: Floats, normals: Floats, reach: float, ground: float | None) -> Floats:
    """How many rays of each origin leave the structure, (N,)."""
    rays = _around(normals)
    starts = np.repeat(origins - scene.origin, _RAYS, axis=0).astype(np.float32)
    free = ~scene.blocked(np.concatenate([starts, (reach * rays).astype(np.float32)], axis=1), slack=0.0)
    if ground is not None:
        free &= (rays[:, 2] > 0) & np.repeat(origins[:, 2] >= ground, _RAYS)
    return free.reshape(-1, _RAYS).sum(axis=1).astype(float)


def _around(normals: Floats) -> Floats:
    """Rays (N * _RAYS, 3) about each normal, as many in a direction as the cosine to it says."""
    step = np.arange(_RAYS)
    height = np.sqrt(1 - (step + 0.5) / _RAYS)
    ring = np.sqrt(1 - height**2)
    golden = np.pi * (3 - np.sqrt(5))
    turn = golden * (step + np.arange(len(normals))[:, None] * _RAYS)
    local = np.stack([ring * np.cos(turn), ring * np.sin(turn), np.broadcast_to(height, turn.shape)], axis=-1)
    return (local @ np.stack([*across(normals), normals], axis=1)).reshape(-1, 3)
