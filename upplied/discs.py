"""Oriented discs that stand for a surface of which samples are known, and how far off they may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats, Ints, Record
from upplied.vectors import across, plane_normals

_AROUND = 12  # neighbours of a sample that tell its plane, and whose discs are to hold it
_RIM = 6  # the neighbour as far away as a disc is wide
_INSIDE = np.cos(np.pi / 6)  # radius of the circle in a hexagon over that round it


@dataclass(frozen=True, eq=False, repr=False)
class Discs(Record):
    """Samples of a surface with their neighbours; K is 13, or less where there are fewer samples."""

    points: Floats  # (N, 3) m
    normals: Floats  # (N, 3) unit
    away: Floats  # (N, K) m, distances of the nearest samples, the first of its own
    nearest: Ints  # (N, K)

    @classmethod
    def of(cls, points: Floats, normals: Floats | None) -> Discs:
        """The discs of samples (N, 3), m; without normals the plane of the twelve nearest decides."""
        from scipy.spatial import cKDTree

        away, nearest = cKDTree(points).query(points, k=min(_AROUND + 1, len(points)))
        away, nearest = away.reshape(len(points), -1), nearest.reshape(len(points), -1)
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
        """The discs as hexagons: vertices (7 N, 3), each centre before its rim, and triangles (6 N, 3)."""
        first, second = across(self.normals)
        angles = np.arange(6) * np.pi / 3
        rim = self.points[:, None] + self.radius_m[:, None, None] * (
            np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
        )
        vertices = np.concatenate([self.points[:, None], rim], axis=1).reshape(-1, 3)
        corner = np.arange(6)
        fan = np.stack([np.zeros(6, int), 1 + corner, 1 + (corner + 1) % 6], axis=1)
        return vertices, ((7 * np.arange(len(self.points)))[:, None, None] + fan).reshape(-1, 3)

    def error_m(self) -> float:
        """How far the surface may lie from the discs, m: as far as any sample does from its neighbours'.

        Each sample is asked as though it had not been scanned: that holds the noise, and edges between
        samples. One farther off than a disc is wide stands alone in the air and tells nothing of the
        others. Nothing is known of what was never scanned.
        """
        if self.away.shape[1] < _RIM + 2:
            return self.grain_m
        others = self.nearest[:, 1:]
        reach = _INSIDE * self.away[:, _RIM + 1]  # of each disc, without the sample that is asked
        way = self.points[:, None] - self.points[others]
        above = np.einsum("nki,nki->nk", way, self.normals[others])
        aside = np.sqrt(np.maximum(self.away[:, 1:] ** 2 - above**2, 0)) - reach[others]
        off = np.hypot(above, np.maximum(aside, 0)).min(axis=1)
        return float(off[off <= self.grain_m].max(initial=0.0))


def surfels(points: Floats, normals: Floats | None) -> tuple[Floats, Ints]:
    """Oriented hexagons that stand for a sampled surface, see `Discs.mesh`.

    Parameters
    ----------
    points : array, shape (N, 3), m
    normals : array, shape (N, 3) or None
    """
    return Discs.of(points, normals).mesh()
