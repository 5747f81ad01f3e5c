"""Structures as a browser shows them, few triangles, small enough for a colour each; and as PLY files."""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.scene import simplified
from upplied.geometry.vectors import area_vectors, unit
from upplied.inputs.rules import from_json
from upplied.records import SURFACE_STATES, Floats, Ints, Record, Structure, SurfaceStates

_MOST_TRIANGLES, _MOST_POINTS = 18_000, 12_000
_ROUNDS, _VOTES = 24, 5


@dataclass(frozen=True, eq=False, repr=False)
class DisplayMesh(Record):
    """A structure with a limited number of triangles; for a point cloud vertices alone."""

    vertices: Floats  # (V, 3) m, structure frame
    triangles: Ints  # (T, 3) vertex indices


def display_mesh(structure: Structure) -> DisplayMesh:
    """The mesh to show: fine meshes are simplified, and large triangles split, as each has one colour."""
    if not len(structure.triangles):
        chosen = chosen_evenly(len(structure.vertices), _MOST_POINTS)
        return DisplayMesh(structure.vertices[chosen], np.empty((0, 3), np.int64))
    vertices, triangles = simplified(structure.vertices, structure.triangles, _MOST_TRIANGLES * 3 // 4)
    return DisplayMesh(*_split(vertices, triangles, structure.diagonal_m / 50))


def _split(vertices: Floats, triangles: Ints, longest_m: float) -> tuple[Floats, Ints]:
    """Halve the longest edges, worst first, until all are short enough or there are enough triangles."""
    for _ in range(_ROUNDS):
        corners = vertices[triangles]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        length = edges.max(axis=1)
        room = _MOST_TRIANGLES - len(triangles)
        worst = np.flatnonzero(length > longest_m)
        worst = worst[np.argsort(-length[worst], kind="stable")][:room]
        if not len(worst):
            break
        first = edges[worst].argmax(axis=1)
        a, b, c = (triangles[worst, (first + step) % 3] for step in range(3))
        ends, place = np.unique(np.sort(np.stack([a, b], axis=1), axis=1), axis=0, return_inverse=True)
        middle = len(vertices) + place.reshape(-1)
        vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
        triangles = triangles.copy()
        triangles[worst] = np.stack([a, middle, c], axis=1)
        triangles = np.concatenate([triangles, np.stack([middle, b, c], axis=1)])
    return vertices, triangles


def display_states(mesh: DisplayMesh, states: SurfaceStates, nearest: Ints | None = None) -> np.ndarray:
    """State (T,) of each triangle, or (V,) of each point of a cloud, uint8.

    `nearest` is the result of `nearest_samples`, if known: all plans for a target share it.
    """
    if not len(states.points):
        return np.zeros(len(mesh.triangles) or len(mesh.vertices), np.uint8)
    near = nearest_samples(mesh, states) if nearest is None else nearest
    return voted(states.state, near).astype(np.uint8)


def nearest_samples(mesh: DisplayMesh, states: SurfaceStates) -> Ints:
    """Indices (T, K) of the samples nearest to each triangle, or (V, K) to each point of a cloud."""
    vertices, triangles = mesh.vertices, mesh.triangles
    near = Neighbourhood(states, float(np.linalg.norm(np.ptp(vertices, axis=0))))
    if not len(triangles):
        return near.nearest(vertices, None)
    corners = vertices[triangles]
    return near.nearest(corners.mean(axis=1), unit(area_vectors(corners)))


def voted(state: Ints, nearest: Ints) -> Ints:
    """The most frequent state (N,) among the nearest samples (N, K); `state` is that of each sample."""
    votes = np.zeros((len(SURFACE_STATES), len(nearest)), np.int64)
    everyone = np.arange(len(nearest))
    for voter in nearest.T:
        votes[state[voter], everyone] += 1
    return votes.argmax(axis=0)


class Neighbourhood:
    """The most frequent state of the nearest samples, at any place on a surface.

    Samples on the other side of a thin wing count as farther than any on the same side.
    """

    def __init__(self, states: SurfaceStates, size_m: float) -> None:
        self._state = states.state
        self._apart = 0.04 * size_m if states.normals is not None else 0.0
        self._tree = cKDTree(self._key(states.points, states.normals))

    def states(self, points: Floats, normals: Floats | None) -> Ints:
        """State (N,) at points (N, 3), m, with outward normals (N, 3) where the surface has them."""
        return voted(self._state, self.nearest(points, normals))

    def nearest(self, points: Floats, normals: Floats | None) -> Ints:
        """Indices (N, K) of the nearest samples."""
        if self._apart and normals is None:
            normals = np.zeros_like(points)
        count = min(_VOTES, len(self._state))
        _, indices = self._tree.query(self._key(points, normals), k=[*range(1, count + 1)])
        return np.asarray(indices)

    def _key(self, points: Floats, normals: Floats | None) -> Floats:
        if not self._apart or normals is None:
            return points
        return np.concatenate([points, self._apart * normals], axis=1)


def structure_data(structure: Structure, mesh: DisplayMesh) -> dict[str, Any]:
    """A structure's display mesh for a page; coordinates are relative to `origin`."""
    vertices, triangles = mesh.vertices, mesh.triangles
    origin = ((vertices.min(axis=0) + vertices.max(axis=0)) / 2).round(3)
    index = triangles.astype(np.uint16 if len(vertices) < 65536 else np.uint32)
    data = {"id": structure.structure_id, "kind": structure.kind, "origin": origin.tolist()}
    data |= {"size_m": np.ptp(structure.vertices, axis=0).round(2).tolist()}
    data |= {"findings": "; ".join(map(str, from_json(structure.verdicts_json)))}
    return data | {"vertices": packed((vertices - origin).astype(np.float32)), "triangles": packed(index)}


def packed(array: np.ndarray) -> dict[str, str]:
    """An array as its type and base64 of its little-endian bytes, row by row."""
    plain = np.ascontiguousarray(array)
    little = plain.astype(plain.dtype.newbyteorder("<"))
    return {"type": little.dtype.str.lstrip("<|"), "data": base64.b64encode(little.tobytes()).decode()}


def ply_bytes(vertices: Floats, triangles: Ints, normals: Floats | None = None) -> bytes:
    """A binary PLY in double precision: vertices (V, 3), m, triangles (T, 3), and normals (V, 3)."""
    names = ("x", "y", "z") if normals is None else ("x", "y", "z", "nx", "ny", "nz")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {name}" for name in names]
    if len(triangles):
        head += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    rows = vertices if normals is None else np.hstack([vertices, normals])
    faces = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    text = "\n".join([*head, "end_header", ""]).encode()
    return text + np.ascontiguousarray(rows, "<f8").tobytes() + faces.tobytes()
