"""`upplied catalog`: what is kept, how it came to be, and whether it is whole."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import App, Parameter

from upplied.cli.terminal import PRINTED, Results, console, errors, rows_of, say
from upplied.outputs.labels import LABELS

app = App(name="catalog", help="Inspect, check, export and maintain the catalog.")

LimitOption = Annotated[int, Parameter(help="Maximum number, the newest first.")]
HeadOption = Annotated[tuple[str, ...], Parameter(help="Head hash noted earlier; its row must exist.")]
SPARE = ("planned", "clear m", "inspected %")


@app.command
def info(*, results: Results = PRINTED) -> int:
    """Count the contents of the catalog."""
    store = results.opened()
    tables = {name: getattr(store, name)() for name in ("structures", "demonstrations", "transfers")}
    counts = {name: len(table) for name, table in tables.items()}
    for status, count in tables["transfers"]["status"].value_counts().sort_index().items():
        counts[f"transfers {status}"] = int(count)
    results.show(
        f"catalog {store.location}", [{"what": what, "count": count} for what, count in counts.items()]
    )
    return 0


@app.command(name="show")
def show_one(id: str, /, *, results: Results = PRINTED) -> int:
    """Show everything stored about a structure, a demonstration or a plan.

    Parameters
    ----------
    id : str
        ID of any of them; for a plan its beginning is enough.
    """
    from upplied.errors import CatalogError

    store = results.opened()
    rows = []
    for table, frame in (("structure", store.structures()), ("demonstration", store.demonstrations())):
        for row in rows_of(frame[frame[f"{table}_id"] == id]):
            rows.append({"what": table, **row})
    try:
        name = store.find_transfer(id)
        plans = store.transfers(every=True)
        current = name in set(store.transfers(columns=["transfer_id"])["transfer_id"])
        for row in rows_of(plans[plans["transfer_id"] == name]):
            rows.append({"what": "plan", "current": current, **row})
        rows += [{"what": "overruled for", **row} for row in rows_of(store.overruled(name))]
    except CatalogError:
        if not rows:
            raise
    if results.json:
        results.show("", rows)
        return 0
    for row in rows:
        texts = {name: _short(value) for name, value in row.items() if value is not None}
        filled = [{"column": name, "value": text} for name, text in texts.items() if text]
        results.show(f"{row['what']} {id}", filled)
    return 0


def _short(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 100 else f"{text[:97]}..."


@app.command
def history(*, limit: LimitOption = 30, results: Results = PRINTED) -> int:
    """List the commits, newest first, with time, table and operation."""
    from upplied.catalog import history as commits

    results.show("commits", rows_of(commits(results.opened(), limit)))
    return 0


@app.command
def diff(before: str, after: str | None = None, /, *, results: Results = PRINTED) -> int:
    """Show which plans changed between two times, and why.

    Parameters
    ----------
    before : str
        A time, as 2026-11-21T02:00:00Z, or a version of the table of transfers.
    after : str
        The same; by default now.
    """
    from upplied.catalog import diff as changed

    frame = changed(results.opened(), _when(before), None if after is None else _when(after))
    results.show_frame("changes", frame, LABELS["changes"], ("before", "seen %", "clear m"))
    return 0


@app.command
def transfers(*, results: Results = PRINTED) -> int:
    """List the newest plan of every demonstration, target and preset."""
    store = results.opened()
    frame = store.transfers()
    rules = store.overruled().groupby("transfer_id")["rule"].unique().map(lambda some: " ".join(sorted(some)))
    frame["overruled"] = frame["transfer_id"].map(rules).fillna("")
    results.show_frame("transfers", frame, LABELS["plans"] | {"overruled": "overruled"}, SPARE)
    return 0


@app.command(name="as-of")
def as_of(moment: str, /, *, results: Results = PRINTED) -> int:
    """List the plans as they were at a time.

    Parameters
    ----------
    moment : str
        As 2026-11-21 or 2026-11-21T02:00:00Z; without a zone it is UTC.
    """
    frame = results.opened().transfers(as_of=moment)
    results.show_frame(f"transfers as of {moment}", frame, LABELS["plans"], SPARE)
    return 0


@app.command
def verify(*, head: HeadOption = (), results: Results = PRINTED) -> int:
    """Check every byte, row, count, reference and hash, and print the head of each chain of rows.

    Heads are the hashes of the last rows. Briefs and missions note them, to be checked later.
    """
    from upplied.catalog import verify as check
    from upplied.catalog.verbs.custody import HEAD_DIGITS, chain_heads, foreign_plans

    store = results.opened()
    with errors.status("checking every byte"):
        faults, heads, foreign = check(store, head), chain_heads(store), foreign_plans(store)
    if results.json:
        every = [vars(finding) for finding in faults]
        results.show("", [{"findings": every, "heads": heads, "not_measured_here": foreign}])
        return int(bool(faults))
    for name, sha256 in heads.items():
        say(f"head of {name}: {sha256[:HEAD_DIGITS]}")
    if foreign:
        say(f"{len(foreign)} imported plans were not measured here: {', '.join(foreign[:5])}")
    for finding in faults:
        say(finding)
    remedy = "take the damaged files from a backup"
    console.print(f"{len(faults)} finding(s): {remedy}" if faults else "no fault found")
    return int(bool(faults))


def _when(text: str) -> str | int:
    """A small number is a version; anything else a moment."""
    return int(text) if text.isdigit() and len(text) < 8 else text
