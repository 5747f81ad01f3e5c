"""Oriented discs that stand for a surface of which samples are known, and how far off they may be.

Distances are taken from cells of discs: the search trees of ray casters visit too many that overlap.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from upplied.geometry.vectors import across, plane_normals
from upplied.records import Floats, Ints, Record

_AROUND = 12  # neighbours of a sample that tell its plane, and whose discs are to hold it
_RIM = 6  # the neighbour as far away as a disc is wide
_INSIDE = np.cos(np.pi / 6)  # radius of the circle in a hexagon over that round it


@dataclass(frozen=True, eq=False, repr=False)
class Discs(Record):
    """Samples of a surface with their neighbours; K is 13, or less where there are fewer samples."""

    TRIANGLES: ClassVar[int] = 4  # of a disc in `mesh`

    points: Floats  # (N, 3) m
    normals: Floats  # (N, 3) unit
    away: Floats  # (N, K) m, distances of the nearest samples, the first of its own
    nearest: Ints  # (N, K)

    @classmethod
    def of(cls, points: Floats, normals: Floats | None) -> "Discs":
        """The discs of samples (N, 3), m; without normals the plane of the twelve nearest decides."""
        from scipy.spatial import cKDTree

        count, tree = min(_AROUND + 1, len(points)), cKDTree(points)
        away, nearest = np.empty((len(points), count)), np.empty((len(points), count), np.int64)
        order = tree.indices  # neighbours one after another find the tree's nodes in the processor's cache
        away[order], nearest[order] = tree.query(points[order], k=[*range(1, count + 1)])
        if normals is None:
            normals = plane_normals(points, nearest)
        return cls(points, normals, away, nearest)

    @property
    def radius_m(self) -> Floats:
        """(N,) distance to the sixth neighbour.

        On sampled meshes discs so wide agree with the mesh itself on 95 % of the sight lines.
        """
        return np.asarray(self.away[:, min(_RIM, self.away.shape[1] - 1)])

    @property
    def grain_m(self) -> float:
        """How wide a disc is, the median radius."""
        return float(np.median(self.radius_m))

    def mesh(self) -> tuple[Floats, Ints]:
        """The discs as hexagons: vertices (6 N, 3) and triangles (4 N, 3), in the order of the discs."""
        return hexagons(self.points, self.normals, self.radius_m)

    def error_m(self) -> float:
        """How far the surface may lie from the discs, m: as far as any sample does from its neighbours'.

        Each sample counts as though it had not been scanned: that includes noise, and edges between samples.
        One farther off than a disc is wide stands alone in the air and tells nothing of the others.
        """
        if self.away.shape[1] < _RIM + 2:
            return self.grain_m
        reach = _INSIDE * self.away[:, _RIM + 1]  # of each disc, without that sample
        off = _off_others(self.points, self.normals, self.away, self.nearest, reach)
        return float(off[off <= self.grain_m].max(initial=0.0))


def hexagons(
    points: Floats, normals: Floats, radius_m: Floats, corner: Floats | None = None
) -> tuple[Floats, Ints]:
    """Vertices (6 N, 3), m, and triangles (4 N, 3) of hexagons in the discs of some places, see `Discs`.

    `corner`, (N, 3) unit and across the normals, leads to the first corner of each.
    """
    first, second = across(normals) if corner is None else (corner, np.cross(normals, corner))
    angles = np.arange(6) * np.pi / 3
    rim = points[:, None] + radius_m[:, None, None] * (
        np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    )
    fan = np.array([[0, corner, corner + 1] for corner in range(1, 5)])
    return rim.reshape(-1, 3), ((6 * np.arange(len(points)))[:, None, None] + fan).reshape(-1, 3)


@njit(cache=True)
def _off_others(points: Floats, normals: Floats, away: Floats, nearest: Ints, reach: Floats) -> Floats:
    """How far (N,) each sample lies from the discs of the others near it, m."""
    off = np.full(len(points), np.inf)
    for row in range(len(points)):
        for column in range(1, nearest.shape[1]):
            other = nearest[row, column]
            above = 0.0
            for axis in range(3):
                above += (points[row, axis] - points[other, axis]) * normals[other, axis]
            if abs(above) >= off[row]:
                continue
            beside = np.sqrt(max(away[row, column] ** 2 - above**2, 0.0)) - reach[other]
            off[row] = min(off[row], np.hypot(above, beside) if beside > 0 else abs(above))
    return off


_WIDE = 4.0  # discs' radii that a cell is wide: some twenty discs lie in it
_GROUP = 4  # cells along each edge of a group


@dataclass(frozen=True, eq=False, repr=False)
class DiscCells(Record):
    """Round discs sorted by the cube of space that holds their centres, and these by larger ones."""

    points: Floats  # (N, 3) m, centres
    normals: Floats  # (N, 3) unit
    radius_m: Floats  # (N,)
    index: Ints  # (N,) of each before it was sorted
    first: Ints  # (C + 1,) disc of each cell
    place: Floats  # (C, 3) m, middle of each cell's discs
    spread_m: Floats  # (C,) no point of them is farther from it
    group_first: Ints  # (G + 1,) cell of each group
    group_place: Floats  # (G, 3) m
    group_spread_m: Floats  # (G,)

    @classmethod
    def of(cls, points: Floats, normals: Floats, radius_m: Floats) -> "DiscCells":
        """The discs with such centres (N, 3), unit normals (N, 3) and radii (N,), m."""
        wide = max(_WIDE * float(np.median(radius_m)), 1e-6 * float(np.ptp(points, axis=0).max()), 1e-12)
        cell = np.floor((points - points.min(axis=0)) / wide).astype(np.int64)
        group, within = np.divmod(cell, _GROUP)
        count = group.max(axis=0) + 1
        name = (group[:, 0] * count[1] + group[:, 1]) * count[2] + group[:, 2]
        name = ((name * _GROUP + within[:, 0]) * _GROUP + within[:, 1]) * _GROUP + within[:, 2]
        order = np.argsort(name, kind="stable")
        first, group_first = _begins(name[order]), _begins(name[order] // _GROUP**3)
        discs = points, normals, radius_m
        points, normals, radius_m = (np.ascontiguousarray(each[order], float) for each in discs)
        (place, spread), cells = _balls(points, radius_m, first), np.searchsorted(first, group_first)
        groups = _balls(place, spread, cells)
        return cls(points, normals, radius_m, order, first, place, spread, cells, *groups)

    def distance(self, places: Floats) -> Floats:
        """Distance (P,), m, of each place (P, 3) from the nearest disc."""
        return self._nearest(np.reshape(places, (-1, 3)))[0]

    def closest(self, places: Floats) -> tuple[Floats, Ints]:
        """The nearest point (P, 3), m, of any disc, and the number of that disc (P,)."""
        places = np.reshape(places, (-1, 3))
        disc = self._nearest(places)[1]
        centre, normal = self.points[disc], self.normals[disc]
        aside = places - centre
        aside = aside - np.einsum("pi,pi->p", aside, normal)[:, None] * normal
        length = np.maximum(np.linalg.norm(aside, axis=1), 1e-12)
        return centre + aside * np.minimum(self.radius_m[disc] / length, 1.0)[:, None], self.index[disc]

    def _nearest(self, places: Floats) -> tuple[Floats, Ints]:
        discs = self.points, self.normals, self.radius_m
        cells = self.first, self.place, self.spread_m
        groups = self.group_first, self.group_place, self.group_spread_m
        return _nearest(np.ascontiguousarray(places, float), *discs, *cells, *groups)


def _begins(name: Ints) -> Ints:
    """Where each run of equal names (N,) begins, and N."""
    return np.append(np.flatnonzero(np.diff(name, prepend=-1)), len(name))


@njit(cache=True)
def _balls(points: Floats, radius: Floats, first: Ints) -> tuple[Floats, Floats]:
    """Middle (C, 3) and radius (C,) of a ball about each run of smaller ones."""
    place, spread = np.zeros((len(first) - 1, 3)), np.zeros(len(first) - 1)
    for cell in range(len(place)):
        for row in range(first[cell], first[cell + 1]):
            for axis in range(3):
                place[cell, axis] += points[row, axis] / (first[cell + 1] - first[cell])
        for row in range(first[cell], first[cell + 1]):
            away = np.sqrt(_square(points[row, 0], points[row, 1], points[row, 2], place, cell))
            spread[cell] = max(spread[cell], away + radius[row])
    return place, spread


@njit(cache=True)
def _square(at_x: float, at_y: float, at_z: float, points: Floats, row: int) -> float:
    x, y, z = at_x - points[row, 0], at_y - points[row, 1], at_z - points[row, 2]
    return x * x + y * y + z * z


@njit(cache=True)
def _nearest(
    places: Floats, points: Floats, normals: Floats, radius: Floats, first: Ints, place: Floats,
    spread: Floats, group_first: Ints, group_place: Floats, group_spread: Floats,
) -> tuple[Floats, Ints]:  # fmt: skip
    """What may hold the nearest disc is nearer than some disc is, and its spread: the nearest cell first."""
    away, nearest_disc = np.empty(len(places)), np.empty(len(places), np.int64)
    from_group = np.empty(len(group_place))
    for row in range(len(places)):
        at_x, at_y, at_z = places[row]
        near = 0
        for group in range(len(group_place)):
            from_group[group] = _square(at_x, at_y, at_z, group_place, group)
            if from_group[group] < from_group[near]:
                near = group
        nearest, least = group_first[near], np.inf
        for cell in range(group_first[near], group_first[near + 1]):
            square = _square(at_x, at_y, at_z, place, cell)
            if square < least:
                nearest, least = cell, square
        best, which = np.inf, first[nearest]
        for turn in range(len(group_place) + 1):
            group = near if turn == 0 else turn - 1
            reach = best + group_spread[group]
            if turn and from_group[group] > reach * reach:
                continue
            cells = (nearest, nearest + 1) if turn == 0 else (group_first[group], group_first[group + 1])
            for cell in range(*cells):
                reach = best + spread[cell]
                if turn and (cell == nearest or _square(at_x, at_y, at_z, place, cell) > reach * reach):
                    continue
                for disc in range(first[cell], first[cell + 1]):
                    x, y, z = at_x - points[disc, 0], at_y - points[disc, 1], at_z - points[disc, 2]
                    square, reach = x * x + y * y + z * z, best + radius[disc]
                    if square >= reach * reach:
                        continue
                    above = x * normals[disc, 0] + y * normals[disc, 1] + z * normals[disc, 2]
                    aside = max(np.sqrt(max(square - above * above, 0.0)) - radius[disc], 0.0)
                    distance = np.sqrt(above * above + aside * aside)
                    if distance < best:
                        best, which = distance, disc
        away[row], nearest_disc[row] = best, which
    return away, nearest_disc
