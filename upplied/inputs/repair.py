"""Repair without judgement: weld, drop what has no area or stands twice, drop what nothing uses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Bools, Floats, Ints

WELD_M = 1e-4  # a tenth of a millimetre: far below any detail that is flown, far above rounding


@dataclass(frozen=True)
class Repairs:
    """How much was repaired, by kind."""

    welded: int = 0  # vertices that lay on another
    degenerate: int = 0  # triangles without area
    duplicate: int = 0  # triangles with the corners of another
    unused: int = 0  # vertices of no triangle

    def texts(self) -> tuple[str, ...]:
        """Each kind that occurred, in words."""
        found = (
            (self.welded, "vertices welded"),
            (self.degenerate, "triangles without area removed"),
            (self.duplicate, "repeated triangles removed"),
            (self.unused, "unused vertices dropped"),
        )
        return tuple(f"{count} {what}" for count, what in found if count)


def clean(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints, Ints, Repairs]:
    """A mesh whose triangles share vertices, have area, and stand once.

    Parameters
    ----------
    vertices : array, shape (V, 3), m
    triangles : array, shape (T, 3)

    Returns
    -------
    vertices : array, shape (W, 3), m
        In the order of the input.
    triangles : array, shape (U, 3)
        In the order of the input, winding kept.
    kept : array, shape (U,)
        Which triangles of the input they are.
    repairs : Repairs
    """
    used = np.zeros(len(vertices), bool)
    used[triangles] = True
    first = weld(vertices, used)
    joined = first[triangles]
    degenerate = _degenerate(vertices, joined)
    duplicate = _duplicate(joined) & ~degenerate
    kept = np.flatnonzero(~degenerate & ~duplicate)
    vertices, triangles = compact(vertices, joined[kept])
    welded = int((first[used] != np.flatnonzero(used)).sum())
    repairs = Repairs(welded, int(degenerate.sum()), int(duplicate.sum()), int((~used).sum()))
    return vertices, triangles, kept, repairs


def weld(vertices: Floats, used: Bools | None = None) -> Ints:
    """For each vertex the first one that it lies on, (V,); itself where it stands alone."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    chosen = np.arange(len(vertices)) if used is None else np.flatnonzero(used)
    _, index, inverse = np.unique(vertices[chosen], axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(vertices[chosen][index]).query_pairs(WELD_M, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(index),) * 2)
    _, label = connected_components(graph, directed=False)
    label = label[inverse.reshape(-1)]
    lowest = np.full(label.max(initial=-1) + 1, len(vertices))
    np.minimum.at(lowest, label, chosen)
    first = np.arange(len(vertices))
    first[chosen] = lowest[label]
    return first


def compact(vertices: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Only the vertices that a triangle uses, in their order."""
    used = np.zeros(len(vertices), bool)
    used[triangles] = True
    return vertices[used], (np.cumsum(used) - 1)[triangles]


def _degenerate(vertices: Floats, triangles: Ints) -> Bools:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.sqrt(np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0))
    same = (
        (triangles[:, 0] == triangles[:, 1])
        | (triangles[:, 1] == triangles[:, 2])
        | (triangles[:, 2] == triangles[:, 0])
    )
    # A sliver whose height is rounding noise has no normal either.
    return same | (twice_area <= longest * 1e-9)


def _duplicate(triangles: Ints) -> Bools:
    """Triangles with the corners of an earlier one, whatever their winding."""
    if not len(triangles):
        return np.zeros(0, bool)
    a, b, c = np.sort(triangles, axis=1).T
    order = np.lexsort((np.arange(len(triangles)), c, b, a))
    same = (a[order][1:] == a[order][:-1]) & (b[order][1:] == b[order][:-1]) & (c[order][1:] == c[order][:-1])
    duplicate = np.zeros(len(triangles), bool)
    duplicate[order[1:][same]] = True
    return duplicate


def clip_below(vertices: Floats, triangles: Ints, z_m: float) -> tuple[Floats, Ints, Ints]:
    """What of a mesh lies above a height; the cut stays open.

    Returns
    -------
    vertices : array, shape (W, 3), m
    triangles : array, shape (U, 3)
    kept : array, shape (U,)
        The triangle of the input that each is, or is cut from.
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
    made, kept = (np.concatenate(column) for column in zip(*pieces, strict=True))
    order = np.argsort(kept, kind="stable")
    left, joined = compact(np.concatenate([vertices, crossing]), made[order])
    return left, joined, kept[order]
