"""Polygons into triangles: quads along the better diagonal, concave ones by cutting ears."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.records import Bools, Floats, Ints

_MAX_EARS = 256  # corners; cutting ears takes their cube at worst


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
        made = rings[:, None] if size == 3 else _split(vertices, rings)
        triangles.append(made.reshape(-1, 3))
        polygons.append(np.repeat(which, size - 2))
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(triangles)[order], polygon[order]


def _split(vertices: Floats, rings: Ints) -> Ints:
    """Triangles (P, size - 2, 3) of polygons of one size."""
    size = rings.shape[1]
    fan = np.stack([np.zeros(size - 2, int), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    made = rings[:, fan]
    points = vertices[rings]
    concave = np.flatnonzero(~_convex(points))
    if size == 4:
        # The other diagonal starts at the corner that points inwards.
        made[concave] = rings[concave][:, [[1, 2, 3], [1, 3, 0]]]
        worse = concave[_convex_fan(points[concave]) > _convex_fan(points[concave][:, [1, 2, 3, 0]])]
        made[worse] = rings[worse][:, fan]
    elif size <= _MAX_EARS:
        for index in concave:
            made[index] = rings[index][_ears(_flattened(points[index]))]
    return made


def _newell(points: Floats) -> Floats:
    """Normals (P, 3) of polygons (P, n, 3), as long as twice their area."""
    centred = points - points[:, :1]
    return np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)


def _convex(points: Floats) -> Bools:
    normal = _newell(points)
    edge = np.roll(points, -1, axis=1) - points
    bend = np.einsum("pnk,pk->pn", np.cross(edge, np.roll(edge, -1, axis=1)), normal)
    return np.asarray((bend >= -1e-9 * (normal**2).sum(axis=1)[:, None]).all(axis=1), bool)


def _convex_fan(points: Floats) -> Floats:
    """How well the two triangles of a fan over a quad agree with its normal: the worse of the two."""
    normal = _newell(points)
    a, b, c, d = (points[:, corner] for corner in range(4))
    agree = [(np.cross(q - p, r - p) * normal).sum(axis=1) for p, q, r in ((a, b, c), (a, c, d))]
    return np.minimum(*agree)


def _flattened(points: Floats) -> Floats:
    """The polygon (n, 2) seen along its normal, counter-clockwise."""
    normal = _newell(points[None])[0]
    drop = int(np.argmax(np.abs(normal)))
    keep = [(drop + 1) % 3, (drop + 2) % 3]
    flat = np.ascontiguousarray((points - points[0])[:, keep])
    if normal[drop] < 0:
        flat[:, 0] *= -1
    return flat


@njit(cache=True)
def _ears(flat: np.ndarray) -> np.ndarray:  # pragma: no cover - compiled
    """Triangles (n - 2, 3) of a counter-clockwise polygon (n, 2); cuts any corner where no ear is left."""
    n = len(flat)
    left = np.arange(n)
    count = n
    made = np.empty((n - 2, 3), np.int64)
    for step in range(n - 2):
        best = 0
        for at in range(count):
            i, j, k = left[at - 1] if at else left[count - 1], left[at], left[(at + 1) % count]
            ax, ay = flat[i]
            bx, by = flat[j]
            cx, cy = flat[k]
            if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) <= 0:
                continue
            clear = True
            for other in range(count):
                o = left[other]
                if o in (i, j, k):
                    continue
                px, py = flat[o]
                if (px == ax and py == ay) or (px == bx and py == by) or (px == cx and py == cy):
                    continue  # the seam of a hole runs through the same place twice
                if (
                    (bx - ax) * (py - ay) - (by - ay) * (px - ax) >= 0
                    and (cx - bx) * (py - by) - (cy - by) * (px - bx) >= 0
                    and (ax - cx) * (py - cy) - (ay - cy) * (px - cx) >= 0
                ):
                    clear = False
                    break
            if clear:
                best = at
                break
        made[step, 0] = left[best - 1] if best else left[count - 1]
        made[step, 1] = left[best]
        made[step, 2] = left[(best + 1) % count]
        for other in range(best, count - 1):
            left[other] = left[other + 1]
        count -= 1
    return made
