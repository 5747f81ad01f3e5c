"""What keeps a path recognisable as the demonstrated one while it is bent to see more.

Two measures of the plan are kept in bounds at every step: the Frechet distance of its z-scored
path, and the distance from which each viewpoint sees its counterparts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.planning.carry.standoff import Standoff
from upplied.planning.geometry.frechet import frechet, within_leash, zscored
from upplied.records import Floats, Record

_ROUGHLY = 1e-3  # of a Frechet distance: enough to tell whether a path that strays comes nearer
_MOST = 0.96  # share of the viewpoints that must be so near


@dataclass(frozen=True, eq=False, repr=False)
class Likeness(Record):
    """The demonstrated shape and stand-off, and how far a path may depart from them."""

    shape: Floats  # (K, 3) demonstrated positions on the target, z-scored along the source's axes
    leash: float  # largest Frechet distance of the z-scored path from them
    standoff: Standoff
    standing: Floats = field(default_factory=lambda: np.eye(3))  # (3, 3) the target's axes to the source's

    def kept(self, tried: Floats, before: Floats) -> bool:
        """Whether a path keeps shape and stand-off, or departs no further than the one before."""
        share = self.standoff.share(tried)
        if share < _MOST and share < self.standoff.share(before):
            return False
        shape, earlier = zscored(tried @ self.standing.T), zscored(before @ self.standing.T)
        if within_leash(self.shape, shape, self.leash):
            return True
        if within_leash(self.shape, earlier, self.leash):
            return False
        return within_leash(self.shape, shape, frechet(self.shape, earlier, _ROUGHLY) / (1 + _ROUGHLY))
