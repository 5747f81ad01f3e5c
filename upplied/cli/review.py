"""`upplied review`, `release`, `reject`, `edit`, `in-force` and `keys`: what people decide, and who may."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from upplied.cli.options import By, Note, OnlyKind, OnlyStructure, PersonArgument, PlanId, Texts
from upplied.cli.terminal import HERE, PRINTED, Results, Where, beside, compared, complain, errors, say
from upplied.errors import SettingsError
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog.verbs.roster import Roster

keys = App(name="keys", help="Manage who may release plans, and their signing keys.")
_RULES = "Rule to overrule: preset, verdict, rejected, recalled or changed."
Force = Annotated[Texts, Parameter(help=_RULES)]
Out = Annotated[Path | None, Parameter(help="Write the viewpoints to this file for editing.")]
From = Annotated[Path | None, Parameter("--from", help="Import the edited file.")]


def review(transfer: PlanId, /, *, by: By = "", note: Note = "", results: Results = PRINTED) -> int:
    """Compare a plan with the one in force; with --by, record the review."""
    store, plan = results.plan(transfer)
    if by:
        store.review(plan, by, note)
    every = store.transfers(every=True)
    row = every[every["transfer_id"] == plan].iloc[-1]
    same = (every["demonstration_id"] == row["demonstration_id"]) & (every["target_id"] == row["target_id"])
    force = every[same & (every["purpose"] == row["purpose"]) & (every["state"] == "released")]
    rows = {"this plan": row}
    if not force.empty and force.iloc[-1]["transfer_id"] != plan:
        rows["in force"] = force.iloc[-1]
    lines = compared(LABELS["review"], rows, ("difference", "this plan", "in force"))
    results.show(f"{plan}, {row['state'] or row['status']}", lines)
    for text in filter(None, (row["reason"], row["not_flyable"], row["state_note"])):
        results.say(text)
    if row["state"] in ("draft", "reviewed"):
        results.next_step(f"release {plan} --by NAME", "put it in force")
    return 0


def release(transfer: PlanId, /, *, by: By, note: Note = "", force: Force = (), where: Where = HERE) -> int:
    """Release a plan: it is in force, for its demonstration and target, until another is released."""
    store, plan = where.plan(transfer)
    store.release(plan, by, note, force)
    say(f"{plan} is in force, released by {by}")
    where.next_step(f"export {plan} --to qgc-plan --output mission.plan", "write the mission file")
    return 0


def reject(transfer: PlanId, /, *, by: By, note: Note = "", where: Where = HERE) -> int:
    """Reject a plan: it must not be flown. If it was in force, no plan is in force afterwards."""
    store, plan = where.plan(transfer)
    store.reject(plan, by, note)
    say(f"{plan} is rejected")
    return 0


def in_force(*, structure: OnlyStructure = None, kind: OnlyKind = None, results: Results = PRINTED) -> int:
    """List the released plans and the drafts that wait.

    Exit code 1 if a plan was recalled and not replaced, or if a stored plan differs from its release.
    """
    store = results.opened()
    plans = store.in_force(structure=structure, kind=kind)
    recalled = store.recalled(structure=structure)
    results.show_frame("in force", plans, LABELS["in_force"])
    for row in recalled.to_dict("records"):
        what = f"recalled: {row['transfer_id']}, {row['demonstration_id']} on {row['target_id']}"
        complain(f"{what}: {row['state_note']}")
    altered = plans[plans["altered"] != ""]
    for row in altered.to_dict("records"):
        complain(f"differs from the release: {row['transfer_id']} on {row['target_id']}: {row['altered']}")
    return int(bool(len(recalled) or len(altered)))


def edit(transfer: PlanId, /, *, out: Out = None, read: From = None, by: By = "", where: Where = HERE) -> int:
    """Edit a plan as a file: move, turn or remove viewpoints, add keep-out boxes.

    The viewpoints are written as JSON; the edited file is imported as a new draft.
    """
    from upplied.fleet.edits import edit_plan, write_edit

    if (out is None) == (read is None):
        raise SettingsError("upplied edit", "both or neither of --out and --from", "exactly one of them")
    store, plan = where.plan(transfer)
    if out is not None:
        with errors.status("reading the plan"):
            say(write_edit(store, plan, beside(out)))
        where.next_step(f"edit {plan} --from {out} --by NAME", "import the edited file")
        return 0
    assert read is not None
    with errors.status("checking the edited plan"):
        outcome = edit_plan(store, plan, read, by)
    row = store.transfer(outcome)
    say(f"{outcome}: {store.plan(outcome).warnings[0]}")
    shown, clearance = row["coverage_inspected_pct"], row["min_clearance_m"]
    say(f"inspected {'?' if shown is None else f'{shown:.1f}'} %, clearance {clearance:.2f} m")
    where.next_step(f"review {outcome}", "compare it with the one in force")
    return int(not row["flyable"])


@keys.command
def new(name: PersonArgument, /, *, where: Where = HERE) -> int:
    """Generate a key pair; the private key stays on this machine."""
    from upplied.catalog.verbs.roster import key_path, new_key

    public = new_key(name)
    say(f"{name}: public key {public}")
    say(f"private key in {key_path(name)}: keep it to yourself")
    where.next_step(f"keys add {name!r} {public}", "allow this person to release")
    return 0


@keys.command
def add(name: PersonArgument, key: str, /, *, where: Where = HERE) -> int:
    """Add a person to the roster. Once there is one, only listed people may release, and they sign.

    Parameters
    ----------
    key : str
        The public key, as `upplied keys new` prints it.
    """
    roster = _roster(where)
    roster.add(name, key)
    say(f"{name} may release; roster {roster.path}")
    return 0


@keys.command
def retire(name: PersonArgument, /, *, where: Where = HERE) -> int:
    """Remove a person from the roster; earlier releases stay in force."""
    decisions = where.opened().decisions()
    _roster(where).retire(name, "" if decisions.empty else str(decisions["decision_id"].iloc[-1]))
    say(f"{name} may no longer release")
    return 0


@keys.command(name="list")
def list_people(*, results: Results = PRINTED) -> int:
    """List who may release; without a roster everybody may."""
    people = _roster(results).people or []
    rows = [{"name": one.name, "key": one.key, "may release": not one.until} for one in people]
    results.show("roster", rows)
    return 0


def _roster(where: Where) -> Roster:
    from upplied.catalog.verbs.roster import Roster

    store = where.opened()
    store.identity.required()
    return Roster(store.location)
