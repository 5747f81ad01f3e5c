"""Place: how far the path departs, in metres, from where the counterparts carried it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Place(Record):
    """Mean squared departure in units of the usual stand-off; 1 where all of the path strays by it."""

    carried: Floats  # (M, 3) m
    unit_m: float

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared departure, and its slope."""
        off = (flown.positions - self.carried) / self.unit_m
        nothing = np.zeros(len(off))
        return float((off**2).sum(axis=1).mean()), Flown(2 / len(off) * off / self.unit_m, nothing, nothing)
