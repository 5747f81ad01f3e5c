"""How the triangles of a mesh hang together, and repair without judgement: weld, drop what has no area,
stands twice or is used by nothing.

Parts that are hardly the structure, far from the rest, or lone planes that stick out, are reported, and
dropped only where the manifest says so: a wake makes a 251 m ship 872 m long.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numba import njit
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.inputs.raw import counted
from upplied.records import Bools, Floats, Ints, Record

WELD_M = 1e-4  # a tenth of a millimetre: far below any detail that is flown, far above rounding


def clean(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints, Ints, tuple[str, ...]]:
    """A mesh whose triangles share vertices, have area, and stand once.

    Returns its vertices (W, 3), m, and triangles (U, 3), in the order of the input and wound alike, which
    triangles of the input they are (U,), and in words how much was repaired.
    """
    used = used_vertices(triangles, len(vertices))
    chosen = np.flatnonzero(used)
    near = weld(vertices[chosen])
    first = np.arange(len(vertices))
    first[chosen] = chosen[near]
    joined = first[triangles]
    fault = _faults(vertices, joined)
    intact = np.flatnonzero(fault == 0)
    repairs = counted(
        (int((near != np.arange(len(near))).sum()), "vertices welded"),
        (int((fault == 1).sum()), "triangles without area removed"),
        (int((fault == 2).sum()), "repeated triangles removed"),
        (len(vertices) - len(chosen), "unused vertices dropped"),
    )
    return *compact(vertices, joined[intact]), intact, repairs


def weld(vertices: Floats) -> Ints:
    """For each vertex the first kept one that it lies on, (V,); itself where it stands alone.

    Kept ones lie farther than `WELD_M` from each other, so doing it twice changes nothing.
    """
    alike = pd.DataFrame(vertices).groupby([0, 1, 2], sort=False).ngroup().to_numpy()
    once = np.unique(alike, return_index=True)[1]
    first = np.arange(len(once))
    if len(once):
        pairs = cKDTree(vertices[once]).query_pairs(WELD_M, output_type="ndarray")
        _join(pairs[np.lexsort(pairs.T)], first)
    return once[first][alike]


@njit(cache=True)
def _join(pairs: np.ndarray, first: np.ndarray) -> None:  # pragma: no cover - compiled
    """Join each point to the first of its pairs, which rise by the later point."""
    for at in range(len(pairs)):
        earlier, later = pairs[at]
        if first[earlier] == earlier and first[later] == later:
            first[later] = earlier


def _faults(vertices: Floats, triangles: Ints) -> Ints:
    """(T,) 1 for triangles as flat as rounding noise, 2 for those with the corners of an earlier one."""
    corners = vertices[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.cross(edges[:, 0], corners[:, 2] - corners[:, 0])
    longest = (edges**2).sum(axis=2).max(axis=1, initial=0)
    # The height over the longest edge, in metres, squared; and relative to that edge.
    fault = np.where((normals**2).sum(axis=1) <= np.maximum(1e-18 * longest, 1e-20 * longest**2), 1, 0)
    intact = np.flatnonzero(fault == 0)
    rows = np.sort(triangles[intact], axis=1)
    order = np.lexsort(rows.T)
    repeated = (np.diff(rows[order], axis=0) == 0).all(axis=1)
    fault[intact[order[1:][repeated]]] = 2
    return fault


def used_vertices(triangles: Ints, number: int) -> Bools:
    """Which of a number of vertices a triangle uses."""
    used = np.zeros(number, bool)
    used[triangles] = True
    return used


def compact(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Only the vertices that a triangle uses, in their order."""
    used = used_vertices(triangles, len(vertices))
    return vertices[used], (np.cumsum(used) - 1)[triangles]


def clip_below(vertices: Floats, triangles: Ints, z_m: float) -> tuple[Floats, Ints, Ints]:
    """What of a mesh lies above a height: vertices, triangles (U, 3), and from which each of them is cut.

    The cut stays open.
    """
    height = vertices[:, 2] - z_m
    above = height[triangles] >= 0
    count = above.sum(axis=1)
    cut = np.flatnonzero((count == 1) | (count == 2))
    # Turn each cut triangle so that its lone corner comes first.
    lone = np.argmax(above[cut] == (count[cut] == 1)[:, None], axis=1)
    a, b, c = triangles[cut[:, None], (lone[:, None] + np.arange(3)) % 3].T
    edges = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([a, c], axis=1)]), axis=1)
    edges, which = np.unique(edges, axis=0, return_inverse=True)
    low, high = height[edges].T
    share = (low / (low - high))[:, None]
    crossing = vertices[edges[:, 0]] * (1 - share) + vertices[edges[:, 1]] * share
    ab, ac = which.reshape(2, -1) + len(vertices)
    tip = count[cut] == 1
    pieces = [
        (triangles[count == 3], np.flatnonzero(count == 3)),
        (np.stack([a, ab, ac], axis=1)[tip], cut[tip]),
        (np.stack([ab, b, c], axis=1)[~tip], cut[~tip]),
        (np.stack([ab, c, ac], axis=1)[~tip], cut[~tip]),
    ]
    cut_triangles, origin = (np.concatenate(column) for column in zip(*pieces, strict=True))
    order = np.argsort(origin, kind="stable")
    left, joined = compact(np.concatenate([vertices, crossing]), cut_triangles[order])
    return left, joined, origin[order]


@dataclass(frozen=True, eq=False, repr=False)
class Topology(Record):
    """Labels of each triangle, and what its edges say."""

    patch: Ints  # (T,) triangles of one label join at edges of two triangles wound alike
    component: Ints  # (T,) triangles of one label join at vertices
    boundary_edges: int  # of one triangle
    nonmanifold_edges: int  # of three and more
    twisted_edges: int  # of two that are wound against each other
    rim: Ints  # vertices of the edges of one triangle

    @property
    def watertight(self) -> bool:
        """Whether every edge has two triangles, wound alike."""
        return not (self.boundary_edges or self.nonmanifold_edges or self.twisted_edges)


def topology_of(triangles: Ints) -> Topology:
    """The topology of welded triangles (T, 3)."""
    tail, head = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    key = low * (triangles.max(initial=0) + 1) + high
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(first, append=len(order))
    pair = first[count == 2]
    one, other = order[pair], order[pair + 1]
    alike = tail[one] != tail[other]
    ends = triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel()
    of_vertex = _labels(*ends, triangles.max(initial=-1) + 1)
    return Topology(
        patch=_labels(one[alike] // 3, other[alike] // 3, len(triangles)),
        component=np.unique(of_vertex[triangles[:, 0]], return_inverse=True)[1].reshape(-1),
        boundary_edges=int((count == 1).sum()),
        rim=np.unique(np.append(tail[order[first[count == 1]]], head[order[first[count == 1]]])),
        nonmanifold_edges=int((count > 2).sum()),
        twisted_edges=int((~alike).sum()),
    )


def _labels(one: Ints, other: Ints, number: int) -> Ints:
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(number, number))
    return connected_components(graph, directed=False)[1].astype(np.int64)


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
