"""Stand-off: the distance from which each viewpoint sees what it is about, within a tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.carry.standoff import Standoff
from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class StandoffKept(Record):
    """Mean squared excess of the stand-off beyond its tolerance, in units of the wanted stand-off.

    What is asked for is a median distance, which has no slope; the mean distance stands for it, over
    the ratio of the two on the path as it was.
    """

    standoff: Standoff
    ratio: Floats  # (V,) mean over median distance
    tolerance: float

    @classmethod
    def of(cls, standoff: Standoff, path: Flown, tolerance: float) -> StandoffKept:
        """The term near a path."""
        if len(standoff.station) == 0:
            return cls(standoff, np.ones(0), tolerance)
        distance = np.linalg.norm(path.positions[standoff.station][:, None] - standoff.seen, axis=2)
        return cls(standoff, distance.mean(axis=1) / np.median(distance, axis=1), tolerance)

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared excess, and its slope."""
        asked, slope, nothing = self.standoff, np.zeros_like(flown.positions), np.zeros(len(flown))
        if len(asked.station) == 0:
            return 0.0, Flown(slope, nothing, nothing)
        ray = flown.positions[asked.station][:, None] - asked.seen
        distance = np.maximum(np.linalg.norm(ray, axis=2), 1e-9)
        wanted = asked.wanted_m * self.ratio
        off = distance.mean(axis=1) / wanted - 1
        excess = np.sign(off) * np.maximum(np.abs(off) - self.tolerance, 0)
        each = (ray / distance[:, :, None]).mean(axis=1) / wanted[:, None]
        np.add.at(slope, asked.station, (2 / len(off) * excess)[:, None] * each)
        return float((excess**2).mean()), Flown(slope, nothing, nothing)
