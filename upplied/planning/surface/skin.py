"""Parts of a structure's skin: surface that continues without a concave crease, a step or a border.

The parts that `surface.parts` makes of a mesh's pieces are what the modeller cut. What a pilot looks at
is a stretch of skin: a nacelle, a wing, the walls of a hull, whether it was modelled in one piece,
in forty, or welded to its neighbour. So many samples are joined over short distances, but not where
one stands out of the tangent plane of the other.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from upplied.geometry.scene import Scene
from upplied.geometry.vectors import area_vectors, plane_normals, triangle_areas, with_normals
from upplied.planning.constants import FRAGMENT, SAME_FACE, TOUCH
from upplied.planning.surface.escape import floor_of, lets_out
from upplied.planning.surface.lattice import lattice, spacing_for
from upplied.planning.surface.parts import mesh_pieces
from upplied.records import Bools, Cloud, Floats, Ints, Record, Structure

_FINE = 40_000  # samples that are joined
_REACH = 3.0  # sample spacings: samples this near are asked whether the skin goes on between them
_RISE = 0.25  # sine of the angle at which a neighbour stands out of the tangent plane: 14.5 deg
_NECK = 0.5  # of the narrower part's half width: what is joined by less is two parts
_SPREAD = 0.15  # of it, either way: where a border is uncertain, some ways join and others do not
_DIVISIONS = 5  # of the skin, within the spread
_NECKS = tuple(np.linspace(_NECK - _SPREAD, _NECK + _SPREAD, _DIVISIONS))


@dataclass(frozen=True, eq=False, repr=False)
class PartLabels(Record):
    """Which part, or stretch of skin, of a structure each of its surface samples lies on."""

    label: Ints  # (N,) 0 .. K - 1


@dataclass(frozen=True, eq=False, repr=False)
class Skin(Record):
    """The stretches of a structure's skin at fine samples, divided in several ways that are as good."""

    points: Floats  # (F, 3) m
    normals: Floats  # (F, 3) unit, outward
    stretch: Ints  # (J, F) of each division: 0 .. K - 1
    spacing_m: float

    def of(self, cloud: Cloud) -> Ints:
        """The stretch (J, N) of each sample of a cloud of the same surface."""
        if not len(self.points):
            return np.zeros((len(self.stretch), len(cloud)), np.int64)
        weight = TOUCH * self.spacing_m
        place = cKDTree(with_normals(self.points, self.normals, weight))
        return np.asarray(self.stretch[:, place.query(with_normals(cloud.points, cloud.outward, weight))[1]])


def middle_of(stretch: Ints) -> Ints:
    """The stretch (N,) of each sample by the middle one of the divisions (J, N), numbered without gaps."""
    usual = stretch[len(stretch) // 2]
    return np.unique(usual, return_inverse=True)[1].reshape(-1).astype(np.int64)


def skin_parts(structure: Structure, scene: Scene, cloud: Cloud) -> PartLabels:
    """The part of the skin of each sample of a structure's surface, by one division; see `skin_study`."""
    return PartLabels(middle_of(skin_study(structure, scene, cloud).of(cloud)))


def skin_study(structure: Structure, scene: Scene, cloud: Cloud) -> Skin:
    """The skin of a structure, of which the N samples with normals of `cloud` say what is outside."""
    if len(structure.triangles):
        lines = lattice(structure, spacing_for(structure, float(cloud.areas.sum()), _FINE))
        index, normals, _ = outside_like(lines.points, lines.triangle, structure, scene, cloud)
        piece, area = mesh_pieces(structure), triangle_areas(structure)
        share = np.bincount(piece, weights=area) / max(float(area.sum()), 1e-300)
        known = np.where(share[piece] >= FRAGMENT, piece, -1)  # borders of triangle soup mean nothing
        points, piece = lines.points[index], known[lines.triangle[index]]
    else:
        index = np.sort(np.random.default_rng(0).permutation(len(structure.vertices))[:_FINE])
        points, normals = structure.vertices[index], outward_of_points(structure, index, cloud)
        piece = np.full(len(index), -1)
    if len(points) < 2 / FRAGMENT:
        nothing = np.empty((0, 3))
        return Skin(nothing, nothing, np.zeros((len(_NECKS), 0), np.int64), 0.0)
    spacing = float(np.sqrt(cloud.areas.sum() / len(points)))
    return Skin(points, normals, _joined(points, normals, piece, spacing), spacing)


def outside_like(
    points: Floats, triangle: Ints, structure: Structure, scene: Scene, cloud: Cloud
) -> tuple[Ints, Floats, Ints]:
    """The sides of points on triangles that are outside, as samples near them are.

    Of which point each is (K,), its outward unit normal (K, 3), and the sample of the cloud that is nearest
    and faces alike (K,).
    """
    normals = area_vectors(structure.vertices[structure.triangles[triangle]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    near = cKDTree(cloud.points).query(points, k=min(6, len(cloud)))[1].reshape(len(points), -1)
    agrees = np.einsum("nkj,nj->nk", cloud.outward[near], normals)
    both = np.stack([agrees > SAME_FACE, agrees < -SAME_FACE], axis=1)  # which sides face as samples near do
    index, side = np.nonzero(both.any(axis=2))
    sign, first = np.where(side == 0, 1.0, -1.0), both[index, side].argmax(axis=1)
    outward, like = sign[:, None] * normals[index], near[index, first]
    gap = 1e-5 * structure.diagonal_m
    free = lets_out(
        points[index] + gap * outward, outward, 2 * structure.diagonal_m, scene, floor_of(structure), few=True
    )
    return index[free], outward[free], like[free]


def outward_of_points(structure: Structure, chosen: Ints, cloud: Cloud) -> Floats:
    """Outward normals (K, 3) of some points of a structure without triangles.

    Where it has none they follow from neighbours, turned as those of the cloud's samples near them.
    """
    if structure.normals is not None:
        return structure.normals[chosen]
    points = structure.vertices
    normals = plane_normals(points, cKDTree(points).query(points[chosen], k=min(13, len(points)))[1])
    like = cloud.outward[cKDTree(cloud.points).query(points[chosen])[1]]
    return np.where((normals * like).sum(axis=1, keepdims=True) < 0, -normals, normals)


def _joined(points: Floats, normals: Floats, piece: Ints, spacing: float) -> Ints:
    """The part (J, F) of each fine sample, for each width of a neck."""
    number = len(points)
    pairs = cKDTree(points).query_pairs(_REACH * spacing, output_type="ndarray")
    length = _lengths(points, normals, piece, pairs)
    goes_on = length > 0
    rim: Bools = np.bincount(pairs[~goes_on].reshape(-1), minlength=number) > 0
    pairs, length = pairs[goes_on], length[goes_on]
    depth = np.full(number, np.inf)  # distance from the nearest rim along the skin, m
    if rim.any():
        graph = coo_matrix((length, pairs.T), (number, number)).tocsr()
        depth = dijkstra(graph, directed=False, indices=np.flatnonzero(rim), min_only=True)
    # The widest ways first: a way is as wide as its shallower end. A sparse matrix sorts them by counting.
    rank = np.empty(number, np.int64)
    rank[np.argsort(-depth, kind="stable")] = np.arange(number)
    shallower = np.maximum(*rank[pairs.T])
    by_rank = coo_matrix((shallower, (shallower, np.arange(len(pairs)))), (number, len(pairs)))
    pairs = pairs[by_rank.tocsr().indices]
    place, labels = with_normals(points, normals, TOUCH * spacing), np.zeros((len(_NECKS), number), np.int64)
    beside, inner = np.arange(number), np.flatnonzero(~rim)  # the nearest sample off the rim
    if len(inner):
        beside[rim] = inner[cKDTree(place[inner]).query(place[rim])[1]]
    for label, neck in zip(labels, _NECKS, strict=True):
        label[:] = _basins(pairs, depth, neck)
        body = (np.bincount(label)[label] >= FRAGMENT * number) & ~rim
        if not body.any():
            return np.zeros_like(labels)
        label[:], rest = label[beside], ~body[beside]
        label[rest] = label[body][cKDTree(place[body]).query(place[rest])[1]]
        label[:] = np.unique(label, return_inverse=True)[1]
    return labels


@njit(cache=True)
def _lengths(points: Floats, normals: Floats, piece: Ints, pairs: Ints) -> Floats:
    """Distance (E,) of neighbours (E, 2), m, > 0; 0 of those between which the skin does not continue."""
    length = np.zeros(len(pairs))
    for edge in range(len(pairs)):
        one, other = pairs[edge]
        x, y, z = (
            points[other, 0] - points[one, 0],
            points[other, 1] - points[one, 1],
            points[other, 2] - points[one, 2],
        )
        far = max(np.sqrt(x * x + y * y + z * z), 1e-9)
        rises = (x * normals[one, 0] + y * normals[one, 1] + z * normals[one, 2]) / far
        falls = -(x * normals[other, 0] + y * normals[other, 1] + z * normals[other, 2]) / far
        border = piece[one] != piece[other] and piece[one] >= 0 and piece[other] >= 0
        stands_out = max(abs(rises), abs(falls)) if border else max(rises, falls)  # the latter where concave
        length[edge] = 0.0 if stands_out > _RISE else far
    return length


@njit(cache=True)
def _basins(pairs: Ints, depth: Floats, neck: float) -> Ints:
    """Parts (F,) by watershed: two meet where the way between them is wide, as wide as they are."""
    # `pairs` (E, 2) are the widest first; what lies on the rim (depth 0) joins nothing; `neck` is of
    # `_NECKS`.
    number = len(depth)
    root, peak = np.arange(number), depth.copy()
    for way in range(len(pairs)):
        a, b = pairs[way]
        saddle = min(depth[a], depth[b])
        if saddle <= 0:
            break
        while root[a] != a:
            root[a] = root[root[a]]
            a = root[a]
        while root[b] != b:
            root[b] = root[root[b]]
            b = root[b]
        if a == b or saddle < neck * min(peak[a], peak[b]):
            continue
        if peak[b] > peak[a]:
            a, b = b, a
        root[b] = a
    for index in range(number):
        top = index
        while root[top] != top:
            top = root[top]
        root[index] = top
    return root
