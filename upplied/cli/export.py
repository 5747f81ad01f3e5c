"""`upplied export` and `upplied brief`: a plan as a mission file, and its page for the pilot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from upplied.cli.options import PlanArgument
from upplied.cli.terminal import HERE, Where, beside, errors, hint, say
from upplied.outputs.mission_options import MissionOptions

Format = Literal["qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"]
FormatOption = Annotated[Format, Parameter(help="Format of the mission.")]
OutputOption = Annotated[Path, Parameter(("--output", "-o"))]
MissionFlags = Annotated[MissionOptions | None, Parameter("*")]


def export(
    transfer: PlanArgument,
    /,
    *,
    to: FormatOption,
    output: Annotated[OutputOption, Parameter(help="File to write; several flights are numbered.")],
    flags: MissionFlags = None,
    where: Where = HERE,
) -> int:
    """Write a plan as a mission file for an autopilot or a map, with its assumptions as notes.

    Each flight is a file. Vehicle and clearance come from the parameters of the plan (`upplied settings`)
    unless an option overrides them.
    """
    from upplied.outputs.missions.flying import OPENED_IN
    from upplied.outputs.render import export_transfer

    with errors.status("writing the mission"):
        written = export_transfer(*where.plan(transfer), to, beside(output), flags)
    for path in written.paths:
        say(path)
    for note in written.notes:
        say(f"note: {note}")
    hint(f"Next: read the notes, then open the mission in {OPENED_IN[to]}")
    return 0


def brief(
    transfer: PlanArgument,
    /,
    *,
    to: FormatOption = "qgc-plan",
    output: Annotated[OutputOption, Parameter(help="HTML file to write.")],
    flags: MissionFlags = None,
    where: Where = HERE,
) -> int:
    """Write the pilot's brief: map, heights, flights, verdict.

    It is one page, A4 when printed, with the options and safety checks of `upplied export`.
    """
    from upplied.outputs.render import brief_transfer

    with errors.status("writing the brief"):
        say(brief_transfer(*where.plan(transfer), to, beside(output), flags))
    hint("Next: open it in a browser and print it, as PDF or on paper")
    return 0
