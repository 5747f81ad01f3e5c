"""Leaving: how far the path goes from the carried flight, and how sharply: only for what that shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.polylines import leg_lengths
from upplied.records import Floats, Record

_SHORTEST = 0.1  # of the usual leg: what hovers is not torn apart


@dataclass(frozen=True, eq=False, repr=False)
class Leaving(Record):
    """Mean squared distance from the carried flight, and mean squared change of it on the way; in stand-offs.

    What shows as much from many places is flown where the expert's flight lies, whatever else changes.
    """

    carried: Floats  # (M, 3) m
    usual_m: float  # the stand-off
    share: Floats  # (M - 1,) of each leg, what a change over it counts

    @classmethod
    def of(cls, carried: Floats, usual_m: float) -> Leaving:
        """Leaving a flight (M, 3), m, of a usual stand-off."""
        leg = leg_lengths(carried) / usual_m
        leg = np.maximum(leg, max(_SHORTEST * float(leg.mean()), 1e-6)) if len(leg) else leg
        return cls(carried, usual_m, 1 / (leg * max(float(leg.sum()), 1.0)))

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared distance and change, and their slope."""
        off = (flown.positions - self.carried) / self.usual_m
        change = np.diff(off, axis=0)
        pull = self.share[:, None] * change
        slope = 2 / len(off) * off
        slope[1:] += 2 * pull
        slope[:-1] -= 2 * pull
        nothing = np.zeros(len(off))
        value = (off**2).sum() / len(off) + (pull * change).sum()
        return float(value), Flown(slope / self.usual_m, nothing, nothing)
