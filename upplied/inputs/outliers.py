"""Parts of a mesh that are hardly the structure: far from the rest, or lone planes that stick out.

A wake makes a 251 m ship 872 m long. They are reported, and dropped only where the manifest says so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from upplied.inputs.repair import Topology, used_vertices
from upplied.records import Bools, Floats, Ints, Record

_VOXELS = 50  # along the longest side: a gap of a fiftieth parts two clusters
_SAMPLES = 10_000_000  # on large triangles, in all
_BATCH = 200_000
_SMALL = 0.05  # of the volume of the main cluster's box
_STICKS_OUT = 0.03  # of the diagonal of the rest's box
_FLAT = 1e-5  # thickness over length: a plane but for rounding
_BILLBOARD_TRIANGLES = 32  # triangles of a billboard


@dataclass(frozen=True, eq=False, repr=False)
class Outlier(Record):
    """Triangles that stick far out of the box of all the others."""

    reason: str
    triangles: Ints  # (K,) which they are
    low_m: Floats  # (3,) corners of their box, structure frame
    high_m: Floats  # (3,)

    def __str__(self) -> str:
        size, centre = self.high_m - self.low_m, (self.low_m + self.high_m) / 2
        where = f"{_metres(size)}, around ({_metres(centre, ', ')})"
        return f"{self.reason}: {len(self.triangles)} triangles, {where}"


def find_outliers(vertices: Floats, triangles: Ints, topology: Topology) -> list[Outlier]:
    """Planes of few triangles that stick out of all else, and clusters far off the main one.

    The planes come first: a wake that trebles the box would hide a gap in it.
    """
    component = topology.component
    flat, planes = _flat(vertices, triangles, component), np.empty(0, np.int64)
    if not flat.all():  # flat components that stick out of the box of those that are not flat
        low, high = _box(vertices, triangles[~flat[component]])
        lows, highs = _boxes(vertices, triangles, component)
        beyond = np.maximum(low - lows, highs - high).max(axis=1)
        planes = np.flatnonzero(flat & (beyond > _STICKS_OUT * np.linalg.norm(high - low)))
    rest = np.flatnonzero(~np.isin(component, planes))
    cluster = _clusters(vertices, triangles[rest])
    labels = np.unique(cluster)  # far are those that are small beside the main one and stick out of its box
    low, high = _boxes(vertices, triangles[rest], np.searchsorted(labels, cluster))
    side = high - low
    volume = np.prod(np.maximum(side, 1e-3 * side.max(axis=1, keepdims=True)), axis=1)
    main = int(np.argmax(volume))
    beyond = np.maximum(low[main] - low, high - high[main]).max(axis=1)
    sticks_out = beyond > _STICKS_OUT * np.linalg.norm(side[main])
    far = [rest[cluster == label] for label in labels[(volume < _SMALL * volume[main]) & sticks_out]]
    lone = [np.flatnonzero(component == label) for label in planes]
    plane = "a plane that sticks out (a wake, a light, a billboard?)"
    named = [*((plane, which) for which in lone), *(("a part far off the rest", which) for which in far)]
    return [Outlier(words, which, *_box(vertices, triangles[which])) for words, which in named]


def _clusters(vertices: Floats, triangles: Ints) -> Ints:
    """A label of each triangle (T,): voxels that touch make a cluster."""
    low, high = _box(vertices, triangles)
    edge = max(float((high - low).max()), 1e-9) / _VOXELS

    def cells(points: Floats) -> tuple[Ints, ...]:
        return tuple(np.clip(np.floor((points - low) / edge), 0, _VOXELS).astype(np.int64).T)

    grid = np.zeros((_VOXELS + 1,) * 3, bool)
    for points in (vertices[used_vertices(triangles, len(vertices))], *_spread(vertices, triangles, edge)):
        grid[cells(points)] = True
    label, _ = ndimage.label(grid, np.ones((3, 3, 3)))
    return label[cells(vertices[triangles[:, 0]])].astype(np.int64)


def _spread(vertices: Floats, triangles: Ints, edge: float) -> Iterator[Floats]:
    """Points on the triangles longer than a voxel, close enough that no voxel between them is missed."""
    corners = vertices[triangles]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, initial=0)
    large, steps = corners[length > edge], np.ceil(2 * length[length > edge] / edge)
    steps *= min(1.0, np.sqrt(2 * _SAMPLES / max((steps**2).sum(), 1)))  # bounded for meshes of giants alone
    steps = np.maximum(steps, 1).astype(np.int64)
    for number in np.unique(steps):
        i, j = np.divmod(np.arange((number + 1) ** 2), number + 1)
        weight = np.stack([i, j, number - i - j], axis=1)[i + j <= number] / number
        chosen = large[steps == number]
        batch = 1 + _BATCH // len(weight)
        for at in range(0, len(chosen), batch):
            yield np.einsum("wk,tkx->twx", weight, chosen[at : at + batch]).reshape(-1, 3)


def _flat(vertices: Floats, triangles: Ints, component: Ints) -> Bools:
    """(C,) components of few triangles in one plane."""
    number = component.max(initial=-1) + 1
    flat = np.bincount(component, minlength=number) <= _BILLBOARD_TRIANGLES
    few = flat[component]
    points, owner = vertices[triangles[few]].reshape(-1, 3), np.repeat(component[few], 3)
    count = np.maximum(np.bincount(owner, minlength=number), 1)
    mean = np.stack([np.bincount(owner, points[:, k], number) for k in range(3)], axis=1) / count[:, None]
    centred = points - mean[owner]
    products = centred[:, [0, 0, 0, 1, 1, 2]] * centred[:, [0, 1, 2, 1, 2, 2]]
    sums = np.stack([np.bincount(owner, products[:, k], number) for k in range(6)], axis=1)
    spread = np.linalg.eigvalsh(sums[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]])
    return flat & (spread[:, 0] <= _FLAT**2 * spread[:, 2])


def _boxes(vertices: Floats, triangles: Ints, label: Ints) -> tuple[Floats, Floats]:
    """Corners (L, 3), low and high, of the box of the triangles of each label from 0, all of which occur."""
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    corners = vertices[triangles[order]]
    return np.minimum.reduceat(corners.min(axis=1), starts), np.maximum.reduceat(corners.max(axis=1), starts)


def _box(vertices: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    points = vertices[triangles].reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)


def _metres(values: Floats, between: str = " x ") -> str:
    return between.join(f"{value:.1f}" for value in values) + (" m" if between == " x " else "")
