"""Structures judged without being kept: `upplied structures check`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from upplied.catalog import Catalog
from upplied.fleet.admission import Admission, RuleOptions, shape_of
from upplied.fleet.ingest import Ingested, Progress, each
from upplied.fleet.members import Member
from upplied.inputs import meshes
from upplied.inputs.manifests import StructureEntry, read_manifest
from upplied.inputs.rules import Verdict, from_json, refusals


def check_structures(
    manifest: str | Path,
    workers: int = 0,
    progress: Progress = lambda ingested: None,
    catalog: Catalog | None = None,
    asked: RuleOptions | None = None,
) -> list[Ingested]:
    """Read the structures of a manifest and say what is wrong; nothing is kept.

    Each is judged among those of a catalog, where there is one, and among the others of the manifest.

    Parameters
    ----------
    manifest : path
    workers : int
        Processes; 0 takes one per core.
    progress : callable
        Called once for each file that was read.
    catalog : Catalog, optional
    asked : RuleOptions, optional
        Which rules are overruled, and their bounds.

    Returns
    -------
    list of Ingested
        Each "good", "odd" (with what a person should look at) or "failed" (with the reason).
    """
    entries = (asked or RuleOptions()).of(read_manifest(manifest))
    results: list[Ingested | tuple[Ingested, tuple[Verdict, ...], Member]] = []
    for name, read in each(_checked, entries, lambda entry: entry.structure_id, workers):
        results.append(Ingested(name, "failed", read) if isinstance(read, str) else read)
        progress(Ingested(name, "good"))
    admission, declared = Admission(catalog), {entry.structure_id: entry for entry in entries}
    together = [one[2] for one in results if isinstance(one, tuple)]
    return [
        one if isinstance(one, Ingested) else _told(*one, admission, declared[one[0].name], together)
        for one in results
    ]


def _checked(entry: StructureEntry) -> tuple[Ingested, tuple[Verdict, ...], Member]:
    structure = meshes.read_structure(entry, judge=False)
    length, width, height = structure.vertices.max(axis=0) - structure.vertices.min(axis=0)
    size = f"{length:.1f} x {width:.1f} x {height:.1f} m, {len(structure.triangles)} triangles"
    good = Ingested(entry.structure_id, "good", size)
    return (
        good,
        from_json(structure.verdicts_json),
        Member(entry.structure_id, entry.kind, shape_of(structure)),
    )


def _told(
    good: Ingested,
    alone: tuple[Verdict, ...],
    member: Member,
    admission: Admission,
    entry: StructureEntry,
    together: Sequence[Member],
) -> Ingested:
    """What becomes of a structure that was read once it is judged among others."""
    verdicts = (*alone, *admission.verdicts(member, entry, together))
    if refused := refusals(verdicts):
        return replace(good, status="failed", reason="; ".join(f"{v}. {v.remedy}" for v in refused))
    return replace(good, status="odd" if verdicts else good.status, findings=tuple(map(str, verdicts)))
