"""How near a whole path comes to the structure: along its legs, not only at its waypoints.

The distance from a surface changes by at most one metre per metre flown. So where the middle of a
piece is far enough, the whole piece is, and only the pieces that could still matter are halved: all
of them at once, on the unsigned distance (real meshes are seldom watertight).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Bools, Floats, Ints, Record
from upplied.scene import Scene

_TOLERANCE_M = 0.005


@dataclass(frozen=True, eq=False, repr=False)
class Nearest(Record):
    """Where a path comes nearest to the structure."""

    distance_m: float  # of `position`; no point of the path is nearer than this less `tolerance_m`
    position: Floats  # (3,) m, on the path
    leg: int  # index of the leg it lies on; 0 for a path of one point
    tolerance_m: float

    @property
    def certain_m(self) -> float:
        """What the whole path keeps for certain, m."""
        return self.distance_m - self.tolerance_m


def path_clearance(scene: Scene, positions: Floats, tolerance_m: float = _TOLERANCE_M) -> Nearest:
    """The smallest distance between a path and the structure.

    Parameters
    ----------
    scene : Scene
    positions : array, shape (N, 3), m, structure frame
        Waypoints, joined by straight legs.
    tolerance_m : float
        The path's true clearance lies within this below `distance_m`.

    Returns
    -------
    Nearest
    """
    positions = np.asarray(positions, float).reshape(-1, 3)
    at_waypoint = scene.distance(positions)
    best = int(at_waypoint.argmin())
    distance, place, leg = float(at_waypoint[best]), positions[best], max(min(best, len(positions) - 2), 0)
    pieces = _Pieces.of(positions)
    while len(pieces.leg):
        at_middle = scene.distance(pieces.middle)
        low = int(at_middle.argmin())
        if at_middle[low] < distance:
            distance, place, leg = float(at_middle[low]), pieces.middle[low], int(pieces.leg[low])
        pieces = pieces.halved(at_middle - pieces.half_m < distance - tolerance_m)
    return Nearest(distance, np.array(place), leg, tolerance_m)


def legs_below(scene: Scene, positions: Floats, limit_m: float, tolerance_m: float = _TOLERANCE_M) -> Bools:
    """Which legs come nearer to the structure than a limit, (N - 1,).

    A leg that stays within `tolerance_m` above the limit may be called too near, never the reverse.

    Parameters
    ----------
    scene : Scene
    positions : array, shape (N, 3), m, structure frame
    limit_m, tolerance_m : float
    """
    positions = np.asarray(positions, float)
    below = np.zeros(max(len(positions) - 1, 0), bool)
    near = scene.distance(positions) < limit_m
    below |= near[:-1] | near[1:]
    pieces = _Pieces.of(positions)
    pieces = pieces.kept(~below[pieces.leg])
    while len(pieces.leg):
        at_middle = scene.distance(pieces.middle)
        too_near = (at_middle < limit_m) | (
            (at_middle - pieces.half_m < limit_m) & (pieces.half_m <= tolerance_m)
        )
        below[pieces.leg[too_near]] = True
        pieces = pieces.halved((at_middle - pieces.half_m < limit_m) & ~below[pieces.leg])
    return below


@dataclass(frozen=True, eq=False, repr=False)
class _Pieces(Record):
    """Pieces of legs, by middle and half their vector."""

    middle: Floats  # (K, 3) m
    half: Floats  # (K, 3) m
    leg: Ints  # (K,)

    @classmethod
    def of(cls, positions: Floats) -> _Pieces:
        half = np.diff(positions, axis=0) / 2
        return cls(positions[:-1] + half, half, np.arange(len(half)))

    @property
    def half_m(self) -> Floats:
        return np.linalg.norm(self.half, axis=1)

    def kept(self, which: Bools) -> _Pieces:
        return _Pieces(self.middle[which], self.half[which], self.leg[which])

    def halved(self, which: Bools) -> _Pieces:
        middle, half = self.middle[which], self.half[which] / 2
        return _Pieces(
            np.concatenate([middle - half, middle + half]),
            np.concatenate([half, half]),
            np.concatenate([self.leg[which], self.leg[which]]),
        )
