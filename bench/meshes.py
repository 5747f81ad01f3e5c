"""Loading and cleaning a mesh of a million triangles, against trimesh's and Open3D's own readers.

Each format is read three ways in one run: ours (`read_structure`: parsed, welded, cleaned, patches
judged by rays, outliers sought), ours without the rays, and the two libraries with their own cleaning
(merged vertices, degenerate and duplicate triangles removed). CPU seconds, since wall time depends
on who else computes.

    python bench/meshes.py [TRIANGLES]
"""

from __future__ import annotations

import logging
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from upplied.geometry.scene import open3d
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.inputs.repair import clean

FORMATS = ("ply", "stl", "glb", "obj")


def sphere_of(triangles: int) -> trimesh.Trimesh:
    """A bumpy closed surface of about so many triangles, 60 m long."""
    side = int(np.sqrt(triangles / 2))
    u, v = np.meshgrid(*(np.linspace(0, 2 * np.pi, side, endpoint=False),) * 2, indexing="ij")
    radius = 5 + 0.3 * np.sin(9 * u) * np.cos(7 * v)
    points = np.stack(
        [(25 + radius * np.cos(v)) * np.cos(u), (25 + radius * np.cos(v)) * np.sin(u), radius * np.sin(v)]
    )
    i, j = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    here, right = i * side + j, i * side + (j + 1) % side
    up, across = (i + 1) % side * side + j, (i + 1) % side * side + (j + 1) % side
    faces = np.stack([here, up, across, here, across, right], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(points.reshape(3, -1).T, faces, process=False)


def by_trimesh(path: Path) -> int:
    """Read by trimesh, vertices merged, degenerate and duplicate triangles removed."""
    mesh = trimesh.load_mesh(path, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    return len(mesh.faces)


def by_open3d(path: Path) -> int:
    """The same by Open3D."""
    mesh = open3d().io.read_triangle_mesh(str(path))
    mesh.remove_duplicated_vertices()
    mesh.remove_degenerate_triangles()
    mesh.remove_duplicated_triangles()
    mesh.remove_unreferenced_vertices()
    return len(mesh.triangles)


def ours(path: Path) -> int:
    """All that ingesting a structure does, the votes of the rays included."""
    return len(read_structure(StructureEntry("a", "torus", path, 1.0)).triangles)


def ours_without_rays(path: Path) -> int:
    """What the others do: read, weld, clean."""
    raw, _ = read_raw(path)
    return len(clean(raw.vertices, raw.triangles)[1])


def seconds(function: Callable[[Path], int], path: Path, expected: int) -> float:
    """CPU seconds of the better of two runs."""
    best = np.inf
    for _ in range(2):
        start = time.process_time()
        count = function(path)
        best = min(best, time.process_time() - start)
        if count != expected:
            print(f"    {function.__name__}: {count} triangles instead of {expected}")
    return best


def main() -> None:
    """Print the table."""
    logging.disable(logging.ERROR)
    mesh = sphere_of(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
    ways = (ours_without_rays, by_trimesh, by_open3d, ours)
    print(f"{len(mesh.faces)} triangles, CPU seconds (ratio to trimesh, to Open3D)")
    print(f"{'':6}" + "".join(f"{way.__name__:>26}" for way in ways))
    with tempfile.TemporaryDirectory() as folder:
        for suffix in FORMATS:
            path = Path(folder) / f"mesh.{suffix}"
            mesh.export(path)
            took = [seconds(way, path, len(mesh.faces)) for way in ways]
            cells = [f"{t:.2f} ({t / took[1]:.2f}, {t / took[2]:.2f})" for t in took]
            print(f"{suffix:6}" + "".join(f"{cell:>26}" for cell in cells))


if __name__ == "__main__":
    main()
