"""Directions, normals and areas, and how far points are spaced: numpy on plain arrays."""

from __future__ import annotations

import numpy as np

from upplied.records import Floats, Ints

_AT_ONCE = 128  # points whose coordinates are compared at a time: numpy is slow where it compares three


def sphere(number: int) -> Floats:
    """Unit directions (number, 3), spread evenly over the sphere on a Fibonacci spiral from the top."""
    index = np.arange(number) + 0.5
    height = 1 - 2 * index / number
    turn = np.pi * (1 + np.sqrt(5)) * index
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])


def bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates (3,) of points (N, 3)."""
    many = len(points) // _AT_ONCE * _AT_ONCE
    if many == 0:
        return points.min(axis=0), points.max(axis=0)
    rows = np.ascontiguousarray(points[:many]).reshape(-1, 3 * _AT_ONCE)
    low, high = rows.min(axis=0).reshape(-1, 3), rows.max(axis=0).reshape(-1, 3)
    rest = points[many:]
    return np.concatenate([low, rest]).min(axis=0), np.concatenate([high, rest]).max(axis=0)


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
    scaled = normals / scale
    return np.asarray(scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-12))


def with_normals(points: Floats, normals: Floats, weight_m: float) -> Floats:
    """Points beside their normals (N, 6), these times a weight: what faces another way is farther."""
    return np.concatenate([points, weight_m * normals], axis=1)


def neighbour_spacing(points: Floats, asked: Floats | None = None) -> float:
    """Median distance of points (N, 3), or of some of them, to the nearest other one; 0 for a single one."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return 0.0
    return float(np.median(cKDTree(points).query(points if asked is None else asked, k=2)[0][:, 1]))
