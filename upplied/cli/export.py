"""`upplied export` and `upplied brief`: a plan as a mission file, and its page for the pilot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption, PlanArgument
from upplied.cli.terminal import beside, errors, hint, opened, say
from upplied.outputs.mission_options import MissionOptions

app = App(name="export", help="Write a plan as a mission file for an autopilot or a map.")
briefing = App(name="brief", help="Write the pilot's brief: map, heights, flights, verdict.")

Format = Literal["qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"]
#: What a person looks at a mission of each format with, before it is flown.
OPENED_IN = {
    "qgc-plan": "QGroundControl",
    "mavlink": "QGroundControl or Mission Planner",
    "dji-wpml": "DJI Pilot 2",
    "litchi": "Litchi's mission hub",
    "kml": "Google Earth",
    "geojson": "QGIS",
    "mcap": "Foxglove",
    "csv": "any table or plot",
}


OutputOption = Annotated[Path, Parameter(name=("--output", "-o"))]
MissionFlags = Annotated[MissionOptions | None, Parameter(name="*")]


@app.default
def export(
    transfer: PlanArgument,
    /,
    *,
    to: Annotated[Format, Parameter(help="Format of the mission.")],
    output: Annotated[OutputOption, Parameter(help="File to write; several flights are numbered.")],
    flags: MissionFlags = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write a plan as a mission file, or as one for each flight, with its assumptions as notes.

    Vehicle and clearance come from the parameters of the plan (`upplied settings`) unless an option
    overrides them.
    """
    from upplied.outputs.render import export_transfer

    store = opened(catalog)
    with errors.status("writing the mission"):
        written = export_transfer(store, store.find_transfer(transfer), to, beside(output), flags)
    for path in written.paths:
        say(path)
    for note in written.notes:
        say(f"note: {note}")
    hint(f"Next: read the notes, then open the mission in {OPENED_IN[to]}")
    return 0


@briefing.default
def brief(
    transfer: PlanArgument,
    /,
    *,
    to: Annotated[Format, Parameter(help="Format of the mission.")] = "qgc-plan",
    output: Annotated[OutputOption, Parameter(help="HTML file to write.")],
    flags: MissionFlags = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write one page, A4 when printed, with the options and safety checks of `upplied export`."""
    from upplied.outputs.render import brief_transfer

    store = opened(catalog)
    with errors.status("writing the brief"):
        say(brief_transfer(store, store.find_transfer(transfer), to, beside(output), flags))
    hint("Next: open it in a browser and print it, as PDF or on paper")
    return 0
