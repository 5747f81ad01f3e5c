"""Options and arguments that several commands have, with their help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter

WorkersOption = Annotated[int, Parameter(help="Number of processes; 0 uses one per core.")]
Point = tuple[float, float, float]
PointArgument = Annotated[Point, Parameter(help="X Y Z of the point in metres, in the structure's frame.")]
OnlyStructure = Annotated[str | None, Parameter(help="Only this structure.")]
OnlyKind = Annotated[str | None, Parameter(help="Only structures of this kind.")]
DemonstrationArgument = Annotated[str, Parameter(help="ID of the demonstration.")]
PersonArgument = Annotated[str, Parameter(help="Name of the person.")]
ByOption = Annotated[str, Parameter(help="Your name, stored with the decision.")]
NoteOption = Annotated[str, Parameter(help="Reason, shown on the page of the plan.")]


@Parameter(name="*")
@dataclass(frozen=True)
class RuleFlags:
    """How strictly imports are checked."""

    allow: Annotated[tuple[str, ...], Parameter(help="Name of a rule to overrule; repeatable.")] = ()
    strict: Annotated[bool, Parameter(help="Treat warnings as refusals.")] = False
    set_: Annotated[tuple[str, ...], Parameter(name="--set", help="Limit of a rule, as NAME=VALUE.")] = ()


USUAL_RULES = RuleFlags()

PlanArgument = Annotated[str, Parameter(help="ID of the plan, or its beginning.")]
FindingArgument = Annotated[str, Parameter(help="ID of the finding, or its beginning.")]
FlightArgument = Annotated[str, Parameter(help="ID of the flight, or its beginning.")]
StructureArgument = Annotated[str, Parameter(help="ID of the structure.")]
OwnerArgument = Annotated[str, Parameter(help="ID of a structure, or a kind with --kind.")]
KindOption = Annotated[bool, Parameter(help="OWNER is a kind, not a structure.")]
