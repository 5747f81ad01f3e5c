"""How each flight saw each patch of its structure: ``looks/<sha256>.parquet``, columns of small numbers.

A patch is a sample of the structure's surface, as plans are judged on; only those that were seen are listed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from upplied.records import Floats, Ints, Record


@dataclass(frozen=True, eq=False, repr=False)
class StoredLooks(Record):
    """The nearest look of one flight at each patch that it saw."""

    samples_sha256: str  # where the patches are, as of surfaces
    patch: Ints  # (K,) rising; small numbers
    distance_m: Floats  # (K,) single precision, as are the others
    incidence_deg: Floats  # (K,)
    speed_mps: Floats  # (K,)
    t_s: Floats  # (K,) from the first pose
    pictures: Ints | None = None  # (K,) that show it; None: not counted then
    # Of the most frontal look; None: not told then.
    frontal_distance_m: Floats | None = field(default=None, metadata={"later": True})  # (K,)
    frontal_incidence_deg: Floats | None = field(default=None, metadata={"later": True})  # (K,)
