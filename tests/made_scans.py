"""A body of one piece, and scans of it that lack an end."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from upplied.geometry.scene import open3d
from upplied.records import Structure

END = 4.0  # m: what lies further along x was not scanned


@cache
def body() -> Structure:
    """A closed body, 14 by 4 by 3 m, with a wing on each side and two fins on top."""
    shapes = open3d().geometry.TriangleMesh
    whole = shapes.create_box(14.0, 4.0, 3.0).translate((-7, -2, 0))
    wing = shapes.create_box(2.0, 10.0, 0.8).translate((-5, -5, 1))
    both = (
        open3d()
        .t.geometry.TriangleMesh.from_legacy(whole)
        .boolean_union(open3d().t.geometry.TriangleMesh.from_legacy(wing))
    )
    mesh = both.to_legacy().subdivide_midpoint(5)
    mesh.merge_close_vertices(1e-6)
    return Structure("body", "tank", np.asarray(mesh.vertices), np.asarray(mesh.triangles, np.int64))


def cut(structure: Structure, first: float = END, last: float = np.inf) -> Structure:
    """A scan, exact, that lacks what lies between two places along x."""
    middle = structure.vertices[structure.triangles][:, :, 0].mean(axis=1)
    far = (middle > first) & (middle < last)
    used, triangles = np.unique(structure.triangles[~far], return_inverse=True)
    exact = replace(structure, surface="scanned", surface_error_m=0.0)
    return replace(exact, vertices=structure.vertices[used], triangles=triangles.reshape(-1, 3))


def as_cloud(structure: Structure, number: int = 60_000) -> Structure:
    geometry, utility = open3d().geometry, open3d().utility
    mesh = geometry.TriangleMesh(
        utility.Vector3dVector(structure.vertices), utility.Vector3iVector(structure.triangles)
    )
    utility.random.seed(1)
    points = mesh.sample_points_uniformly(number, use_triangle_normal=True)
    return replace(
        structure,
        vertices=np.asarray(points.points),
        triangles=np.empty((0, 3), np.int64),
        normals=np.asarray(points.normals),
        surface_error_m=None,
    )
