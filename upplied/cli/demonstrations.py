"""`upplied demonstrations` and `recommend`: the flights of experts, and which fits a structure."""

from __future__ import annotations

import json as text
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from upplied import fleet
from upplied.cli import options, terminal
from upplied.cli.options import Cores, DemonstrationId, Rules, StructureId
from upplied.cli.terminal import HERE, PRINTED, Results, Where, errors, progress, rows_of, say
from upplied.errors import InputError, SettingsError
from upplied.outputs.labels import LABELS

if TYPE_CHECKING:
    from upplied.catalog import Catalog

app = App(name="demonstrations", help="The demonstrations of the catalog.")

LISTED = LABELS["demonstrations"]

StructureOption = Annotated[str, Parameter(help="Structure that was flown, if no side-car file names it.")]
RegisterOption = Annotated[tuple[str, ...], Parameter(help="A landmark in the log's frame, as NAME=X,Y,Z.")]
StartOption = Annotated[float | None, Parameter(help="Inspection start, in seconds from the first pose.")]
StopOption = Annotated[float | None, Parameter(help="Inspection end, in seconds from the first pose.")]
KindOption = Annotated[str, Parameter(help="Kind of a project's structure, for instance building or tower.")]
MostOption = Annotated[int, Parameter(help="Number of demonstrations to show.")]
PublisherOption = Annotated[str, Parameter(help="Body to read: the name of its frame, or #7 for channel 7.")]


@app.command
def add(
    *logs: Path,
    flags: Rules = options.USUAL,
    publisher: PublisherOption = "",
    structure: StructureOption = "",
    register: RegisterOption = (),
    start: StartOption = None,
    stop: StopOption = None,
    kind: KindOption = "",
    unit_m: Annotated[float | None, Parameter(help="Metres per unit of a model without scale.")] = None,
    dry_run: Annotated[bool, Parameter(help="Check only, store nothing.")] = False,
    workers: Cores = 0,
    where: Where = HERE,
) -> int:
    """Import demonstrated flights; each is checked against its structure (docs/checks.md).

    Parameters
    ----------
    logs : Path
        Logs of any kind, photogrammetry projects, missions, folders of photos, or folders of all of these.
    """
    from upplied.fleet.ingest import find_logs, passed_over
    from upplied.inputs.rules import PassportSettings
    from upplied.inputs.sidecar import LogOptions

    options = LogOptions(
        allow=flags.allow, strict=flags.strict, passport=PassportSettings.changed(flags.set_),
        structure_id=structure, points=_points(register), start_s=start, stop_s=stop,
        kind=kind, unit_m=unit_m, publisher=publisher,
    )  # fmt: skip
    if dry_run and where.opened().identity.id is None:
        say(f"no catalog at {where.location}: flights cannot be checked against a structure")
    with progress("reading flights", len(find_logs(logs))) as advance:
        ingested = fleet.ingest_demonstrations(
            where.opened(), logs, workers, lambda _: advance(), options=options, dry_run=dry_run
        )
    known = {Path(item.file).resolve() for item in ingested}
    others = [item for item in passed_over(logs) if Path(item.file).resolve() not in known]
    code = terminal.ingested_report([*ingested, *others])
    stored = [item.name for item in ingested if item.status in ("added", "unchanged")]
    names = [name for name in stored if name in set(where.opened().demonstrations()["demonstration_id"])]
    if not code and names:
        where.next_step(f"transfer {names[0]}", "transfer it to every other structure of its kind")
    return code


def _points(register: tuple[str, ...]) -> tuple[tuple[str, tuple[float, ...]], ...]:
    points = []
    for word in register:
        name, _, place = word.partition("=")
        try:
            points.append((name, tuple(float(part) for part in place.split(","))))
        except ValueError:
            raise SettingsError(f"--register {word[:60]}", "is not a point", "NAME=X,Y,Z") from None
    return tuple(points)


@app.command(name="list")
def list_(*, results: Results = PRINTED) -> int:
    """List the demonstrations of the catalog with their findings."""
    rows = rows_of(results.opened().demonstrations()[list(LISTED)])
    if not results.json:
        from upplied.outputs.page_data import short

        rows = [{LISTED[name]: short(value) for name, value in row.items()} for row in rows]
    results.show("demonstrations", rows, ("aimed %", "recorded %", "lowest height m", "clearance m"))
    return 0


@app.command(name="show")
def show_(demonstration: DemonstrationId, /, *, results: Results = PRINTED) -> int:
    """Show the import checks of a demonstration: measurements, and the rules it breaks."""
    from upplied.inputs.passport.rules import findings_of
    from upplied.outputs.page_data import rows_of

    passport: Any = results.opened().demonstration(demonstration).passport
    if results.json:
        sys.stdout.write(text.dumps(passport, indent=2) + "\n")
        return 0
    if not passport:
        say(f"{demonstration}: imported without checks; import its log again")
        return 0
    results.show_facts(f"{demonstration}: {passport['verdict']}", dict(rows_of(passport)))
    for item in findings_of(passport):
        say(f"{item}. {item.remedy}")
    return 0


@app.command
def retire(*demonstrations: str, where: Where = HERE) -> int:
    """Retire demonstrations; their history stays, and importing one again restores it.

    Parameters
    ----------
    demonstrations : str
        IDs of the demonstrations.
    """
    count = where.opened().retire_demonstrations(demonstrations)
    say(f"{count} retired, {len(demonstrations) - count} already retired")
    return 0


def recommend(structure: StructureId, /, *, most: MostOption = 10, results: Results = PRINTED) -> int:
    """Rank demonstrations by how well they would transfer to a structure; nothing is planned."""
    from upplied.recommend.ranking import recommend as rank

    with errors.status("comparing shapes"):
        ranks = [asdict(one) for one in rank(results.opened(), structure, most)]
    if results.json:
        results.show("", [terminal.plain(row) for row in ranks])
    else:
        rows = [{title: row[name] for name, title in LABELS["recommended"].items()} for row in ranks]
        results.show(f"demonstrations for {structure}", rows, ("inspected %", "unmatched %"))
        for row in ranks:
            say(f"{row['rank']}. {row['demonstration_id']}: {row['why']}")
    if any(row["verdict"] == "fits" for row in ranks):
        results.next_step(f"transfer --best {structure}", "transfer the best one")
    return int(ranks[0]["verdict"] not in ("own", "fits"))


def best(store: Catalog, structure: str) -> str:
    """The demonstration that fits a structure best, other than its own; one of another kind is refused."""
    from upplied.recommend.ranking import recommend as rank

    others = [one for one in rank(store, structure, 100) if one.verdict != "own"]
    fitting = next((one for one in others if one.verdict == "fits"), None)
    if fitting is None:
        closest = f"; the closest is {others[0].demonstration_id}: {others[0].why}" if others else ""
        raise InputError(f"structure {structure}", f"no demonstration clearly fits{closest}")
    kind = store.newest("structures", structure)["kind"]
    if kind != fitting.kind:
        fault = f"is declared a {kind}, but {fitting.demonstration_id}, which fits best, was flown on a "
        rule = "demonstrations are transferred within a kind"
        remedy = "if both are of one kind, correct the manifest"
        raise InputError(f"structure {structure}", fault + fitting.kind, rule, remedy)
    terminal.complain(f"{fitting.demonstration_id}: {fitting.why}")
    return fitting.demonstration_id
