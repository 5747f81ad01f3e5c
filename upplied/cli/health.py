"""The mesh half of `upplied structures check`: one structure in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from upplied.cli.terminal import complain, console, say

if TYPE_CHECKING:
    from upplied.catalog import Catalog
    from upplied.inputs.manifests import StructureEntry
    from upplied.inputs.rules import Verdict
    from upplied.records import Structure


def check_one(
    what: StructureEntry | Path, png: Path | None, catalog: Catalog | None = None, clean: bool = False
) -> int:
    """Say how a structure is, and draw it; 1 when it would be refused.

    Of a manifest, as it is declared there and among those of a catalog; else a mesh or cloud file alone.
    """
    from upplied.errors import InputError
    from upplied.fleet.workers import JobKilled, Workers
    from upplied.inputs.health import health_report
    from upplied.inputs.rules import refusals
    from upplied.outputs.figures import structure_png
    from upplied.outputs.files import replace_file

    file, name = (what, what.stem) if isinstance(what, Path) else (what.path, what.structure_id)
    png = png or Path(f"{name}-check.png")
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

    from upplied.inputs.separation import CLASSES, separated, structure_alone
    from upplied.outputs.figures import separation_png
    from upplied.outputs.files import replace_file
    from upplied.outputs.ply import ply_bytes

    separation = separated(structure)
    if not separation.texts:
        console.print("  clean       nothing to separate: the whole mesh is the structure", soft_wrap=True)
        return
    stem = png.stem.removesuffix("-check") + "-clean"
    mesh, picture = png.with_name(f"{stem}.ply"), png.with_name(f"{stem}.png")
    vertices, triangles, normals = structure_alone(structure, separation)
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
