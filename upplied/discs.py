"""Oriented discs that stand for a surface of which samples are known, and how far off they may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from upplied.records import Floats, Ints, Record
from upplied.vectors import across, nearest_of_all, plane_normals

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
    def of(cls, points: Floats, normals: Floats | None) -> Discs:
        """The discs of samples (N, 3), m; without normals the plane of the twelve nearest decides."""
        away, nearest = nearest_of_all(points, min(_AROUND + 1, len(points)))
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

        Each sample is asked as though it had not been scanned: that holds the noise, and edges between
        samples. One farther off than a disc is wide stands alone in the air and tells nothing of the
        others. Nothing is known of what was never scanned.
        """
        if self.away.shape[1] < _RIM + 2:
            return self.grain_m
        reach = _INSIDE * self.away[:, _RIM + 1]  # of each disc, without the sample that is asked
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


def surfels(points: Floats, normals: Floats | None) -> tuple[Floats, Ints]:
    """Oriented hexagons that stand for a sampled surface, see `Discs.mesh`.

    Parameters
    ----------
    points : array, shape (N, 3), m
    normals : array, shape (N, 3) or None
    """
    return Discs.of(points, normals).mesh()
