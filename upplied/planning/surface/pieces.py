"""From the pieces that a mesh is made of to the parts of its surface.

Real meshes come in a hundred pieces and more, cut where it suited the modeller. Small pieces join
their neighbours and pieces of one compact body (the front and the rear of a nacelle) each other.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.planning.constants import COMPACT, SAME_SIZE
from upplied.records import Floats, Ints, Structure

_WELDED_M = 5e-3  # what is nearer was drawn as one place: no structure has joints as narrow
_WELDS = 8  # vertices, at most, to which one is welded
_SMALLEST = 0.003  # share of the surface below which a piece joins its neighbour
_MANY = 40  # pieces; a mesh of fewer keeps small ones too, down to this many samples
_LEAST_SAMPLES = 6
CONTACT = 0.015  # of the diagonal: pieces this close touch, and a surface lies on its mirror image
_TOUCHING = 0.15  # least share of the smaller piece that touches the other, to be one body with it


def mesh_pieces(structure: Structure) -> Ints:
    """The connected piece of each triangle (T,); vertices that lie within `_WELDED_M` are one."""
    places, corners = np.unique(structure.vertices, axis=0, return_inverse=True)
    triangles = corners.reshape(-1)[structure.triangles]
    near = cKDTree(places).query(places, k=min(_WELDS + 1, len(places)), distance_upper_bound=_WELDED_M)[1]
    near = near.reshape(len(places), -1)
    one, other = np.nonzero(near < len(places))
    edges = np.concatenate([triangles[:, :2], triangles[:, 1:], np.column_stack([one, near[one, other]])])
    graph = coo_matrix((np.ones(len(edges), bool), tuple(edges.T)), shape=(len(places),) * 2)
    return np.asarray(connected_components(graph, directed=False)[1][triangles[:, 0]], np.int64)


def part_labels(points: Floats, area: Floats, piece: Ints) -> Ints:
    """The part (N,) of each sample, from the mesh's piece it lies on; 0 has the largest area."""
    label = joined_small(points, area, piece)
    return by_size(area, _joined_bodies(points, area, label))


def by_size(area: Floats, label: Ints) -> Ints:
    """The same parts (N,), numbered from the one with the largest area."""
    size = np.bincount(label, weights=area)
    rank = np.empty(len(size), np.int64)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
    return rank[label]


def corners_of(points: Floats, label: Ints) -> tuple[Floats, Floats]:
    """Lower and upper corners (K, 3) of the boxes of labelled points; every label up to K - 1 has some."""
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(int(label.max()) + 1))
    return np.minimum.reduceat(points[order], first, axis=0), np.maximum.reduceat(
        points[order], first, axis=0
    )


def joined_small(points: Floats, area: Floats, label: Ints) -> Ints:
    """Parts (N,), 0 .. K - 1, where those that are too small to be one joined what lies nearest to them."""
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    share = np.bincount(label, weights=area) / area.sum()
    keep = share >= _SMALLEST if len(share) > _MANY else np.bincount(label) >= _LEAST_SAMPLES
    large = keep[label]
    if large.all() or not large.any():
        return label
    nearest = label[large][cKDTree(points[large]).query(points[~large])[1]]
    joined = label.copy()
    for piece in np.flatnonzero(~keep):
        mine = label[~large] == piece
        if mine.any():
            joined[label == piece] = np.bincount(nearest[mine]).argmax()
    return np.unique(joined, return_inverse=True)[1].reshape(-1)


def _joined_bodies(points: Floats, area: Floats, label: Ints) -> Ints:
    """Parts (N,) where pieces of one compact body became one: the halves of a nacelle, and its pylon.

    The piece with more surface first, and the pieces that touch it most; one that makes it wider along two
    axes, a flap beside the nacelle, is another body.
    """
    number = int(label.max()) + 1
    if number < 3:
        return label
    most = COMPACT * np.linalg.norm(np.ptp(points, axis=0))
    low, high = corners_of(points, label)
    size = np.bincount(label, weights=area)
    near, count = contacts_of(near_others(points, label), label)
    of_smaller = near / np.minimum(count[:, None], count[None, :])
    touching = np.maximum(of_smaller, of_smaller.T)  # both ways: the smaller one's share counts
    body, compact = np.arange(number), (high - low).max(axis=1) < most
    for one in np.argsort(-size, kind="stable"):
        if not compact[one] or body[one] != one:
            continue
        for other in np.argsort(-touching[one], kind="stable"):
            if other == one or not compact[other] or body[other] != other or touching[one, other] < _TOUCHING:
                continue
            both = np.minimum(low[one], low[other]), np.maximum(high[one], high[other])
            wider = (both[1] - both[0]) > SAME_SIZE * (high[one] - low[one])
            if wider.sum() <= 1 and (both[1] - both[0]).max() < most:
                body[other] = one
                low[one], high[one] = both
    return np.asarray(np.unique(body[label], return_inverse=True)[1].reshape(-1), np.int64)


def contacts_of(pairs: Ints, label: Ints) -> tuple[Ints, Ints]:
    """How many samples of each part (row) come near each other part (column), and samples per part.

    `pairs` (P, 2) are samples of different parts that come near each other.
    """
    number = int(label.max()) + 1
    both = np.concatenate([pairs, pairs[:, ::-1]])
    sample_and_part = np.unique(both[:, 0] * number + label[both[:, 1]])
    owner, other = label[sample_and_part // number], sample_and_part % number
    near = np.bincount(owner * number + other, minlength=number * number).reshape(number, number)
    return near, np.bincount(label, minlength=number)


def near_others(points: Floats, label: Ints) -> Ints:
    reach = CONTACT * np.linalg.norm(np.ptp(points, axis=0))
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    return np.asarray(pairs[label[pairs[:, 0]] != label[pairs[:, 1]]], np.int64)
