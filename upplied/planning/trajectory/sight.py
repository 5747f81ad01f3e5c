"""What is in reach of a path, and what its cameras should look at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.terms.axis import Axis, aims_of, axes
from upplied.planning.trajectory.view import View
from upplied.records import Bools, Floats, Ints, Record

WIDEST = 0.20  # of the soft coverage's borders, in the first round
_OBLIQUE_DEG = 88.0  # up to which lines of sight are asked for: those beyond the limit may come within it


@dataclass(frozen=True, eq=False, repr=False)
class Sight(Record):
    """What is in reach of S stations of a path, every `stride`-th."""

    stride: int
    free: Bools  # (S, m) which samples each would see with its camera turned there
    axis: Axis

    @classmethod
    def of(
        cls, path: Flown, stride: int, view: View, samples: Ints, need: Floats, aside_rad: Floats
    ) -> Sight:
        """Of m samples with their need, by a path whose expert looked so far aside at its stations."""
        # As far again as the widest border reaches: the path moves until lines of sight are asked for again.
        farthest_m = (1 + 2 * WIDEST) * view.farthest_m
        oblique = replace(view.settings, max_incidence_deg=_OBLIQUE_DEG)
        nearly = replace(view, farthest_m=farthest_m, settings=oblique, least_cosine=None)
        places, station = path.positions[::stride], np.arange(0, len(path), stride)
        free = nearly.reach(places, samples, station)
        inspected = np.where(view.inspected[samples], need, 0.0)
        axis = axes(path.yaw[::stride], path.pitch[::stride])
        aims = aims_of(places, axis, view.cloud.points[samples], inspected, free)
        return cls(stride, free, Axis(aims, aside_rad[::stride], stride))
