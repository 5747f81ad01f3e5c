"""Distances from many discs that overlap, where the search trees of ray casters visit too many of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.records import Floats, Ints, Record

_WIDE = 9.0  # discs' radii that a cell is wide: some hundred discs lie in it


@dataclass(frozen=True, eq=False, repr=False)
class DiscCells(Record):
    """Round discs sorted by the cube of space that holds their centres."""

    points: Floats  # (N, 3) m, centres
    normals: Floats  # (N, 3) unit
    radius_m: Floats  # (N,)
    index: Ints  # (N,) of each before it was sorted
    first: Ints  # (C + 1,) of each cell
    place: Floats  # (C, 3) m, centre of one disc of each cell
    spread_m: Floats  # (C,) no point of the cell's discs is farther from it

    @classmethod
    def of(cls, points: Floats, normals: Floats, radius_m: Floats) -> DiscCells:
        """The discs with such centres (N, 3), unit normals (N, 3) and radii (N,), m."""
        wide = max(_WIDE * float(np.median(radius_m)), 1e-6 * float(np.ptp(points, axis=0).max()), 1e-12)
        cell = np.floor((points - points.min(axis=0)) / wide).astype(np.int64)
        count = cell.max(axis=0) + 1
        name = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
        order = np.argsort(name, kind="stable")
        first = np.flatnonzero(np.diff(name[order], prepend=-1))
        sizes = np.diff(first, append=len(order))
        points, radius_m = points[order], radius_m[order]
        which = np.repeat(np.arange(len(first)), sizes)
        middle = np.add.reduceat(points, first) / sizes[:, None]
        off = np.linalg.norm(points - middle[which], axis=1)
        nearest = np.lexsort((off, which))[first]
        spread = np.linalg.norm(points - points[nearest][which], axis=1) + radius_m
        return cls(
            points=np.ascontiguousarray(points, float),
            normals=np.ascontiguousarray(normals[order], float),
            radius_m=np.ascontiguousarray(radius_m, float),
            index=order,
            first=np.append(first, len(order)),
            place=points[nearest],
            spread_m=np.maximum.reduceat(spread, first),
        )

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
        places = np.ascontiguousarray(places, float)
        discs = self.points, self.normals, self.radius_m
        away, disc = _nearest(places, *discs, self.first, self.place, self.spread_m)
        return away, disc


@njit(cache=True)
def _nearest(
    places: Floats,
    points: Floats,
    normals: Floats,
    radius: Floats,
    first: Ints,
    place: Floats,
    spread: Floats,
) -> tuple[Floats, Ints]:
    """The cells that may hold the nearest disc are those nearer than some disc is, less their spread."""
    away, found = np.empty(len(places)), np.empty(len(places), np.int64)
    from_cell = np.empty(len(place))
    for row in range(len(places)):
        at_x, at_y, at_z = places[row]
        nearest = 0
        for cell in range(len(place)):
            x, y, z = at_x - place[cell, 0], at_y - place[cell, 1], at_z - place[cell, 2]
            from_cell[cell] = x * x + y * y + z * z
            if from_cell[cell] < from_cell[nearest]:
                nearest = cell
        best, which = np.inf, first[nearest]
        for turn in range(len(place) + 1):
            cell = nearest if turn == 0 else turn - 1
            reach = best + spread[cell]
            if turn and (cell == nearest or from_cell[cell] > reach * reach):
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
        away[row], found[row] = best, which
    return away, found
