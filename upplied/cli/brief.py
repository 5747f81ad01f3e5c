"""`upplied brief`: one printed page about a plan, for the pilot."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.export import Flags, Format
from upplied.cli.terminal import CatalogOption, beside, hint, opened, say

app = App(name="brief", help="Write the page that a pilot takes along: map, heights, sorties, verdict.")


@app.default
def brief(
    transfer: str,
    /,
    *,
    to: Annotated[Format, Parameter(help="Format that it will be flown in.")] = "qgc-plan",
    output: Annotated[Path, Parameter(name=("--output", "-o"), help="The page, HTML.")],
    flags: Flags | None = None,
    catalog: CatalogOption = "catalog",
) -> int:
    """Write one page, A4 when printed; the same options as `upplied export`, and the same gate.

    Parameters
    ----------
    transfer : str
        Its id, as `upplied transfer` prints it, or how that begins.
    """
    from upplied.outputs.missions import MissionOptions
    from upplied.outputs.render import brief_transfer

    options = MissionOptions(**asdict(flags or Flags()))
    store = opened(catalog)
    made = brief_transfer(store, store.find_transfer(transfer), to, beside(output), options)
    say(made)
    hint("Next: open it in a browser and print it, as PDF or on paper")
    return 0
