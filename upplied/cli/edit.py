"""`upplied edit`: a plan out as a file, and back as a person changed it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.options import ByOption, CatalogOption, PlanArgument
from upplied.cli.terminal import beside, console, errors, next_step, opened_at, say

app = App(name="edit", help="Edit a plan as a file: move, turn or remove viewpoints, add keep-out boxes.")


@app.default
def edit(
    transfer: PlanArgument,
    /,
    *,
    out: Annotated[Path | None, Parameter(help="Write the viewpoints to this file for editing.")] = None,
    read: Annotated[Path | None, Parameter(name="--from", help="Import the edited file.")] = None,
    by: ByOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Write a plan's viewpoints as JSON, or import the edited file as a new draft."""
    from upplied.errors import SettingsError
    from upplied.fleet.edits import edit_plan, write_edit

    if (out is None) == (read is None):
        raise SettingsError("upplied edit", "both or neither of --out and --from", "exactly one of them")
    store, plan = opened_at(catalog, transfer)
    if out is not None:
        say(write_edit(store, plan, beside(out)))
        next_step(f"edit {plan} --from {out} --by NAME", "import the edited file", catalog)
        return 0
    assert read is not None
    with errors.status("checking the edited plan"):
        outcome = edit_plan(store, plan, read, by)
    row = store.transfer(outcome)
    say(f"{outcome}: {store.plan(outcome).warnings[0]}")
    shown, clearance = row["coverage_inspected_pct"], row["min_clearance_m"]
    console.print(f"inspected {'?' if shown is None else f'{shown:.1f}'} %, clearance {clearance:.2f} m")
    next_step(f"review {outcome}", "compare it with the one in force", catalog)
    return int(not row["flyable"])
