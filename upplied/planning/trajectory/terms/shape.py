"""Shape: how far the path departs from the demonstrated one, whatever its place and its extent.

The paper compares z-scored paths: a shift, and a stretch along each axis of the source, change nothing.
So the departure is that from the nearest shifted and stretched image of the demonstrated path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.constants import MOST_RATIO
from upplied.planning.geometry.frechet import spread
from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record

_LEVEL = 0.1  # of the largest deviation: a path with less along an axis is level and is not stretched there


@dataclass(frozen=True, eq=False, repr=False)
class Shape(Record):
    """Mean squared departure in units of the path's deviation along each axis; about z-scored metres."""

    demonstrated: Floats  # (M, 3) m, about its mean, axes of the source
    standing: Floats  # (3, 3) turns the target's axes into the source's
    unit_m: Floats  # (3,) deviation of the path along each of those axes

    @classmethod
    def of(cls, demonstrated: Floats, standing: Floats) -> Shape:
        """The shape of a path (M, 3), m, in the target's frame."""
        turned = demonstrated @ standing.T
        return cls(turned - turned.mean(axis=0), standing, spread(turned)[1])

    def image(self, positions: Floats) -> Floats:
        """The shifted and stretched demonstrated path (M, 3), m, nearest to a path, target frame."""
        turned = positions @ self.standing.T
        return np.asarray(self._image(turned) @ self.standing)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared departure, and its slope: that of the nearest image adds none (it is the nearest)."""
        turned = flown.positions @ self.standing.T
        off = (turned - self._image(turned)) / self.unit_m
        slope = (2 / len(off)) * (off / self.unit_m) @ self.standing
        nothing = np.zeros(len(off))
        return float((off**2).sum(axis=1).mean()), Flown(slope, nothing, nothing)

    def _image(self, turned: Floats) -> Floats:
        middle, own = turned.mean(axis=0), self.demonstrated
        square = np.maximum((own**2).mean(axis=0), 1e-12)
        wide = np.sqrt(square) > _LEVEL * np.sqrt(square.max())
        stretch = ((turned - middle) * own).mean(axis=0) / square
        return np.asarray(middle + np.where(wide, np.clip(stretch, 1 / MOST_RATIO, MOST_RATIO), 1.0) * own)
