"""Options and arguments that several commands have, with their help."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

CatalogOption = Annotated[
    str,
    Parameter(name="--catalog", env_var="UPPLIED_CATALOG", help="Folder or object-store URI of the catalog."),
]
JsonOption = Annotated[bool, Parameter(name="--json", help="Print JSON instead of a table.")]
WorkersOption = Annotated[int, Parameter(name="--workers", help="Number of processes; 0 uses one per core.")]
ByOption = Annotated[str, Parameter(name="--by", help="Your name, stored with the decision.")]
NoteOption = Annotated[str, Parameter(name="--note", help="Reason, shown on the page of the plan.")]
AllowOption = Annotated[
    tuple[str, ...], Parameter(name="--allow", help="Name of a rule to overrule; repeatable.")
]
RuleOption = Annotated[tuple[str, ...], Parameter(name="--set", help="Limit of a rule, as NAME=VALUE.")]
StrictOption = Annotated[bool, Parameter(help="Treat warnings as refusals.")]

PlanArgument = Annotated[str, Parameter(help="ID of the plan, or its beginning.")]
DemonstrationArgument = Annotated[str, Parameter(help="ID of the demonstration.")]
FindingArgument = Annotated[str, Parameter(help="ID of the finding, or its beginning.")]
FlightArgument = Annotated[str, Parameter(help="ID of the flight, or its beginning.")]
StructureArgument = Annotated[str, Parameter(help="ID of the structure.")]
OwnerArgument = Annotated[str, Parameter(help="ID of a structure, or a kind with --kind.")]
KindOption = Annotated[bool, Parameter(help="OWNER is a kind, not a structure.")]
