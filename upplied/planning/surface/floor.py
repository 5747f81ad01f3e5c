"""The floor under a structure whose bottom is open: hulls, houses and tanks come without one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from upplied.planning.constants import LEAST_PART
from upplied.records import Bools, Floats, Record, Structure

_CELLS = 256  # along the longer side of the plan


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

    def grid(self, origin: Floats) -> tuple[float, Floats, float, Bools]:
        """Height, corner (2,) and cells (X, Y) of the lid from an origin (3,), for compiled code."""
        return self.z_m - float(origin[2]), self.low - origin[:2], self.cell_m, self.enclosed

    @classmethod
    def none(cls) -> Floor:
        """No floor at all."""
        return cls(0.0, np.zeros(2), 1.0, np.zeros((1, 1), bool))


def floor_of(structure: Structure) -> Floor:
    """The lid at the foot of a mesh, found by cutting it there and filling what the cut encloses."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    z = float(low[2] + LEAST_PART * (high[2] - low[2]))
    first, last = _cut(structure, z)
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


def _cut(structure: Structure, z: float) -> tuple[Floats, Floats]:
    """Both ends (S, 2) of the segments in which the triangles meet the plane at height `z`."""
    above = structure.vertices[:, 2] > z
    corner_above = above[structure.triangles]
    crossing = corner_above.any(axis=1) & ~corner_above.all(axis=1)
    triangles, state = structure.triangles[crossing], corner_above[crossing]
    # The corner that lies alone on its side is an end of both edges that cross the plane.
    alone = np.where(state.sum(axis=1) == 1, state.argmax(axis=1), (~state).argmax(axis=1))
    rows = np.arange(len(triangles))
    apex = structure.vertices[triangles[rows, alone]]
    ends = []
    for step in (1, 2):
        other = structure.vertices[triangles[rows, (alone + step) % 3]]
        share = (z - apex[:, 2]) / (other[:, 2] - apex[:, 2])
        ends.append((apex + share[:, None] * (other - apex))[:, :2])
    return ends[0], ends[1]
