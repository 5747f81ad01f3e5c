"""Which sides of a surface rays escape from: what can be seen from outside, whatever the mesh's winding.

Rays escape from both sides of a thin sheet, and from both sides of a shell next to a hole. So where a shell
is open since nothing was scanned its inside can be seen, and is no outside: winding is asked of scans alone,
and only which side of a piece is its front, the one that mostly shows. A closed surface has no such place,
and a model may have: ducts, sheets, hulls without a deck.

An open bottom counts as closed by the floor: hulls, houses and tanks come without one.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from upplied.geometry.scene import Scene
from upplied.geometry.vectors import area_vectors, sphere
from upplied.planning.constants import LEAST_PART, TOUCH
from upplied.planning.geometry.clouds import spacing
from upplied.records import Bools, Cloud, Floats, Ints, Record, Structure

_CELLS = 256  # along the longer side of the plan
ESCAPE = 0.06  # least share of a side's rays that escape: inlets reach 0.1, cabins behind a hole 0.03
DIRECTIONS = 64  # over the whole sphere: half of them for each side of a surface
_FEW = 16  # of those, for samples whose neighbours were asked thoroughly
_LEVEL = 0.1  # least cosine of a ray and the normal
_ROUNDS = (0, 2, 4, 8, 16, 32, DIRECTIONS)  # rays of each side are cast together from one to the next


@dataclass(frozen=True, eq=False, repr=False)
class Floor(Record):
    """A horizontal lid over what the walls of a structure enclose at its foot."""

    z_m: float
    low: Floats  # (2,) m, corner of the grid
    cell_m: float
    enclosed: Bools  # (X, Y)

    def beneath(self, points: Floats) -> Bools:
        """Which points (N, 3) lie under the lid."""
        return (points[:, 2] <= self.z_m) & self.covers(points[:, :2])

    def covers(self, xy: Floats) -> Bools:
        """Which places (N, 2) lie in the lid."""
        cell = np.floor((xy - self.low) / self.cell_m)
        inside: Bools = np.all((cell >= 0) & (cell < self.enclosed.shape), axis=1)
        index = np.where(inside[:, None], cell, 0).astype(int)
        return np.asarray(inside & self.enclosed[index[:, 0], index[:, 1]], bool)

    def crossed(self, starts: Floats, rays: Floats) -> Bools:
        """Which rays (N, 3) from above the lid go down through it."""
        down = np.flatnonzero((starts[:, 2] > self.z_m) & (rays[:, 2] < 0))
        along = (self.z_m - starts[down, 2]) / rays[down, 2]
        through = np.zeros(len(rays), bool)
        through[down] = self.covers(starts[down, :2] + along[:, None] * rays[down, :2])
        return through

    @classmethod
    def none(cls) -> "Floor":
        """No floor at all."""
        return cls(0.0, np.zeros(2), 1.0, np.zeros((1, 1), bool))


def floor_of(structure: Structure) -> Floor:
    """The lid at the foot of a mesh, found by cutting it there and filling what the cut encloses."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    z = float(low[2] + LEAST_PART * (high[2] - low[2]))
    # Both ends of the segments in which the triangles meet the plane at that height.
    above = structure.vertices[:, 2] > z
    corner_above = above[structure.triangles]
    crossing = corner_above.any(axis=1) & ~corner_above.all(axis=1)
    triangles, state = structure.triangles[crossing], corner_above[crossing]
    # The corner that lies alone on its side is an end of both edges that cross the plane.
    alone = np.where(state.sum(axis=1) == 1, state.argmax(axis=1), (~state).argmax(axis=1))
    rows, ends = np.arange(len(triangles)), []
    apex = structure.vertices[triangles[rows, alone]]
    for step in (1, 2):
        other = structure.vertices[triangles[rows, (alone + step) % 3]]
        share = (z - apex[:, 2]) / (other[:, 2] - apex[:, 2])
        ends.append((apex + share[:, None] * (other - apex))[:, :2])
    first, last = ends
    size = (high - low)[:2]
    cell = float(size.max()) / _CELLS
    if not len(first) or cell <= 0:
        return Floor.none()
    shape = np.ceil(size / cell).astype(int) + 3
    corner = low[:2] - cell
    steps = np.ceil(np.linalg.norm(last - first, axis=1) / (0.4 * cell)).astype(int) + 1
    segment = np.repeat(np.arange(len(first)), steps)
    along = (np.arange(len(segment)) - np.repeat(np.cumsum(steps) - steps, steps)) / np.maximum(
        steps[segment] - 1, 1
    )
    points = first[segment] + along[:, None] * (last - first)[segment]
    index = np.floor((points - corner) / cell).astype(int)
    wall = np.zeros(shape, bool)
    wall[index[:, 0], index[:, 1]] = True
    return Floor(z, corner, cell, ndimage.binary_fill_holes(wall))


def lets_out(
    origins: Floats, normals: Floats, reach_m: float, scene: Scene, floor: Floor, few: bool = False
) -> Bools:
    """Whether enough rays from just above each side escape, (N,).

    They are cast until the answer is known, those along the normal first: most sides on the outside
    take two. A ray that goes down through the floor does not escape.

    Parameters
    ----------
    origins, normals : array, shape (N, 3), m and unit
    reach_m : float
        How far a ray goes that escapes.
    few : bool
        With a quarter of the rays.
    """
    directions = sphere(DIRECTIONS)[:: DIRECTIONS // _FEW if few else 1]
    facing = normals @ directions.T
    left = (facing > _LEVEL).sum(axis=1)
    need = np.maximum(np.ceil(ESCAPE * left).astype(np.int64), 1)
    order, nearest = np.argsort(-(directions @ directions.T), axis=1, kind="stable"), facing.argmax(axis=1)
    for first, last in pairwise(_ROUNDS):
        doubt = np.flatnonzero((need > 0) & (left >= need))
        if not len(doubt):
            break
        ways = order[nearest[doubt], first:last]
        row, place = np.nonzero(facing[doubt[:, None], ways] > _LEVEL)
        owner, rays = doubt[row], directions[ways[row, place]]
        left -= np.bincount(owner, minlength=len(left))
        above = np.flatnonzero(~floor.crossed(origins[owner], rays))
        owner, rays = owner[above], reach_m * rays[above]
        local = np.hstack([origins[owner] - scene.origin, rays]).astype(np.float32)
        free = ~scene.blocked(local, slack=0.0)
        need -= np.bincount(owner[free], minlength=len(need))
    return np.asarray(need <= 0, bool)


def escapes(origins: Floats, normals: Floats, reach_m: float, scene: Scene) -> Floats:
    """Share of the rays from just above each side that leave the structure, (N,)."""
    directions = sphere(DIRECTIONS)
    few = np.arange(DIRECTIONS) % (DIRECTIONS // _FEW) == 0
    cast, free = _count(origins, normals, directions[few], reach_m, scene)
    doubt = np.flatnonzero(free < np.maximum(2, 2 * ESCAPE * cast))
    more_cast, more_free = _count(origins[doubt], normals[doubt], directions[~few], reach_m, scene)
    cast[doubt] += more_cast
    free[doubt] += more_free
    return np.asarray(free / np.maximum(cast, 1))


def _count(
    origins: Floats, normals: Floats, directions: Floats, reach_m: float, scene: Scene
) -> tuple[Ints, Ints]:
    """How many rays were cast from each side, and how many escaped."""
    owner, which = np.nonzero(normals @ directions.T > _LEVEL)
    starts, rays = origins[owner], directions[which]
    free = ~scene.occluded(starts, starts + reach_m * rays, slack=0.0)
    number = len(origins)
    return np.bincount(owner, minlength=number), np.bincount(owner[free], minlength=number)


def inside_open_shell(
    points: Floats, triangle: Ints, side: Floats, both: Bools, piece: Ints, structure: Structure, scene: Scene
) -> Bools:
    """Which sides (S,) that rays escape from lie inside a shell that is open where nothing was scanned.

    From there more rays meet backs than do not, on pieces that mostly show from one side alone. What is no
    scan has no such sides: the ducts and cabins of a model are open as they are meant to be.

    `points` (S, 3), m, lie on a `triangle` (S,), each on the `side` (S,), +1 along the normal as wound,
    or -1; `both` (S,) where rays escape from the other side of the same place as well; `piece` (T,) is the
    piece of each triangle (`parts.mesh_pieces`).
    """
    inside = np.zeros(len(points), bool)
    if not structure.is_scan or not both.any():
        return inside
    of, number = piece[triangle], int(piece.max()) + 1
    shown = np.bincount(of[~both], weights=side[~both], minlength=number)
    # A tank, a boat: what mostly shows from both sides is no shell that happens to be open.
    from_one, from_both = (np.bincount(of[some], minlength=number) for some in (~both, both & (side > 0)))
    front = np.where(from_one > from_both, np.sign(shown), 0)[piece]  # of each triangle, as wound
    doubt = np.flatnonzero(both & (side * front[triangle] < 0))
    outward = area_vectors(structure.vertices[structure.triangles[triangle[doubt]]])
    outward *= (side[doubt] / np.linalg.norm(outward, axis=1))[:, None]
    directions = sphere(DIRECTIONS)
    owner, which = np.nonzero(outward @ directions.T > 0)
    starts = points[doubt] + 1e-5 * structure.diagonal_m * outward
    _, met, wound = scene.cast(starts[owner], directions[which])
    along = np.einsum("ij,ij->i", wound, directions[which])
    back = (met >= 0) & (front[met] * along > 0)
    backs, others = (np.bincount(owner, weights=some, minlength=len(doubt)) for some in (back, ~back))
    inside[doubt] = backs > others
    return inside


_AROUND = 8  # neighbours of a sample, of which half must show their inside as well
_ITSELF = 0.85  # of the way back to the surface, from which what is met on it is the surface itself


def shows_inside(structure: Structure, scene: Scene, cloud: Cloud) -> Bools:
    """Which of the N samples of a structure's surface can be seen from behind, from outside.

    Where a cloud is thinner than it is sampled nobody can tell, and no sample counts.
    """
    shows, inward = np.zeros(len(cloud), bool), -cloud.outward
    gap = scene.grain_m or 1e-5 * structure.diagonal_m
    starts, some = cloud.points + gap * inward, np.arange(len(cloud))
    if scene.grain_m:
        some = np.flatnonzero(scene.cast(starts, -inward)[0] > _ITSELF * gap)
    open_ = escapes(starts[some], inward[some], 2 * structure.diagonal_m, scene) > ESCAPE
    at, reach = cloud.points[some], TOUCH * spacing(cloud)
    near = cKDTree(at).query(at, k=range(2, 2 + _AROUND), distance_upper_bound=reach)[1]
    while True:  # what shows here and there, between discs at an edge, is no opening
        joined = open_ & (2 * np.append(open_, False)[near].sum(axis=1) >= _AROUND)
        if np.array_equal(joined, open_):
            shows[some] = open_
            return shows
        open_ = joined
