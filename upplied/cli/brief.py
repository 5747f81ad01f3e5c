"""`upplied brief`: one printed page about a plan, for the pilot."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.export import Flags, Format
from upplied.cli.terminal import CatalogOption, beside, errors, hint, opened, say

app = App(name="brief", help="Write the pilot's brief: map, heights, flights, verdict.")


@app.default
def brief(
    transfer: str,
    /,
    *,
    to: Annotated[Format, Parameter(help="Format of the mission.")] = "qgc-plan",
    output: Annotated[Path, Parameter(name=("--output", "-o"), help="HTML file to write.")],
    flags: Flags | None = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write one page, A4 when printed, with the options and safety checks of `upplied export`.

    Parameters
    ----------
    transfer : str
        ID of the plan, or its beginning.
    """
    from upplied.outputs.missions import MissionOptions
    from upplied.outputs.render import brief_transfer

    options = MissionOptions(**asdict(flags or Flags()))
    store = opened(catalog)
    with errors.status("writing the brief"):
        made = brief_transfer(store, store.find_transfer(transfer), to, beside(output), options)
    say(made)
    hint("Next: open it in a browser and print it, as PDF or on paper")
    return 0
