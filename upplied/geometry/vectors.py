"""Directions, normals and areas, how far points are spaced, and points spread evenly over a mesh."""

import numpy as np

from upplied.records import Floats, Ints, Structure


def sphere(number: int) -> Floats:
    """Unit directions (number, 3), spread evenly over the sphere on a Fibonacci spiral from the top."""
    index = np.arange(number) + 0.5
    height = 1 - 2 * index / number
    turn = np.pi * (1 + np.sqrt(5)) * index
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) with length 1; those of none stay as they are."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def across(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit directions (N, 3) across each unit normal (N, 3) and across each other."""
    aside = np.where(np.abs(normals[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(normals, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def area_vectors(corners: Floats) -> Floats:
    """The normal (T, 3) of each triangle (T, 3, 3) as it is wound, twice as long as its area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def plane_normals(points: Floats, nearest: Ints) -> Floats:
    """The normal (K, 3), either way, of the plane through some of the points (N, 3): indices (K, M)."""
    patch = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", patch, patch))[1][:, :, 0])


def scaled_normals(normals: Floats, scale: Floats) -> Floats:
    """Unit normals (N, 3) of a surface after a scaling (3,) along the axes."""
    return unit(normals / scale)


def with_normals(points: Floats, normals: Floats, weight_m: float) -> Floats:
    """Points beside their normals (N, 6), these times a weight: what faces another way is farther."""
    return np.concatenate([points, weight_m * normals], axis=1)


def neighbour_spacing(points: Floats, places: Floats | None = None) -> float:
    """Median distance of points (N, 3), or of some of them, to the nearest other one; 0 for a single one."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return 0.0
    return float(np.median(cKDTree(points).query(points if places is None else places, k=2)[0][:, 1]))


def triangle_areas(structure: Structure) -> Floats:
    """Area (T,) of each triangle of a mesh, m^2; kept with its record."""

    def areas() -> Floats:
        twice = area_vectors(structure.vertices[structure.triangles])
        return np.asarray(np.linalg.norm(twice, axis=1) / 2)

    return structure.derived("triangle areas", areas)


def points_on_triangles(
    structure: Structure, number: int, rng: np.random.Generator, some: Ints | None = None
) -> tuple[Floats, Ints]:
    """Points (number, 3), m, spread evenly by area over a mesh, or some triangles; and on which each lies.

    They are stratified along the cumulated area.
    """
    area = triangle_areas(structure)
    cumulated = np.cumsum(area if some is None else area[some])
    along = (np.arange(number) + rng.random(number)) / number * cumulated[-1]
    triangle = np.minimum(np.searchsorted(cumulated, along, side="right"), len(cumulated) - 1)
    triangle = triangle if some is None else some[triangle]
    chosen = structure.vertices[structure.triangles[triangle]]
    root, second = np.sqrt(rng.random(number))[:, None], rng.random(number)[:, None]
    points = chosen[:, 0] * (1 - root) + root * (chosen[:, 1] * (1 - second) + chosen[:, 2] * second)
    return points, triangle
