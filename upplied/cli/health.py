"""The mesh half of `upplied structures check`: one structure in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from upplied.cli.terminal import console, errors

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.fleet import Asked
    from upplied.inputs.manifests import StructureEntry
    from upplied.inputs.rules import Verdict
    from upplied.records import Structure


def check_mesh(file: Path, png: Path | None) -> int:
    """Say how a mesh or cloud file is that no manifest declares, and draw it; 1 when it would be refused."""
    return _told(file, file, png or Path(f"{file.stem}-check.png"))


def check_entry(manifest: Path, id: str, png: Path | None, catalog: Catalog | None, asked: Asked) -> int:
    """The same of one structure of a manifest, as declared there, among those of a catalog."""
    from upplied.errors import InputError
    from upplied.inputs.manifests import read_manifest

    entries = {entry.structure_id: entry for entry in asked.of(read_manifest(manifest))}
    if id not in entries:
        raise InputError(f"{manifest}: {id}", "is not in the manifest", f"one of {', '.join(entries)}")
    return _told(entries[id], entries[id].path, png or Path(f"{id}-check.png"), catalog)


def _told(what: StructureEntry | Path, file: Path, png: Path, catalog: Catalog | None = None) -> int:
    from upplied.errors import InputError
    from upplied.fleet.workers import JobKilled, Workers
    from upplied.inputs.health import health_report
    from upplied.inputs.rules import refusals
    from upplied.outputs.figures import save, structure_png

    if not file.is_file():
        raise InputError(str(file), "is no file", remedy="check the path")
    try:
        with Workers(1) as pool:  # whatever a file does to a reader, within its time and memory
            report = pool.run(health_report, what)
    except (InputError, JobKilled) as error:
        errors.print(f"refused: {error}", markup=False, soft_wrap=True)
        return 1
    console.print(report.text, markup=False, soft_wrap=True)
    save(png, structure_png(report.structure, title=png.stem.removesuffix("-check")))
    console.print(f"  picture     {png}", markup=False, soft_wrap=True)
    found = () if isinstance(what, Path) else _among_others(what, report.structure, catalog)
    for verdict in found:
        console.print(f"  {verdict.severity:<11} {verdict}. {verdict.remedy}", markup=False, soft_wrap=True)
    return int(bool(report.problems or refusals(found)))


def _among_others(
    entry: StructureEntry, structure: Structure, catalog: Catalog | None
) -> tuple[Verdict, ...]:
    from upplied.fleet.admission import Admission, shape_of
    from upplied.fleet.members import Member

    member = Member(entry.structure_id, entry.kind, shape_of(structure))
    return Admission(catalog).verdicts(member, entry)
