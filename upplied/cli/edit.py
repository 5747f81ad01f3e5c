"""`upplied edit`: a plan out as a file, and back as a person changed it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from upplied.cli.review import ByOption
from upplied.cli.terminal import CatalogOption, beside, console, next_step, opened_at, say

app = App(name="edit", help="Change a plan: move, turn or leave out viewpoints, forbid boxes.")


@app.default
def edit(
    transfer: str,
    /,
    *,
    out: Annotated[Path | None, Parameter(help="Write its viewpoints to this file, to be changed.")] = None,
    read: Annotated[Path | None, Parameter(name="--from", help="Read that file again.")] = None,
    by: ByOption = "",
    catalog: CatalogOption = "catalog",
) -> int:
    """Write a plan's viewpoints as JSON, or read them as they were changed: a new draft, judged anew.

    Parameters
    ----------
    transfer : str
        Its id, or how that begins.
    """
    from upplied.errors import SettingsError
    from upplied.fleet.edits import edit_plan, write_edit

    if (out is None) == (read is None):
        raise SettingsError("upplied edit", "both or neither of --out and --from", "one of them")
    store, plan = opened_at(catalog, transfer)
    if out is not None:
        say(write_edit(store, plan, beside(out)))
        next_step(f"edit {plan} --from {out} --by NAME", "once it is changed", catalog)
        return 0
    assert read is not None
    made = edit_plan(store, plan, read, by)
    row = store.transfer(made)
    say(f"{made}: {store.plan(made).warnings[0]}")
    shown, clearance = row["coverage_inspected_pct"], row["min_clearance_m"]
    console.print(f"inspected {'?' if shown is None else f'{shown:.1f}'} %, clearance {clearance:.2f} m")
    next_step(f"review {made}", "beside the one in force", catalog)
    return int(not row["flyable"])
