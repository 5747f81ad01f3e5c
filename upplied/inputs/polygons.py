"""Polygons into triangles: convex ones as fans, all at once; others by cutting ears (mapbox-earcut)."""

from __future__ import annotations

import numpy as np

from upplied.records import Bools, Floats, Ints

MAX_CORNERS = 10_000  # of one polygon; cutting ears takes their square at worst: a second for this many


def triangulate(vertices: Floats, corners: Ints, sizes: Ints) -> tuple[Ints, Ints]:
    """Triangles of planar polygons, winding kept; polygons of less than three corners give none.

    Parameters
    ----------
    vertices : array, shape (V, 3)
    corners : array, shape (sum of sizes,)
        Vertex indices, polygon after polygon; each must exist.
    sizes : array, shape (P,)

    Returns
    -------
    triangles : array, shape (T, 3)
    polygon : array, shape (T,)
        The polygon of each triangle; never decreases.
    """
    first = np.cumsum(sizes) - sizes
    triangles, polygons = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        rings = corners[first[which, None] + np.arange(size)]
        points = vertices[rings]
        convex = np.ones(len(rings), bool) if size == 3 else _convex(points)
        step = np.arange(1, size - 1)
        fans = np.stack([np.zeros_like(step), step, step + 1], axis=1)
        triangles.append(rings[convex][:, fans].reshape(-1, 3))
        polygons.append(np.repeat(which[convex], size - 2))
        for index in np.flatnonzero(~convex):
            cut = rings[index][_ears(points[index])]
            triangles.append(cut)
            polygons.append(np.full(len(cut), which[index]))
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(triangles)[order], polygon[order]


def _newell(points: Floats) -> Floats:
    """Normals (P, 3) of polygons (P, n, 3), as long as twice their area."""
    centred = points - points[:, :1]
    return np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)


def _convex(points: Floats) -> Bools:
    normal = _newell(points)
    edge = np.roll(points, -1, axis=1) - points
    bend = np.einsum("pnk,pk->pn", np.cross(edge, np.roll(edge, -1, axis=1)), normal)
    return np.asarray((bend >= -1e-9 * (normal**2).sum(axis=1)[:, None]).all(axis=1), bool)


def _ears(points: Floats) -> Ints:
    """Triangles (n - 2, 3) of one polygon (n, 3), seen along its normal; fewer where corners coincide."""
    import mapbox_earcut

    normal = _newell(points[None])[0]
    drop = int(np.argmax(np.abs(normal)))
    flat = np.ascontiguousarray((points - points[0])[:, [(drop + 1) % 3, (drop + 2) % 3]])
    if normal[drop] < 0:
        flat[:, 0] *= -1  # counter-clockwise
    rings = np.array([len(flat)], np.uint32)
    cut = mapbox_earcut.triangulate_float64(flat, rings).reshape(-1, 3).astype(np.int64)
    side, other = flat[cut[:, 1]] - flat[cut[:, 0]], flat[cut[:, 2]] - flat[cut[:, 0]]
    turned = (side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]).sum() < 0
    return cut[:, ::-1] if turned else cut
