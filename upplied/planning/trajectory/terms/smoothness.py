"""Smoothness: how much more, or otherwise, the path curves than the demonstrated one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Smoothness(Record):
    """Mean squared change of curvature, times the squared stand-off: 1 for a circle of its radius."""

    demonstrated: Floats  # (M, 3) m, as the structure's map carries it
    spacing_m: float  # mean, of its stations
    standoff_m: float

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared change of curvature in stand-offs, and its slope."""
        factor = self.standoff_m / self.spacing_m**2
        second = factor * np.diff(flown.positions - self.demonstrated, n=2, axis=0)
        count = max(len(second), 1)
        pull = 2 / count * factor * second
        slope, nothing = np.zeros_like(flown.positions), np.zeros(len(flown))
        slope[2:] += pull
        slope[1:-1] -= 2 * pull
        slope[:-2] += pull
        return float((second**2).sum() / count), Flown(slope, nothing, nothing)
