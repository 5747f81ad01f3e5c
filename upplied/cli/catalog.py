"""`upplied catalog`: contents, history and checks; merging, cleaning, export and import."""

import re
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from upplied.cli.options import OnlyKind
from upplied.cli.terminal import HERE, PRINTED, Results, Where, errors, rows_of, say
from upplied.errors import CatalogError
from upplied.outputs.labels import LABELS

app = App(name="catalog", help="Inspect, check, export and maintain the catalog.")

LimitOption = Annotated[int, Parameter(help="Maximum number, the newest first.")]
HeadOption = Annotated[tuple[str, ...], Parameter(help="Head hash noted earlier; its row must exist.")]
SPARE = ("planned", "clearance m", "inspected %")


@app.command
def info(*, results: Results = PRINTED) -> int:
    """Count the contents of the catalog."""
    store = results.opened()
    tables = {name: getattr(store, name)() for name in ("structures", "demonstrations", "transfers")}
    counts = {name: len(table) for name, table in tables.items()}
    plans = tables["transfers"]["status"].value_counts().sort_index()
    counts |= {f"transfers {status}": int(number) for status, number in plans.items()}
    rows = [{"what": what, "count": number} for what, number in counts.items()]
    results.show(f"catalog {store.location}", rows)
    return 0


@app.command(name="show")
def show_one(id: str, /, *, results: Results = PRINTED) -> int:
    """Show everything stored about a structure, a demonstration or a plan.

    Parameters
    ----------
    id : str
        ID of any of them; for a plan its beginning is enough.
    """
    store = results.opened()
    rows = []
    for table, frame in (("structure", store.structures()), ("demonstration", store.demonstrations())):
        rows += [{"what": table, **row} for row in rows_of(frame[frame[f"{table}_id"] == id])]
    try:
        name = store.find_transfer(id)
        current = name in set(store.transfers(columns=["transfer_id"])["transfer_id"])
        same = store.transfers(every=True, ids=[name])
        rows += [{"what": "plan", "current": current, **row} for row in rows_of(same)]
        rows += [{"what": "overruled for", **row} for row in rows_of(store.overruled(name))]
    except CatalogError:
        if not rows:
            raise
    if results.json:
        results.show("", rows)
        return 0
    for row in rows:
        known = {name: value for name, value in row.items() if value is not None}
        texts = {name: f"{v:.6g}" if isinstance(v, float) else str(v) for name, v in known.items()}
        texts = {name: text if len(text) <= 100 else f"{text[:97]}..." for name, text in texts.items()}
        results.show_facts(f"{row['what']} {id}", texts)
    return 0


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
        A time, such as 2026-11-21T02:00:00Z, or a version of the table of transfers.
    after : str
        A time or a version; by default now.
    """
    from upplied.catalog import diff as changed

    frame = changed(results.opened(), _when(before), None if after is None else _when(after))
    results.show_frame("changes", frame, LABELS["changes"], ("before", "seen %", "clearance m"))
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
        A time, such as 2026-11-21 or 2026-11-21T02:00:00Z; UTC unless it states a zone.
    """
    frame = results.opened().transfers(as_of=moment)
    results.show_frame(f"transfers as of {moment}", frame, LABELS["plans"], SPARE)
    return 0


@app.command
def verify(*, head: HeadOption = (), results: Results = PRINTED) -> int:
    """Check every byte, row, count, reference and hash, and print the head of each chain of rows.

    Heads are the hashes of the last rows. Briefs and missions record them for later checks.
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
    count = f"{len(faults)} finding{'s' * (len(faults) > 1)}: take the damaged files from a backup"
    say(count if faults else "no findings")
    return int(bool(faults))


def _when(text: str) -> str | int:
    """A small number is a version; anything else a moment."""
    return int(text) if text.isdigit() and len(text) < 8 else text


NO_LICENCE = "All rights reserved"  # whoever gives data away chooses another
_FORMATS = "Format: parquet for any program, lerobot for learning, tum for evo."
FormatOption = Annotated[Literal["parquet", "lerobot", "tum"], Parameter(help=_FORMATS)]
NameOption = Annotated[str, Parameter(help="Name with a version, such as boxes-v1; by default the folder's.")]
PresetOption = Annotated[str, Parameter(help="Preset, or all; by default recommended, if present.")]
Replace = Annotated[bool, Parameter(help="Store entries of the same name as newer versions.")]
Verify = Annotated[bool, Parameter(help="Compute the measures of every plan again and compare.")]
DaysOption = Annotated[float, Parameter(help="Days for which older versions stay readable.")]


@app.command
def compact(*, where: Where = HERE) -> int:
    """Merge small data files; readers and writers are not interrupted."""
    from upplied.catalog import compact as merge

    with errors.status("merging files"):
        _counted("merged files", merge(where.opened()))
    return 0


@app.command
def vacuum(*, keep_days: DaysOption = 30.0, where: Where = HERE) -> int:
    """Remove files that no version needs; rows are never removed."""
    from upplied.catalog import vacuum as clean

    with errors.status("removing files"):
        counts = clean(where.opened(), keep_days)
    _counted("files removed", counts.files_removed)
    _counted("rows of stopped writers removed", counts.orphan_commits)
    say(f"{counts.surfaces_removed} unused surfaces and {counts.drafts_removed} unfinished exports removed")
    say(f"jobs of {counts.runs_removed} killed runs removed")
    say(f"{counts.cache_bytes_freed} bytes of cache freed")
    return 0


@app.command
def export(
    folder: Path | None = None,
    /,
    *,
    format: FormatOption = "parquet",
    licence: Annotated[str, Parameter(help="Licence: an SPDX name (CC-BY-4.0) or a sentence.")] = NO_LICENCE,
    name: NameOption = "",
    attribution: Annotated[str, Parameter(help="Name that users must credit.")] = "",
    kind: OnlyKind = None,
    demonstration: Annotated[str | None, Parameter(help="Only this demonstration.")] = None,
    preset: PresetOption = "",
    where: Where = HERE,
) -> int:
    """Export all plans with result ok and their inputs as a folder.

    Parameters
    ----------
    folder : Path
        New or empty folder; by default fleet-v1 here, or the next version that does not exist.
    """
    from upplied.catalog import export_dataset
    from upplied.outputs.learning import export_lerobot, export_tum

    store = where.opened()
    folder = folder or next(each for at in count(1) if not (each := Path(f"fleet-v{at}")).exists())
    chosen_preset = preset if preset not in ("", "all") else None
    chosen = store.transfers(status="ok", kind=kind, demonstration=demonstration, preset=chosen_preset)
    if not preset:
        used = [name for name in ("recommended", "paper", "baseline") if name in set(chosen["preset"])]
        chosen = chosen[chosen["preset"].isin(used[:1])]
    with errors.status("exporting"):
        if format == "tum":
            counts = export_tum(store, folder, chosen)
        elif format == "lerobot":
            flown = store.demonstrations()
            flown = flown[flown["structure_id"].isin(store.structures(kind=kind)["structure_id"])]
            names = [each for each in flown["demonstration_id"] if demonstration in (None, each)]
            counts = export_lerobot(store, folder, chosen, 10, names, licence, attribution)
        else:
            usual = folder.resolve().name
            name = name or (usual if re.search(r"-v\d+$", usual) else f"{usual}-v1")
            counts = export_dataset(store, folder, name, chosen, licence, attribution)
    _counted(str(folder), counts)
    return 0


@app.command(name="import")
def import_(folder: Path, /, *, replace: Replace = False, verify: Verify = False, where: Where = HERE) -> int:
    """Import an exported folder after checking it.

    Parameters
    ----------
    folder : Path
        Folder that `upplied catalog export` wrote.
    """
    from upplied.catalog import import_dataset
    from upplied.fleet.flights import measured

    with errors.status("importing"):
        counts = import_dataset(where.opened(), folder, replace, measured if verify else None)
    _counted("added rows", counts)
    return 0


def _counted(what: str, counts: dict[str, int]) -> None:
    words = ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counts.items() if number)
    say(f"{what}: {words or 'none'}")
