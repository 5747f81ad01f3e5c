"""Surface of a structure that must be seen, and how: what zones ask for, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

from upplied.records.base import Bools, Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class RequiredSurface(Record):
    """Samples of a whole surface, and what is asked of each that lies in a zone."""

    points: Floats  # (S, 3) m, declared frame of the structure
    normals: Floats  # (S, 3) unit, outward
    zone: Bools  # (S,) must be seen; the others are there so that a place is told from its neighbours
    gsd_m: Floats  # (S,) a pixel covers this much at most; infinite where that is not asked
    incidence_deg: Floats  # (S,) from the normal, at most; 90 where that is not asked
