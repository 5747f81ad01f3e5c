"""`upplied keys`: who may release plans, and the keys that they sign with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cyclopts import App

from upplied.cli.options import PersonArgument
from upplied.cli.terminal import HERE, PRINTED, Results, Where, say

if TYPE_CHECKING:
    from upplied.catalog.verbs.roster import Roster

app = App(name="keys", help="Manage who may release plans, and their signing keys.")


@app.command
def new(name: PersonArgument, /, *, where: Where = HERE) -> int:
    """Generate a key pair; the private key stays on this machine."""
    from upplied.catalog.verbs.roster import key_path, new_key

    public = new_key(name)
    say(f"{name}: public key {public}")
    say(f"private key in {key_path(name)}: keep it to yourself")
    where.next_step(f"keys add {name!r} {public}", "allow this person to release")
    return 0


@app.command
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


@app.command
def retire(name: PersonArgument, /, *, where: Where = HERE) -> int:
    """Remove a person from the roster; earlier releases stay in force."""
    decisions = where.opened().decisions()
    _roster(where).retire(name, "" if decisions.empty else str(decisions["decision_id"].iloc[-1]))
    say(f"{name} may no longer release")
    return 0


@app.command(name="list")
def list_people(*, results: Results = PRINTED) -> int:
    """List who may release; without a roster everybody may."""
    people = _roster(results).people or []
    results.show(
        "roster", [{"name": one.name, "key": one.key, "may release": not one.until} for one in people]
    )
    return 0


def _roster(where: Where) -> Roster:
    from upplied.catalog.verbs.roster import Roster

    store = where.opened()
    store.identity.required()
    return Roster(store.location)
