"""A structure brought onto another by a smooth displacement that knows no parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from upplied.planning.correspondence.coherent_point_drift import Patch, drift, spread_over
from upplied.planning.geometry.boxes import diagonal_of
from upplied.records import Cloud, Floats, Record

_CONTROLS, _ANCHORS = 200, 450  # points that move, and points that pull (`correspondence.by_parts`)


def brought_onto(whole: Cloud, known: Cloud) -> Cloud:
    """A structure, `known`, by a smooth displacement brought onto another that it is registered with."""
    return replace(known, points=_displaced(_Two(whole, known)))


@dataclass(frozen=True, eq=False, repr=False)
class _Two(Record):
    """A surface and another one, the same as two that lie and face alike, whatever parts they have."""

    whole: Cloud
    known: Cloud

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Two) and all(map(np.array_equal, self._shape(), other._shape()))

    def __hash__(self) -> int:
        return hash((self.whole.points[:1].tobytes(), self.known.points[:1].tobytes()))

    def _shape(self) -> tuple[Floats, ...]:
        return self.whole.points, self.whole.outward, self.known.points, self.known.outward


@lru_cache(maxsize=1)  # parts, what carries them, and what was never scanned follow from the same one
def _displaced(two: _Two) -> Floats:
    whole, known = two.whole, two.known
    none = np.full(len(known), -1), np.full(len(whole), -1)
    moving = Patch(known.points, known.outward, none[0])
    fixed = Patch(whole.points, whole.outward, none[1])
    found = drift(
        moving.rows(spread_over(known, _CONTROLS)),
        fixed.rows(spread_over(whole, _ANCHORS)),
        diagonal_of(whole.points),
    )
    return moving.points + found.at(moving.points, moving.label)
