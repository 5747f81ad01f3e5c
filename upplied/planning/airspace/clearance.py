"""How near a whole path comes to the structure: along its legs, not only at its waypoints.

Around a point at distance d from the surface, the ball of radius d is free. So the balls of both ends
of a piece of a leg bound the clearance of all of it, and only the pieces that could still matter are
halved: all of them at once, on the unsigned distance (real meshes are seldom watertight).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.geometry.scene import Scene
from upplied.records import Bools, Floats, Ints, Record, Rows

_TOLERANCE_M = 0.005


@dataclass(frozen=True, eq=False, repr=False)
class Nearest(Record):
    """Where a path comes nearest to the structure."""

    distance_m: float  # of `position`; no point of the path is nearer than this less 5 mm
    position: Floats  # (3,) m, on the path
    leg: int  # index of the leg it lies on; 0 for a path of one point

    @property
    def certain_m(self) -> float:
        """What the whole path keeps for certain, m."""
        return self.distance_m - _TOLERANCE_M


def path_clearance(scene: Scene, positions: Floats) -> Nearest:
    """The smallest distance between a path and the structure.

    Parameters
    ----------
    scene : Scene
    positions : array, shape (N, 3), m, structure frame
        Waypoints, joined by straight legs.

    Returns
    -------
    Nearest
    """
    positions = np.asarray(positions, float).reshape(-1, 3)
    free = scene.distance(positions)
    best = int(free.argmin())
    distance, place, leg = float(free[best]), positions[best], max(min(best, len(positions) - 2), 0)
    pieces = _Pieces.of(positions, free)
    while len(pieces.leg):
        pieces = pieces.rows(pieces.bound_m() < distance - _TOLERANCE_M).halved(scene)
        if len(pieces.leg) and pieces.free_b.min() < distance:
            best = int(pieces.free_b.argmin())
            distance, place, leg = float(pieces.free_b[best]), pieces.b[best], int(pieces.leg[best])
    return Nearest(distance, np.array(place), leg)


def legs_below(scene: Scene, start: Floats, end: Floats, limit_m: float) -> Bools:
    """Which straight legs come nearer to the structure than a limit, (N,).

    A leg that stays within 5 mm above the limit may be called too near, never the reverse.

    Parameters
    ----------
    scene : Scene
    start, end : array, shape (N, 3), m, structure frame
    limit_m : float
    """
    if np.array_equal(start[1:], end[:-1]):  # the legs of a path share their ends
        along = scene.distance(np.concatenate([start, end[-1:]]))
        free = np.concatenate([along[:-1], along[1:]])
    else:
        free = scene.distance(np.concatenate([start, end]))
    free_a, free_b = free[: len(start)], free[len(start) :]
    below = (free_a < limit_m) | (free_b < limit_m)
    pieces = _Pieces(start, end, free_a, free_b, np.arange(len(start)))
    while len(pieces.leg):
        pieces = pieces.rows((pieces.bound_m() < limit_m) & ~below[pieces.leg])
        below[pieces.leg[pieces.length_m() <= _TOLERANCE_M]] = True
        pieces = pieces.rows(~below[pieces.leg]).halved(scene)
        below[pieces.leg[pieces.free_b < limit_m]] = True
    return below


@dataclass(frozen=True, eq=False, repr=False)
class _Pieces(Rows):
    """Straight pieces from a to b with the distance of their ends from the surface."""

    a: Floats  # (K, 3) m
    b: Floats  # (K, 3) m
    free_a: Floats  # (K,) m
    free_b: Floats  # (K,) m
    leg: Ints  # (K,)

    @classmethod
    def of(cls, positions: Floats, free: Floats) -> _Pieces:
        return cls(positions[:-1], positions[1:], free[:-1], free[1:], np.arange(len(positions) - 1))

    def length_m(self) -> Floats:
        return np.linalg.norm(self.b - self.a, axis=1)

    def bound_m(self) -> Floats:
        """No point of the piece is nearer: the surface lies outside both balls, so beyond the circle
        in which they meet, unless one ball holds the other's share of the piece.
        """
        length = np.maximum(self.length_m(), 1e-12)
        plane = (length**2 + self.free_a**2 - self.free_b**2) / (2 * length)  # of the circle, from a
        circle = np.sqrt(np.maximum(self.free_a**2 - plane**2, 0))
        return np.where(plane <= 0, self.free_a, np.where(plane >= length, self.free_b, circle))

    def halved(self, scene: Scene) -> _Pieces:
        """Both halves of each piece; the first halves come first and end in the new points."""
        if len(self.leg) == 0:
            return self
        middle = (self.a + self.b) / 2
        free = scene.distance(middle)
        first = _Pieces(self.a, middle, self.free_a, free, self.leg)
        return _Pieces.stacked([first, _Pieces(middle, self.b, free, self.free_b, self.leg)])
