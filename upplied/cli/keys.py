"""`upplied keys`: who may release plans, and the keys that they sign with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cyclopts import App

from upplied.cli.options import CatalogOption, JsonOption
from upplied.cli.terminal import next_step, opened, say, show

if TYPE_CHECKING:
    from upplied.catalog.verbs.roster import Roster

app = App(name="keys", help="Manage who may release plans, and their signing keys.")


@app.command
def new(name: str, /, *, catalog: CatalogOption = "catalog") -> int:
    """Generate a key pair; the private key stays on this machine.

    Parameters
    ----------
    name : str
        Name of the person.
    """
    from upplied.catalog.verbs.roster import key_path, new_key

    public = new_key(name)
    say(f"{name}: public key {public}")
    say(f"private key in {key_path(name)}: keep it to yourself")
    next_step(f"keys add {name!r} {public}", "allow this person to release", catalog)
    return 0


@app.command
def add(name: str, key: str, /, *, catalog: CatalogOption = "catalog") -> int:
    """Add a person to the roster. Once there is one, only listed people may release, and they sign.

    Parameters
    ----------
    key : str
        The public key, as `upplied keys new` prints it.
    """
    roster = _roster(catalog)
    roster.add(name, key)
    say(f"{name} may release; roster {roster.path}")
    return 0


@app.command
def retire(name: str, /, *, catalog: CatalogOption = "catalog") -> int:
    """Remove a person from the roster; earlier releases stay in force."""
    decisions = opened(catalog).decisions()
    _roster(catalog).retire(name, "" if decisions.empty else str(decisions["decision_id"].iloc[-1]))
    say(f"{name} may no longer release")
    return 0


@app.command(name="list")
def list_people(*, catalog: CatalogOption = "catalog", json: JsonOption = False) -> int:
    """List who may release; without a roster everybody may."""
    people = _roster(catalog).people or []
    rows = [{"name": one.name, "key": one.key, "may release": not one.until} for one in people]
    show("roster", rows, json)
    return 0


def _roster(location: str) -> Roster:
    from upplied.catalog.verbs.roster import roster_of

    store = opened(location)
    store.identity.required()
    return roster_of(store)
