"""Clearance: what is missing of the safety distance, of the height above the ground, below the ceiling."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.planning.airspace.rules import Airspace
from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record

_BEYOND_M = 0.05  # kept beyond the limits, for what lies between the stations


@dataclass(frozen=True, eq=False, repr=False)
class Clearance(Record):
    """Mean squared lack, m^2; the nearest places of the surface hold until they are found again."""

    closest: Floats  # (M, 3) m
    least_m: float
    floor_m: float
    ceiling_m: float

    @classmethod
    def of(cls, airspace: Airspace, path: Flown) -> Clearance:
        """The term near a path."""
        closest, _ = airspace.scene.closest(path.positions)
        return cls(closest, airspace.clearance_m + _BEYOND_M, airspace.floor_m, airspace.ceiling_m)

    def no_nearer(self, least_m: float) -> Clearance:
        """The same, for a distance that is wished for and not demanded, without ground and ceiling."""
        return replace(self, least_m=least_m, floor_m=-np.inf, ceiling_m=np.inf)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared lack, and its slope."""
        away = flown.positions - self.closest
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        lack = np.maximum(self.least_m - distance, 0)
        low = np.maximum(self.floor_m - flown.positions[:, 2], 0)
        high = np.maximum(flown.positions[:, 2] - self.ceiling_m, 0)
        slope = -2 * (lack / distance)[:, None] * away
        slope[:, 2] += 2 * (high - low)
        nothing = np.zeros(len(lack))
        return float((lack**2 + low**2 + high**2).mean()), Flown(slope / len(lack), nothing, nothing)
