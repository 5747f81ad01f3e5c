"""PLY files of meshes and clouds."""

from __future__ import annotations

import numpy as np

from upplied.records import Floats, Ints


def ply_bytes(vertices: Floats, triangles: Ints, normals: Floats | None = None) -> bytes:
    """A binary PLY in double precision: vertices (V, 3), m, triangles (T, 3), and normals (V, 3)."""
    names = ("x", "y", "z") if normals is None else ("x", "y", "z", "nx", "ny", "nz")
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property double {name}" for name in names),
    ]
    if len(triangles):
        head += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    rows = vertices if normals is None else np.hstack([vertices, normals])
    faces = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    text = "\n".join([*head, "end_header", ""]).encode()
    return text + np.ascontiguousarray(rows, "<f8").tobytes() + faces.tobytes()
