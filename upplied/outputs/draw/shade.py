"""Light on surface: smooth normals, a sun over the viewer's shoulder, and ambient occlusion."""

from __future__ import annotations

import numpy as np

from upplied.geometry.scene import Scene
from upplied.geometry.vectors import area_vectors, sphere
from upplied.records import Floats, Ints

_CREASE_COS = np.cos(np.radians(40.0))  # sharper edges stay edges
_SMOOTHED_TRIANGLES = 150_000  # finer meshes look smooth without
_AMBIENT_RAYS = 16


def corner_normals(vertices: Floats, triangles: Ints) -> Floats:
    """A normal (T, 3, 3) for each corner: the mean of the faces around it that meet without a crease.

    The winding may be inconsistent, as in half of real meshes: a neighbour counts with the sign that agrees
    with the face itself.
    """
    edges = vertices[triangles]
    weighted = area_vectors(edges)
    area = np.linalg.norm(weighted, axis=1, keepdims=True)
    face = weighted / np.maximum(area, 1e-300)
    if not 0 < len(triangles) <= _SMOOTHED_TRIANGLES:
        return np.repeat(face[:, None], 3, axis=1)
    _, place = np.unique(np.round(vertices, 5), axis=0, return_inverse=True)
    first, second = _pairs_sharing(place.reshape(-1)[triangles].reshape(-1))
    agree = np.einsum("ij,ij->i", face[first // 3], face[second // 3])
    smooth = np.abs(agree) > _CREASE_COS
    first, second, sign = first[smooth], second[smooth], np.sign(agree[smooth])
    contribution = weighted[second // 3] * sign[:, None]
    count = 3 * len(triangles)
    total = np.stack([np.bincount(first, part, minlength=count) for part in contribution.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    own = np.repeat(face, 3, axis=0)
    return np.where(length > 1e-300, total / np.maximum(length, 1e-300), own).reshape(-1, 3, 3)


def _pairs_sharing(place: Ints, most: int = 24) -> tuple[Ints, Ints]:
    """All ordered pairs of corners at the same place; at a crowded place each meets its next `most`."""
    order = np.argsort(place, kind="stable")
    ranked = place[order]
    count = np.bincount(ranked)
    begin = np.concatenate([[0], np.cumsum(count)[:-1]])
    degree = count[ranked]
    reach = np.minimum(degree, most)
    first = np.repeat(np.arange(len(order)), reach)
    step = np.arange(len(first)) - np.repeat(np.cumsum(reach) - reach, reach)
    start = begin[ranked[first]]
    second = start + (first - start + step) % degree[first]
    return order[first], order[second]


def smooth_normals(vertices: Floats, triangles: Ints, normals: Floats, hit: Ints, points: Floats) -> Floats:
    """Normals (N, 3) at points (N, 3) on the triangles `hit` (N,), interpolated from the corners."""
    a, b, c = (vertices[triangles[hit, corner]] for corner in range(3))
    to_b, to_c, to_p = b - a, c - a, points - a
    bb, bc, cc = (np.einsum("ij,ij->i", x, y) for x, y in ((to_b, to_b), (to_b, to_c), (to_c, to_c)))
    pb, pc = (np.einsum("ij,ij->i", to_p, y) for y in (to_b, to_c))
    area = np.maximum(bb * cc - bc * bc, 1e-300)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1)
    mixed = np.einsum("nk,nkj->nj", weights, normals[hit])
    return mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-12)


def lit(colours: Floats, normals: Floats, towards_eye: Floats, up: Floats, ambient: Floats) -> Floats:
    """Colours (N, 3) under a sun above the viewer's left shoulder and a bright sky.

    Normals (N, 3) point to the viewer's side; `ambient` (N,) is the share of the sky that is open, 0 .. 1.
    """
    sun = towards_eye + 0.9 * up + 0.7 * np.cross(towards_eye, up)
    sun /= np.linalg.norm(sun)
    direct = np.clip(normals @ sun, 0, 1)
    sky = 0.5 + 0.5 * normals[:, 2]
    strength = (0.34 + 0.24 * sky) * (0.35 + 0.65 * ambient) + 0.50 * direct * (0.6 + 0.4 * ambient)
    return np.clip(colours * strength[:, None], 0, 1)


def open_sky(scene: Scene, points: Floats, normals: Floats, reach_m: float, lift_m: float) -> Floats:
    """Share (N,) of the directions around each normal in which nothing stands within reach.

    The same directions serve every point, so that the result carries no noise.
    """
    blocked, weight = np.zeros(len(points)), np.zeros(len(points))
    for direction in sphere(2 * _AMBIENT_RAYS):
        cosine = normals @ direction
        above = np.flatnonzero(cosine > 0.1)
        starts = points[above] + lift_m * normals[above]
        weight[above] += cosine[above]
        blocked[above] += cosine[above] * scene.occluded(starts, starts + reach_m * direction, slack=0.0)
    return 1 - blocked / np.maximum(weight, 1e-12)
