"""How the triangles of a mesh hang together: edges, patches of one winding, components."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from upplied.records import Ints, Record


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
    return Topology(
        patch=_labels(one[alike] // 3, other[alike] // 3, len(triangles)),
        component=_components(triangles),
        boundary_edges=int((count == 1).sum()),
        rim=np.unique(np.append(tail[order[first[count == 1]]], head[order[first[count == 1]]])),
        nonmanifold_edges=int((count > 2).sum()),
        twisted_edges=int((~alike).sum()),
    )


def _components(triangles: Ints) -> Ints:
    number = triangles.max(initial=-1) + 1
    label = _labels(triangles[:, [0, 0]].ravel(), triangles[:, [1, 2]].ravel(), number)[triangles[:, 0]]
    return np.unique(label, return_inverse=True)[1].reshape(-1)


def _labels(one: Ints, other: Ints, number: int) -> Ints:
    graph = coo_array((np.ones(len(one), bool), (one, other)), shape=(number, number))
    return connected_components(graph, directed=False)[1].astype(np.int64)
