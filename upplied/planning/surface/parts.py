"""Parts of a structure: engines, blades, decks, from the pieces that its mesh is made of.

Real meshes come in a hundred pieces and more, cut where it suited the modeller. Small pieces join their
neighbours and pieces of one compact body each other. What there is then is only a proposal:
`correspondence.part_assignment` accepts a part where the other structure has one like it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from upplied.planning.constants import COMPACT, LEAST_PART, MAJORITY, SAME_FACE, SAME_SIZE, SLENDER, TOLERANCE
from upplied.planning.geometry.clouds import spacing
from upplied.records import Bools, Cloud, Floats, Ints, Record, Structure

_WELDED_M = 5e-3  # what is nearer was drawn as one place: no structure has joints as narrow
_WELDS = 8  # vertices, at most, to which one is welded
_SMALLEST = 0.003  # share of the surface below which a piece joins its neighbour
_LEAST_SAMPLES = 6  # the same in samples, of a thinned cloud
CONTACT = 0.015  # of the diagonal: pieces this close touch, and a surface lies on its mirror image
_TOUCHING = 0.15  # least share of the smaller piece that touches the other, to be one body with it
_MIRRORED = 0.8  # share of the samples whose mirror images lie on the surface, if it is its own mirror image
_CONTINUED = 0.3  # share of the near pairs that face the same way, by which a skin is continued


@dataclass(frozen=True, eq=False, repr=False)
class Parts(Record):
    """The parts of one structure, row by row."""

    low: Floats  # (K, 3) m, corner of the bounding box of its samples
    high: Floats  # (K, 3) m
    area: Floats  # (K,) share of the whole surface
    touching: Bools  # (K, K) whose samples come near each other
    extent: Floats  # (K, 3) m, along its own principal axes, longest first
    body: Bools  # (K,) stands on its neighbours; others continue their skin, as a belly fairing does
    side: Floats  # (K, 2) where it lies from front to rear and from left to right, see `sides`
    blade: Bools  # (K,) see `blades`
    registered: Floats | None = None  # (2, 3) m, box of the structure on which they are registered

    def __len__(self) -> int:
        return len(self.low)

    @property
    def middle(self) -> Floats:
        """(K, 3) m, centre of each box."""
        return (self.low + self.high) / 2

    def in_axes(self, quarters: Floats) -> "Parts":
        """The same parts in axes turned by right angles, ``p' = quarters @ p``; about the vertical."""
        ends = self.low @ quarters.T, self.high @ quarters.T
        axis = np.abs(quarters[:2, :2]).argmax(axis=1)
        side = self.side[:, axis] * quarters[[0, 1], axis]
        return replace(self, low=np.minimum(*ends), high=np.maximum(*ends), side=side)

    @property
    def box(self) -> Floats:
        """(2, 3) m, corners of the box in which places are named: the structure's."""
        own = np.stack([self.low.min(axis=0), self.high.max(axis=0)])
        return own if self.registered is None else self.registered

    def on(self, source: "Parts") -> "Parts":
        """The same parts, registered on a source: what was never scanned of them shifts no middle."""
        return replace(self, registered=source.box)


def sides(low: Floats, high: Floats, whole_low: Floats, whole_high: Floats) -> Floats:
    """Where boxes lie in a whole, (K, 2), front to rear and left to right.

    0 for what is balanced about the middle, about 1 to 2 for what lies on one side of it.
    """
    middle, half = (whole_low + whole_high)[:2] / 2, (whole_high - whole_low)[:2] / 2
    low, high = low[:, :2] - middle, high[:, :2] - middle
    reach = np.maximum(np.abs(low), np.abs(high)) + TOLERANCE * half
    return np.asarray((low + high) / np.maximum(reach, 1e-9))


def parts_of(cloud: Cloud) -> Parts:
    """Boxes, areas and contacts of the labelled parts of a cloud; one part where it has no labels."""
    return cloud.derived("parts", lambda: _measured(cloud))


def _measured(cloud: Cloud) -> Parts:
    points, label, area = cloud.points, labels_of(cloud), cloud.areas
    number = int(label.max()) + 1
    low, high = corners_of(points, label)
    side = sides(low, high, points.min(axis=0), points.max(axis=0))
    touching, pairs = contacts_of(points, label)
    near = np.stack([np.bincount(label, weights=axis >= 0) for axis in images(cloud).T], axis=1)
    share = np.bincount(label, weights=area) / area.sum()
    extent = np.array([extent_of(points[label == part]) for part in range(number)])
    return Parts(
        low=low,
        high=high,
        area=share,
        touching=touching > 0,
        body=_bodies(cloud, label, pairs),
        extent=extent,
        side=np.where(near > _MIRRORED * np.bincount(label)[:, None], side, np.nan),
        blade=blades(extent, share, (low + high) / 2),
    )


def pieces_tell_parts(cloud: Cloud) -> bool:
    """Whether the pieces of a surface are parts: enough of it lies on pieces that touch others.

    A scan of which much is missing falls into pieces that lie apart, as little as one piece tells parts.
    """
    parts = parts_of(cloud)
    return bool(parts.area[parts.touching.any(axis=1)].sum() > MAJORITY)


def parts_of_both(source: Cloud, registered: Cloud, words: Floats) -> tuple[Parts, Parts]:
    """The parts of a source and of a registered target, in the axes (3, 3) in which places are named."""
    here = parts_of(source).in_axes(words)
    return here, parts_of(registered).in_axes(words).on(here)


def blades(extent: Floats, area: Floats, middle: Floats) -> Bools:
    """Which parts (K,) are blades: long ones of one length that lie round a hub, and may point anywhere.

    By their extents (K, 3), m, longest first, their shares of the surface (K,) and their middles (K, 3), m.
    """
    length, width = extent[:, 0], extent[:, 1]
    slender = (length > SLENDER * width) & (area > LEAST_PART) & (np.arange(len(area)) > 0)
    log = np.log(np.maximum(length, 1e-9))
    alike = (np.abs(log[:, None] - log[None, :]) < np.log(SAME_SIZE)) & slender
    number = alike.sum(axis=1)
    away = np.linalg.norm(middle - alike @ middle / np.maximum(number, 1)[:, None], axis=1)
    # The parapets of a bridge are as long as each other as well, but lie side by side.
    return np.asarray(slender & (number > 1) & (away > length / SLENDER), bool)


def blades_of(cloud: Cloud) -> Bools:
    """Which samples (N,) lie on blades."""
    return np.asarray(parts_of(cloud).blade[labels_of(cloud)], bool)


def labels_of(cloud: Cloud) -> Ints:
    """The part of each sample, all 0 where the cloud has none."""
    return np.zeros(len(cloud), np.int64) if cloud.part is None else cloud.part


def names_of(cloud: Cloud, named: Ints) -> Ints:
    """What most of each part (K,) of a cloud is named, of what has a name; -1 where too little has one.

    `named` (N,) is the name of each sample, -1 for none.
    """
    label, known = labels_of(cloud), named >= 0
    area = np.zeros((int(label.max()) + 1, int(named.max(initial=0)) + 1))
    np.add.at(area, (label[known], named[known]), cloud.areas[known])
    some = area.sum(axis=1) > MAJORITY * np.bincount(label, weights=cloud.areas)
    return np.where(some & (area.max(axis=1) > MAJORITY * area.sum(axis=1)), area.argmax(axis=1), -1)


def images(cloud: Cloud) -> Ints:
    """The sample (N, 2) nearest to the mirror image of each, front for rear, left for right; -1 for none."""
    return cloud.derived("images", lambda: _images(cloud))


def _images(cloud: Cloud) -> Ints:
    points, tree, area = cloud.points, cKDTree(cloud.points), cloud.areas
    low, high = points.min(axis=0), points.max(axis=0)
    reach = max(CONTACT * float(np.linalg.norm(high - low)), spacing(cloud))
    nearest = np.empty((len(cloud), 2), np.int64)
    for axis in (0, 1):
        image = points.copy()
        image[:, axis] = low[axis] + high[axis] - image[:, axis]
        nearest[:, axis] = tree.query(image, distance_upper_bound=reach)[1]
    near = nearest < len(cloud)
    return np.where(near & (area @ near > _MIRRORED * area.sum()), nearest, -1)


def extent_of(points: Floats) -> Floats:
    """Extents (3,) of points along their own principal axes, m, longest first."""
    offset = points - points.mean(axis=0)
    return np.ptp(offset @ np.linalg.eigh(offset.T @ offset)[1], axis=0)[::-1]


def _bodies(cloud: Cloud, label: Ints, pairs: Ints) -> Bools:
    """Which parts (K,) are closed, or face another way than their neighbours where they come near them."""
    number = int(label.max()) + 1
    if cloud.normals is None:
        return np.ones(number, bool)
    count = np.bincount(label)
    facing = np.column_stack([np.bincount(label, weights=axis) for axis in cloud.normals.T])
    one, other = cloud.normals[pairs[:, 0]], cloud.normals[pairs[:, 1]]
    alike = pairs[np.einsum("ij,ij->i", one, other) > SAME_FACE]
    near, continued = (np.bincount(label[ends].reshape(-1), minlength=number) for ends in (pairs, alike))
    return (np.linalg.norm(facing, axis=1) < MAJORITY * count) | (continued <= _CONTINUED * near)


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
    """The part (N,) of each sample, from the mesh's piece it lies on; 0 has the largest area.

    Pieces of one compact body become one: the halves of a nacelle, and its pylon. The piece with more surface
    first, and the pieces that touch it most; one that makes it wider along two axes, a flap beside the
    nacelle, is another body.
    """
    label = joined_small(points, area, piece)
    number = int(label.max()) + 1
    if number < 3:
        return by_size(area, label)
    most = COMPACT * np.linalg.norm(np.ptp(points, axis=0))
    low, high = corners_of(points, label)
    size, count = np.bincount(label, weights=area), np.bincount(label)
    near = contacts_of(points, label)[0]
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
    return by_size(area, np.unique(body[label], return_inverse=True)[1].reshape(-1))


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
    points = points[order]
    return np.minimum.reduceat(points, first, axis=0), np.maximum.reduceat(points, first, axis=0)


def joined_small(points: Floats, area: Floats, label: Ints) -> Ints:
    """Parts (N,), 0 .. K - 1, where those that are too small to be one joined what lies nearest to them."""
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    share = np.bincount(label, weights=area) / area.sum()
    keep = (share >= _SMALLEST) & (np.bincount(label) >= _LEAST_SAMPLES)
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


def contacts_of(points: Floats, label: Ints) -> tuple[Ints, Ints]:
    """How many samples of each part (row) come near each other part (column), and these pairs (P, 2)."""
    reach = CONTACT * np.linalg.norm(np.ptp(points, axis=0))
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs, number = pairs[label[pairs[:, 0]] != label[pairs[:, 1]]], int(label.max()) + 1
    both = np.concatenate([pairs, pairs[:, ::-1]])
    sample_and_part = np.unique(both[:, 0] * number + label[both[:, 1]])
    owner, other = label[sample_and_part // number], sample_and_part % number
    near = np.bincount(owner * number + other, minlength=number * number)
    return near.reshape(number, number), pairs
