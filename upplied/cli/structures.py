"""`upplied structures`: the structures of the fleet."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from upplied import fleet
from upplied.cli import terminal
from upplied.cli.options import USUAL, Cores, Rules, StructureId
from upplied.cli.terminal import HERE, PRINTED, Results, Where, errors, progress, say
from upplied.errors import CatalogError, InputError
from upplied.files import replace_file

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import RuleOptions
    from upplied.inputs.manifests import StructureEntry
    from upplied.inputs.rules import Verdict
    from upplied.records import Structure

_SIZES = {"size_x_m": "length m", "size_y_m": "width m", "size_z_m": "height m"}

app = App(name="structures", help="The structures of the catalog.")
PictureOption = Annotated[Path | None, Parameter(help="Picture to write; by default NAME-check.png here.")]
Prune = Annotated[bool, Parameter(help="Retire structures that the manifest no longer names.")]
CleanOption = Annotated[bool, Parameter(help="Also write NAME-clean.ply without the surroundings.")]


@app.command
def add(
    manifest: Path, /, *, prune: Prune = False, flags: Rules = USUAL, workers: Cores = 0, where: Where = HERE
) -> int:
    """Import the meshes of a manifest; each is checked against its kind (docs/checks.md).

    Parameters
    ----------
    manifest : Path
        `structures.toml` or a CSV: id, kind, path, units, up, forward, ...
    """
    from upplied.inputs.manifests import read_manifest

    store, rules = where.opened(), _rule_options(flags)
    with progress("reading structures", len(read_manifest(manifest))) as advance:
        ingested = fleet.ingest_structures(store, manifest, workers, lambda _: advance(), prune, rules)
    code = terminal.ingested_report(ingested)
    if not code and len(store.demonstrations()):
        where.next_step("plan", "transfer the demonstrations to new and changed structures")
    elif not code:
        where.next_step("demonstrations add LOG.mcap", "import an expert's flight")
    return code


@app.command(name="list")
def list_(*, results: Results = PRINTED) -> int:
    """List the structures of the catalog with their findings."""
    table = results.opened().structures()[["structure_id", "kind", *_SIZES, "overruled", "findings"]]
    table = table if results.json else table.rename(columns=_SIZES)
    results.show("structures", table.to_dict("records"), ("length m", "width m", "height m"))
    return 0


@app.command(name="show")
def show_(structure: StructureId, /, *, results: Results = PRINTED) -> int:
    """Show a structure: its size, repairs, and the rules it breaks or overrules."""
    from upplied.inputs.rules import from_json

    record = results.opened().structure(structure)
    size = (record.vertices.max(axis=0) - record.vertices.min(axis=0)).tolist()
    verdicts = from_json(record.verdicts_json)
    facts = {
        "structure": structure,
        "kind": record.kind,
        "site": record.site,
        "size": " x ".join(f"{side:.2f}" for side in size) + " m (length x width x height)",
        "mesh": f"{len(record.triangles)} triangles, {len(record.vertices)} vertices",
        "notes": record.notes,
    }
    if results.json:
        results.show("", [facts | {"size_m": size, "verdicts": [asdict(one) for one in verdicts]}])
        return 0
    results.show_facts(structure, facts)
    for verdict in verdicts:
        say(f"{verdict.severity}: {verdict}. {verdict.remedy}")
    return 0


@app.command
def check(
    file: Path,
    /,
    *,
    id: Annotated[str | None, Parameter(help="Structure of a manifest to report in full.")] = None,
    png: PictureOption = None,
    clean: CleanOption = False,
    flags: Rules = USUAL,
    workers: Cores = 0,
    results: Results = PRINTED,
) -> int:
    """Check a mesh or the meshes of a manifest; nothing is stored.

    Parameters
    ----------
    file : Path
        A manifest (`structures.toml` or a CSV), or a mesh or point cloud.
    """
    from upplied.inputs.manifests import read_manifest

    rules = _rule_options(flags)
    if file.suffix.lower() not in (".toml", ".csv"):
        return _checked(file, png, clean=clean)
    others: Catalog | None = None
    try:
        others = results.opened()
        others.structures()
    except CatalogError:  # compared with none, if none is named and the default does not exist
        if results.location != HERE.location:
            raise
        others = None
    if id is not None:
        entries = {entry.structure_id: entry for entry in rules.of(read_manifest(file))}
        if id not in entries:
            raise InputError(f"{file}: {id}", "is not in the manifest", f"one of {', '.join(entries)}")
        return _checked(entries[id], png, others, clean)
    with progress("checking structures", len(read_manifest(file))) as advance:
        checked = fleet.check_structures(file, workers, lambda _: advance(), others, rules)
    rows = [vars(item) for item in checked]
    if not results.json:
        rows = [{**row, "findings": "; ".join(row["findings"])} for row in rows]
    results.show("structures", rows)
    return int(any(item.status == "failed" for item in checked))


def _rule_options(flags: Rules) -> RuleOptions:
    from upplied.fleet import RuleOptions
    from upplied.inputs.rules import StructureSettings

    return RuleOptions(flags.allow, flags.strict, StructureSettings.changed(flags.set_))


def _checked(
    what: StructureEntry | Path, png: Path | None, catalog: Catalog | None = None, clean: bool = False
) -> int:
    """Report on a file, or an entry of a manifest among those of a catalog, and draw it; 1 if refused."""
    from upplied.fleet.admission import Admission, shape_of
    from upplied.fleet.members import Member
    from upplied.fleet.workers import JobKilled, Workers
    from upplied.inputs.rules import refusals
    from upplied.outputs.figures import structure_png
    from upplied.outputs.health import health_report

    file, name = (what, what.stem) if isinstance(what, Path) else (what.path, what.structure_id)
    png = png or Path(f"{name}-check.png")
    if not file.is_file():
        raise InputError(str(file), "is not a file", remedy="check the path")
    try:
        # Whatever a file does to a reader, within its time and memory.
        with errors.status("checking"), Workers(1) as pool:
            report = pool.run(health_report, what)
    except (InputError, JobKilled) as error:
        terminal.complain(f"refused: {error}")
        return 1
    say(report.text)
    replace_file(png, structure_png(report.structure, title=png.stem.removesuffix("-check")))
    say(f"  picture     {png}")
    others: tuple[Verdict, ...] = ()
    if not isinstance(what, Path):
        member = Member(what.structure_id, what.kind, shape_of(report.structure))
        others = Admission(catalog).verdicts(member, what)
    for verdict in others:
        say(f"  {verdict.severity:<11} {verdict}. {verdict.remedy}")
    if clean:
        _cleaned(report.structure, png)
    return int(bool(report.problems or refusals(others)))


def _cleaned(structure: Structure, png: Path) -> None:
    """Write the structure without ground, clutter and neighbours, and a picture before and after."""
    from upplied.geometry.separation import CLASSES, separated, structure_alone
    from upplied.outputs.display import ply_bytes
    from upplied.outputs.figures import separation_png

    separation = separated(structure)
    if not separation.texts:
        say("  clean       nothing to separate: the whole mesh is the structure")
        return
    stem = png.stem.removesuffix("-check") + "-clean"
    mesh, picture = png.with_name(f"{stem}.ply"), png.with_name(f"{stem}.png")
    vertices, triangles, normals = structure_alone(structure, separation)
    left = replace(structure, vertices=vertices, triangles=triangles, normals=normals)
    replace_file(mesh, ply_bytes(vertices, triangles, normals))
    replace_file(picture, separation_png(structure, separation.label, CLASSES, left))
    say(f"  separated   {'; '.join(separation.texts)}; {separation.area_m2[0]:.1f} m² are left")
    ground = "" if separation.ground_z_m is None else f", ground_z = {separation.ground_z_m:.2f}"
    say(f"  cleaned     {mesh}: declare units = 'm', up = 'z', forward = 'x'{ground}")
    say(f"  picture     {picture} (before and after)")
