"""`upplied render`: pictures from the catalog."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import DemonstrationArgument, PlanArgument, StructureArgument
from upplied.cli.terminal import HERE, Where, beside, errors, say
from upplied.files import replace_file

app = App(name="render", help="Draw a structure, a transfer, or the presets side by side, as PNG.")
OutputOption = Annotated[Path, Parameter(("--output", "-o"), help="PNG file to write.")]
ViewOption = Annotated[
    str | None, Parameter(help="View: three-quarter, other side, perspective, side, front, top or below.")
]


@app.command
def structure(id: StructureArgument, /, *, output: OutputOption, where: Where = HERE) -> int:
    """Draw a structure from three sides, with its demonstrations."""
    from upplied.outputs.render import render_structure

    with errors.status("drawing"):
        return _saved(output, render_structure(where.opened(), id))


@app.command
def transfer(
    id: PlanArgument, /, *, output: OutputOption, view: ViewOption = None, where: Where = HERE
) -> int:
    """Draw a demonstration on its structure, and its plan on the target."""
    from upplied.outputs.render import render_transfer

    with errors.status("drawing"):
        return _saved(output, render_transfer(*where.plan(id), view))


@app.command
def comparison(
    demonstration: DemonstrationArgument,
    target: StructureArgument,
    /,
    *,
    output: OutputOption,
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
