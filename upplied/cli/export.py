"""`upplied export`, `brief`, `fly` and `render`: a plan as a mission, for the pilot and in wind; pictures."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.options import DemonstrationId, PlanId, StructureId
from upplied.cli.terminal import HERE, PRINTED, Results, Where, beside, compared, errors, hint, say
from upplied.files import replace_file
from upplied.outputs.labels import LABELS
from upplied.outputs.mission_options import MissionOptions

Format = Annotated[
    Literal["qgc-plan", "mavlink", "dji-wpml", "litchi", "kml", "geojson", "mcap", "csv"],
    Parameter(help="Format of the mission."),
]
_OUTPUT = ("--output", "-o")
File = Annotated[Path, Parameter(_OUTPUT, help="File to write; several flights are numbered.")]
Html = Annotated[Path, Parameter(_OUTPUT, help="HTML file to write.")]
TowardsOption = Annotated[float, Parameter(help="Wind direction in degrees, counter-clockwise from +X.")]
render = App(name="render", help="Draw a structure, a transfer, or the presets side by side, as PNG.")
PictureOption = Annotated[Path, Parameter(_OUTPUT, help="PNG file to write.")]
_VIEW = "View: three-quarter, other side, perspective, side, front, top or below."
ViewOption = Annotated[str | None, Parameter(help=_VIEW)]
Flags = Annotated[MissionOptions | None, Parameter("*")]


def export(transfer: PlanId, /, *, to: Format, output: File, flags: Flags = None, where: Where = HERE) -> int:
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
    transfer: PlanId, /, *, to: Format = "qgc-plan", output: Html, flags: Flags = None, where: Where = HERE
) -> int:
    """Write the pilot's brief: map, heights, flights, verdict.

    It is one page, A4 when printed, with the options and safety checks of `upplied export`.
    """
    from upplied.outputs.render import brief_transfer

    with errors.status("writing the brief"):
        say(brief_transfer(*where.plan(transfer), to, beside(output), flags))
    hint("Next: open it in a browser and print it, as PDF or on paper")
    return 0


def fly(
    transfer: PlanId,
    /,
    *,
    wind: Annotated[float, Parameter(help="Mean wind speed, in m/s.")] = 5.0,
    towards: TowardsOption = 60.0,
    gusts: Annotated[bool, Parameter(negative="--no-gusts", help="Add gusts.")] = True,
    seed: Annotated[int, Parameter(help="Random seed of gusts and errors.")] = 0,
    force: Annotated[tuple[str, ...], Parameter(help="Safety rule to overrule, by name.")] = (),
    results: Results = PRINTED,
) -> int:
    """Simulate a plan in wind and show its margin; the next report includes the result.

    Exit code 1 if the flight comes nearer to the structure than the clearance limit.
    """
    from upplied.catalog.verbs.recipes import settings_of
    from upplied.fleet.flights import fly_plan
    from upplied.simulate import Wind

    store, transfer = results.plan(transfer)
    with errors.status("flying"):
        flown = fly_plan(store, transfer, Wind(wind, towards, gusts), seed, force)
    row = store.transfer(transfer)
    route = settings_of(row["settings_json"]).route
    rows = compared(LABELS["simulated"], {"planned": row, "flown": flown}, ("change", "flown", "planned"))
    results.show(f"{transfer} in {wind:g} m/s of wind", rows)
    if not route.enforce:
        return 0
    margin = flown["min_clearance_m"] - route.clearance_m
    results.say(f"margin above the limit of {route.clearance_m:g} m: {margin:+.2f} m")
    if margin < 0:
        advice = "plan with a larger --clearance, or fly in less wind"
        errors.print(f"Too little clearance in this wind: {advice}.")
    else:
        results.next_step(f"export {transfer} --to qgc-plan --output mission.plan", "write the mission file")
    return int(margin < 0)


@render.command
def structure(id: StructureId, /, *, output: PictureOption, where: Where = HERE) -> int:
    """Draw a structure from three sides, with its demonstrations."""
    from upplied.outputs.render import render_structure

    with errors.status("drawing"):
        return _saved(output, render_structure(where.opened(), id))


@render.command
def transfer(id: PlanId, /, *, output: PictureOption, view: ViewOption = None, where: Where = HERE) -> int:
    """Draw a demonstration on its structure, and its plan on the target."""
    from upplied.outputs.render import render_transfer

    with errors.status("drawing"):
        return _saved(output, render_transfer(*where.plan(id), view))


@render.command
def comparison(
    demonstration: DemonstrationId,
    target: StructureId,
    /,
    *,
    output: PictureOption,
    view: ViewOption = None,
    where: Where = HERE,
) -> int:
    """Draw the newest plan of each preset side by side."""
    from upplied.outputs.render import render_comparison

    with errors.status("drawing"):
        return _saved(output, render_comparison(where.opened(), demonstration, target, view))


def _saved(output: Path, png: bytes) -> int:
    say(replace_file(beside(output), png))
    return 0
