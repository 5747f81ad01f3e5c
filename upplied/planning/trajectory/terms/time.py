"""Time: how much longer the path takes than the carried one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.polylines import leg_lengths
from upplied.records import Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Time(Record):
    """Duration at the demonstrated speeds beyond that of the carried path, over it; hovering apart.

    A shorter path earns nothing: on its own structure a flight is not to be cut short.
    """

    slowness: Floats  # (M - 1,) 1/m, of each leg: s/m over that duration

    @classmethod
    def of(cls, carried: Flown, speed_mps: Floats) -> Time:
        """The term for the speeds (M,) at which the expert flew at the stations."""
        leg = leg_lengths(carried.positions)
        slowness = 2 / np.maximum(speed_mps[1:] + speed_mps[:-1], 1e-3)
        return cls(slowness / max(float((slowness * leg).sum()), 1e-9))

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Excess of the duration, and its slope."""
        leg = np.diff(flown.positions, axis=0)
        length = np.maximum(np.linalg.norm(leg, axis=1), 1e-9)
        pull = leg * (self.slowness / length)[:, None]
        slope, nothing = np.zeros_like(flown.positions), np.zeros(len(flown))
        slope[1:] += pull
        slope[:-1] -= pull
        excess = float((self.slowness * length).sum()) - 1
        if excess <= 0:
            return 0.0, Flown(np.zeros_like(slope), nothing, nothing)
        return excess, Flown(slope, nothing, nothing)
