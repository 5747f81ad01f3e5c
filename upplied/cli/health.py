"""The mesh half of `upplied structures check`: one structure in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from upplied.cli.terminal import complain, console, say

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import RuleOptions
    from upplied.inputs.manifests import StructureEntry
    from upplied.inputs.rules import Verdict
    from upplied.records import Structure


def check_mesh(file: Path, png: Path | None, clean: bool = False) -> int:
    """Say how a mesh or cloud file is that no manifest declares, and draw it; 1 when it would be refused."""
    return _told(file, file, png or Path(f"{file.stem}-check.png"), clean=clean)


def check_entry(
    manifest: Path,
    id: str,
    png: Path | None,
    catalog: Catalog | None,
    rules: RuleOptions,
    clean: bool = False,
) -> int:
    """The same of one structure of a manifest, as declared there, among those of a catalog."""
    from upplied.errors import InputError
    from upplied.inputs.manifests import read_manifest

    entries = {entry.structure_id: entry for entry in rules.of(read_manifest(manifest))}
    if id not in entries:
        raise InputError(f"{manifest}: {id}", "is not in the manifest", f"one of {', '.join(entries)}")
    return _told(entries[id], entries[id].path, png or Path(f"{id}-check.png"), catalog, clean)


def _told(
    what: StructureEntry | Path, file: Path, png: Path, catalog: Catalog | None = None, clean: bool = False
) -> int:
    from upplied.errors import InputError
    from upplied.fleet.workers import JobKilled, Workers
    from upplied.inputs.health import health_report
    from upplied.inputs.rules import refusals
    from upplied.outputs.figures import structure_png
    from upplied.outputs.files import replace_file

    if not file.is_file():
        raise InputError(str(file), "is not a file", remedy="check the path")
    try:
        with Workers(1) as pool:  # whatever a file does to a reader, within its time and memory
            report = pool.run(health_report, what)
    except (InputError, JobKilled) as error:
        complain(f"refused: {error}")
        return 1
    say(report.text)
    replace_file(png, structure_png(report.structure, title=png.stem.removesuffix("-check")))
    say(f"  picture     {png}")
    others = () if isinstance(what, Path) else _among_others(what, report.structure, catalog)
    for verdict in others:
        say(f"  {verdict.severity:<11} {verdict}. {verdict.remedy}")
    if clean:
        _cleaned(report.structure, png)
    return int(bool(report.problems or refusals(others)))


def _cleaned(structure: Structure, png: Path) -> None:
    """Write the structure without ground, clutter and neighbours, and a picture before and after."""
    from dataclasses import replace

    from upplied.inputs.separation import CLASSES, kept, separated
    from upplied.outputs.figures import separation_png
    from upplied.outputs.files import replace_file
    from upplied.outputs.ply import ply_bytes

    separation = separated(structure)
    if not separation.texts:
        console.print("  clean       nothing to separate: the whole mesh is the structure", soft_wrap=True)
        return
    stem = png.stem.removesuffix("-check") + "-clean"
    mesh, picture = png.with_name(f"{stem}.ply"), png.with_name(f"{stem}.png")
    vertices, triangles, normals = kept(structure, separation)
    left = replace(structure, vertices=vertices, triangles=triangles, normals=normals)
    replace_file(mesh, ply_bytes(vertices, triangles, normals))
    replace_file(picture, separation_png(structure, separation.label, CLASSES, left))
    console.print(
        f"  separated   {'; '.join(separation.texts)}; {separation.area_m2[0]:.1f} m² are left",
        soft_wrap=True,
    )
    ground = "" if separation.ground_z_m is None else f", ground_z = {separation.ground_z_m:.2f}"
    declare = f"units = 'm', up = 'z', forward = 'x'{ground}"
    say(f"  cleaned     {mesh}: declare {declare}")
    say(f"  picture     {picture} (before and after)")


def _among_others(
    entry: StructureEntry, structure: Structure, catalog: Catalog | None
) -> tuple[Verdict, ...]:
    from upplied.fleet.admission import Admission, shape_of
    from upplied.fleet.members import Member

    member = Member(entry.structure_id, entry.kind, shape_of(structure))
    return Admission(catalog).verdicts(member, entry)
