"""How each flight saw each patch of its structure: ``looks/<sha256>.parquet``, columns of small numbers.

A patch is a sample of the structure's surface, as plans are judged on; only those that were seen are listed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

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
    # 1 where it was seen only if the correction of the log is right; None: nothing was corrected.
    assumed: Ints | None = field(default=None, metadata={"later": True})  # (K,)
    # 1 where it was looked at as its plan asks; None: not asked then.
    inspected: Ints | None = field(default=None, metadata={"later": True})  # (K,)

    @property
    def as_asked(self) -> Ints:
        """The patches that were certainly looked at as the plan asks; where that is not known, all seen."""
        certain = self.certain
        return certain.patch if certain.inspected is None else certain.patch[certain.inspected > 0]

    @property
    def certain(self) -> StoredLooks:
        """The looks that do not depend on a correction of the log."""
        if self.assumed is None:
            return self
        columns = [item.name for item in fields(self) if item.name not in ("samples_sha256", "assumed")]
        values = {name: getattr(self, name) for name in columns}
        known = {name: value[self.assumed == 0] for name, value in values.items() if value is not None}
        return replace(self, assumed=None, **known)
