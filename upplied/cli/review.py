"""`upplied review`, `release`, `reject`, `edit` and `in-force`: what people change and decide."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.options import ByOption, CatalogOption, JsonOption, NoteOption, PlanArgument
from upplied.cli.terminal import (
    beside,
    complain,
    console,
    errors,
    next_step,
    number,
    opened,
    opened_at,
    say,
    show,
    show_frame,
)

if TYPE_CHECKING:
    import pandas as pd

reviewing = App(name="review", help="Compare a plan with the one in force, and record a review.")
releasing = App(name="release", help="Release a plan: it is in force until another is released.")
rejecting = App(name="reject", help="Reject a plan: it must not be flown.")
editing = App(name="edit", help="Edit a plan as a file: move, turn or remove viewpoints, add keep-out boxes.")
in_force = App(name="in-force", help="List the released plans and the drafts that wait.")

COMPARED = {
    "coverage_inspected_pct": "inspected surface shown, %",
    "coverage_seen_pct": "surface seen, %",
    "min_clearance_m": "minimum clearance, m",
    "duration_s": "duration, s",
    "path_length_m": "length, m",
    "n_viewpoints": "viewpoints",
}
LISTED = {
    "transfer_id": "in force",
    "demonstration_id": "demonstration",
    "target_id": "target",
    "state_by": "released by",
    "state_at": "at",
    "coverage_inspected_pct": "inspected %",
    "min_clearance_m": "clear m",
    "newer_draft": "newer draft",
    "altered": "differs from the release",
}


@reviewing.default
def review(
    transfer: PlanArgument,
    /,
    *,
    by: ByOption = "",
    note: NoteOption = "",
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """Compare a plan with the one in force; with --by, record the review."""
    store, plan = opened_at(catalog, transfer)
    if by:
        store.review(plan, by, note)
    every = store.transfers(every=True)
    row = every[every["transfer_id"] == plan].iloc[-1]
    same = (every["demonstration_id"] == row["demonstration_id"]) & (every["target_id"] == row["target_id"])
    force = every[same & (every["purpose"] == row["purpose"]) & (every["state"] == "released")]
    other = None if force.empty or force.iloc[-1]["transfer_id"] == plan else force.iloc[-1]
    show(f"{plan}, {row['state'] or row['status']}", _compared(row, other), json)
    if not json:
        for text in filter(None, (row["reason"], row["not_flyable"], row["state_note"])):
            say(text)
        if row["state"] in ("draft", "reviewed"):
            next_step(f"release {plan} --by NAME", "put it in force", catalog)
    return 0


def _compared(row: pd.Series, other: pd.Series | None) -> list[dict[str, Any]]:
    rows = []
    for name, title in COMPARED.items():
        this = number(row[name])
        line: dict[str, Any] = {"measure": title, "this plan": this}
        if other is not None:
            that = number(other[name])
            line["in force"] = that
            line["difference"] = None if this is None or that is None else this - that
        rows.append(line)
    return rows


@releasing.default
def release(
    transfer: PlanArgument,
    /,
    *,
    by: ByOption,
    note: NoteOption = "",
    force: Annotated[
        tuple[str, ...], Parameter(help="Rule to overrule: preset, verdict, rejected, recalled or changed.")
    ] = (),
    catalog: CatalogOption = "catalog",
) -> int:
    """Put a plan in force for its demonstration and target."""
    store, plan = opened_at(catalog, transfer)
    store.release(plan, by, note, force)
    say(f"{plan} is in force, released by {by}")
    next_step(f"export {plan} --to qgc-plan --output mission.plan", "write the mission file", catalog)
    return 0


@rejecting.default
def reject(
    transfer: PlanArgument, /, *, by: ByOption, note: NoteOption = "", catalog: CatalogOption = "catalog"
) -> int:
    """Reject a plan. If it was in force, no plan is in force afterwards."""
    store, plan = opened_at(catalog, transfer)
    store.reject(plan, by, note)
    say(f"{plan} is rejected")
    return 0


@in_force.default
def list_in_force(
    *,
    structure: Annotated[str | None, Parameter(help="Only plans of this structure.")] = None,
    kind: Annotated[str | None, Parameter(help="Only plans of this kind.")] = None,
    catalog: CatalogOption = "catalog",
    json: JsonOption = False,
) -> int:
    """List the released plans.

    Exit code 1 if a plan was recalled and not replaced, or if a stored plan differs from what was released.
    """
    store = opened(catalog)
    plans = store.in_force(structure=structure, kind=kind)
    recalled = store.recalled(structure=structure)
    show_frame("in force", plans, LISTED, json)
    for row in recalled.to_dict("records"):
        what = f"recalled: {row['transfer_id']}, {row['demonstration_id']} on {row['target_id']}"
        complain(f"{what}: {row['state_note']}")
    altered = plans[plans["altered"] != ""]
    for row in altered.to_dict("records"):
        complain(f"differs from the release: {row['transfer_id']} on {row['target_id']}: {row['altered']}")
    return int(bool(len(recalled) or len(altered)))


@editing.default
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
