"""`upplied render`: pictures of what the catalog holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import CatalogOption, PlanArgument, StructureArgument
from upplied.cli.terminal import beside, errors, opened, say

app = App(name="render", help="Draw a structure, a transfer, or the presets side by side, as PNG.")

OutputOption = Annotated[Path, Parameter(name=("--output", "-o"), help="The PNG to write.")]
ViewOption = Annotated[
    str | None,
    Parameter(name="--view", help="three-quarter, other side, perspective, side, front, top or below."),
]


@app.command
def structure(id: StructureArgument, /, *, output: OutputOption, catalog: CatalogOption = "catalog") -> int:
    """Draw a structure from three sides, with its demonstrations."""
    from upplied.outputs.render import render_structure

    with errors.status("drawing"):
        return _saved(output, render_structure(opened(catalog), id))


@app.command
def transfer(
    id: PlanArgument, /, *, output: OutputOption, view: ViewOption = None, catalog: CatalogOption = "catalog"
) -> int:
    """Draw a demonstration on its structure, and its plan on the target."""
    from upplied.outputs.render import render_transfer

    store = opened(catalog)
    with errors.status("drawing"):
        return _saved(output, render_transfer(store, store.find_transfer(id), view))


@app.command
def comparison(
    demonstration: str,
    target: str,
    /,
    *,
    output: OutputOption,
    view: ViewOption = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Draw the newest plan of each preset side by side.

    Parameters
    ----------
    demonstration : str
        ID of the demonstration.
    target : str
        ID of the target structure.
    """
    from upplied.outputs.render import render_comparison

    with errors.status("drawing"):
        return _saved(output, render_comparison(opened(catalog), demonstration, target, view))


def _saved(output: Path, png: bytes) -> int:
    from upplied.outputs.files import replace_file

    say(replace_file(beside(output), png))
    return 0
