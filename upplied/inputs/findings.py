"""What was found in a mesh file, and what was done about it."""

from __future__ import annotations

from dataclasses import dataclass

from upplied.inputs.outliers import Outlier
from upplied.inputs.repair import Repairs
from upplied.inputs.rules import Verdict, refusals
from upplied.records import Record


@dataclass(frozen=True, eq=False, repr=False)
class Findings(Record):
    """Of one file; lengths in metres in the structure frame, triangles after repair."""

    unit_m: float
    unit_from: str  # "manifest", "file" or "assumed"
    up: str
    forward: str
    repairs: Repairs
    parts: int = 0  # connected, welded
    hidden_parts: int = 0  # that no outside ray reaches
    hidden_triangles: int = 0
    area_m2: float = 0.0
    outside_area_m2: float = 0.0  # that can be seen from outside, each face counted once
    watertight: bool = False
    boundary_edges: int = 0
    nonmanifold_edges: int = 0
    outliers: tuple[Outlier, ...] = ()
    done: tuple[str, ...] = ()  # what was repaired, converted or dropped, in words
    assumed: tuple[str, ...] = ()  # where nothing declares the file
    verdicts: tuple[Verdict, ...] = ()  # the rules that it breaks

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should look at, in words."""
        odd = (verdict for verdict in self.verdicts if verdict.severity == "warn")
        return (*self.assumed, *(verdict.found for verdict in odd))

    @property
    def problems(self) -> tuple[Verdict, ...]:
        """Why it is refused."""
        return refusals(self.verdicts)
