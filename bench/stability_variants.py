"""The same pair in other words: variants that change nothing a person would see."""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from upplied.planning.surface.parts import mesh_pieces
from upplied.records import Demonstration, Floats, Ints, Structure

VARIANTS = ("given", "noise1", "noise2", "order", "divided", "rounded", "seed1", "seed2", "half")
#: Not of the eight: the source's vertices moved, the target as given under another kernel, and one of the
#: structures, or both, welded to one piece, as many programs export them: no mesh tells its parts.
MORE = ("source1", "kernel", "welded", "welded-source", "welded-both")
_NOISE_M, _ROUNDED_M, _HALF_NOISE_M, _HAIR_M = 1e-3, 1e-2, 0.02, 1e-4


@dataclass(frozen=True)
class Inputs:
    """What one plan is made from."""

    demonstration: Demonstration
    source: Structure
    target: Structure
    seed: int


def varied(demonstration: Demonstration, source: Structure, target: Structure, variant: str) -> Inputs:
    """Copies of all three that remember nothing, changed as the variant says."""
    inputs = Inputs(replace(demonstration), replace(source), replace(target), 0)
    rng = np.random.default_rng(zlib.crc32(f"{variant} {target.structure_id}".encode()))
    if variant in ("given", "kernel"):
        return inputs
    if variant.startswith("noise"):
        return replace(inputs, target=_moved(target, variant, rng))
    if variant.startswith("source"):
        return replace(inputs, source=_moved(source, variant, rng))
    if variant == "order":
        return replace(inputs, target=_ordered(target, rng))
    if variant.startswith("welded"):
        which = variant.removeprefix("welded")
        one = _welded(source) if which else source
        return replace(inputs, source=one, target=target if which == "-source" else _welded(target))
    if variant == "divided":
        return replace(inputs, target=_meshed(target, variant, *divided(target.vertices, target.triangles)))
    if variant == "rounded":
        return replace(inputs, target=_rounded(target))
    if variant.startswith("seed"):
        return replace(inputs, seed=int(variant[4:]))
    if variant == "half":
        return replace(inputs, demonstration=_halved(demonstration, rng))
    raise SystemExit(f"variant {variant!r} is unknown: one of {', '.join(VARIANTS + MORE)}")


def _hash(before: str, variant: str) -> str:
    """Another identity for other content; none stays none."""
    return before and hashlib.sha256(f"{before} {variant}".encode()).hexdigest()


def _meshed(one: Structure, variant: str, vertices: Floats, triangles: Ints) -> Structure:
    return replace(one, vertices=vertices, triangles=triangles, sha256=_hash(one.sha256, variant))


def _moved(one: Structure, variant: str, rng: np.random.Generator) -> Structure:
    """Every distinct vertex moved by up to 1 mm along each axis; what is welded stays so."""
    distinct, index = np.unique(np.round(one.vertices, 5), axis=0, return_inverse=True)
    off = rng.uniform(-_NOISE_M, _NOISE_M, distinct.shape)[index.ravel()]
    return _meshed(one, variant, one.vertices + off, one.triangles)


def _ordered(one: Structure, rng: np.random.Generator) -> Structure:
    """Vertices, faces and the first corner of each face in another order."""
    order = rng.permutation(len(one.vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    triangles = place[one.triangles][rng.permutation(len(one.triangles))]
    first = rng.integers(0, 3, len(triangles))
    triangles = np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)
    return _meshed(one, "order", one.vertices[order], triangles)


def divided(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Each triangle in four, at the middles of its edges."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    distinct, index = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    middle = index.reshape(-1, 3) + len(vertices)
    a, b, c = triangles.T
    ab, bc, ca = middle.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.concatenate([np.column_stack(each) for each in corners])
    return np.concatenate([vertices, vertices[distinct].mean(axis=1)]), finer.astype(np.int64)


def _rounded(one: Structure) -> Structure:
    """Coordinates to 1 cm, without the faces that this leaves no area."""
    vertices = np.round(one.vertices / _ROUNDED_M) * _ROUNDED_M
    corner = vertices[one.triangles]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return _meshed(one, "rounded", vertices, one.triangles[area > 1e-9])


def _welded(one: Structure) -> Structure:
    """All pieces joined to the largest by hair-thin triangles, the nearest first."""
    piece, corner = mesh_pieces(one), one.vertices[one.triangles]
    of_vertex = np.full(len(one.vertices), -1)
    of_vertex[one.triangles.ravel()] = np.repeat(piece, 3)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    joined, bridges = np.arange(piece.max() + 1) == np.bincount(piece, area).argmax(), []
    while not joined.all():
        inside, outside = (np.flatnonzero((of_vertex >= 0) & (joined[of_vertex] == side)) for side in (1, 0))
        apart, nearest = cKDTree(one.vertices[inside]).query(one.vertices[outside])
        first = int(apart.argmin())
        bridges.append((inside[nearest[first]], outside[first]))
        joined[of_vertex[outside[first]]] = True
    if not bridges:
        return one
    ends = np.array(bridges)
    third = one.vertices[ends[:, 1]] + _HAIR_M
    faces = np.column_stack([ends, len(one.vertices) + np.arange(len(ends))])
    return _meshed(one, "welded", np.vstack([one.vertices, third]), np.vstack([one.triangles, faces]))


def _halved(flight: Demonstration, rng: np.random.Generator) -> Demonstration:
    """Every second pose, each off by 2 cm (standard deviation of each axis)."""
    positions = flight.positions[::2]
    return replace(
        flight,
        t_ns=flight.t_ns[::2],
        positions=positions + rng.normal(0, _HALF_NOISE_M, positions.shape),
        quat_xyzw=flight.quat_xyzw[::2],
        breaks=np.unique((flight.breaks + 1) // 2),
        fov_deg=None if flight.fov_deg is None else flight.fov_deg[::2],
        sha256=_hash(flight.sha256, "half"),
    )
