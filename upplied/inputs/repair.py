"""How triangles hang together, and repair: weld, drop what has no area, stands twice or is not used."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numba import njit
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
    chosen = np.flatnonzero(used_vertices(triangles, len(vertices)))
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
    """For each vertex the first kept one within `WELD_M`, (V,); kept ones lie farther from each other."""
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
    order = np.lexsort((rows := np.sort(triangles[intact], axis=1)).T)
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
    """What of a mesh lies above a height, left open: vertices, triangles (U, 3), and from which each is."""
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
