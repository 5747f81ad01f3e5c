"""Required surface of a structure and its required quality, sample by sample."""

from dataclasses import dataclass

from upplied.records.base import Bools, Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class RequiredSurface(Record):
    """Samples of a whole surface, with the requirements of those in a zone."""

    points: Floats  # (S, 3) m, declared frame of the structure
    normals: Floats  # (S, 3) unit, outward
    zone: Bools  # (S,) whether it must be seen; other samples define the boundary of the zone
    gsd_m: Floats  # (S,) maximum ground sample distance; infinite without a requirement
    incidence_deg: Floats  # (S,) maximum angle from the normal; 90 without a requirement
