"""Structures that were read, judged among those that are known before they are kept."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.errors import InputError
from upplied.fleet.members import Member, judged
from upplied.fleet.reading import Ingested, Progress, each
from upplied.inputs import meshes
from upplied.inputs import rules as known_rules
from upplied.inputs.manifests import StructureEntry, read_manifest
from upplied.inputs.rules import StructureSettings, Verdict, decided, from_json, refusals
from upplied.recommend.shapes import ShapeFeatures, Shapes, content_of, features_of
from upplied.records import Structure


@dataclass(frozen=True)
class RuleOptions:
    """What a person says of the rules for all structures of a manifest."""

    allow: tuple[str, ...] = ()  # overruled, by name
    strict: bool = False  # what is odd is refused too
    bounds: StructureSettings = field(default_factory=StructureSettings)

    def of(self, entries: Sequence[StructureEntry]) -> list[StructureEntry]:
        allow = known_rules.check_allowed(self.allow, known_rules.RULES)
        return [
            replace(entry, allow=(*entry.allow, *allow), strict=self.strict, bounds=self.bounds)
            for entry in entries
        ]


class Admission:
    """What a new structure is compared with: the catalog; where its kind is new, those that come with it."""

    def __init__(self, catalog: Catalog | None) -> None:
        self._catalog, self._shapes = catalog, None if catalog is None else Shapes(catalog)

    @cached_property
    def _known(self) -> list[Member]:
        """Of the catalog; asked for with the first new structure, so a night without any costs nothing."""
        if self._catalog is None or self._shapes is None:
            return []
        table = self._catalog.structures().set_index("structure_id").sort_index()
        library = self._shapes.library(content_of(table, "mesh_sha256").to_dict())
        shapes = map(ShapeFeatures, library.extent_m, library.occupied, library.near, library.facing)
        flown = set(self._catalog.demonstrations()["structure_id"])
        return [
            Member(str(name), str(kind), shape, name in flown)
            for (name, kind), shape in zip(table["kind"].items(), shapes, strict=True)
        ]

    def verdicts(
        self, new: Member, entry: StructureEntry, together: Sequence[Member] = ()
    ) -> tuple[Verdict, ...]:
        kinds = {one.kind for one in self._known}
        others = [one for one in self._known if one.structure_id != new.structure_id]
        others += [one for one in together if one.kind not in kinds and one.structure_id != new.structure_id]
        axes, sized = (entry.up, entry.forward), any(side is not None for side in entry.nominal_m)
        broken = judged(new, others, entry.bounds, axes, entry.symmetric, sized)
        return decided(broken, entry.allow, entry.strict)

    def admitted(
        self, reads: Iterator[tuple[str, Any]], entries: Mapping[str, StructureEntry], batch: int
    ) -> Iterator[tuple[str, Any]]:
        """The same, in their order; a structure that is refused becomes the reason."""
        while waiting := list(islice(reads, batch)):
            new = {name: self._member(read) for name, read in waiting if isinstance(read, Structure)}
            results = [
                (name, self._judged(read, new, entries[name]) if isinstance(read, Structure) else read)
                for name, read in waiting
            ]
            yield from results
            if taken := [new[name] for name, read in results if isinstance(read, Structure)]:
                self._known.extend(taken)  # for those that come after

    def _judged(self, read: Structure, new: Mapping[str, Member], entry: StructureEntry) -> Structure | str:
        member = new[entry.structure_id]
        verdicts = self.verdicts(member, entry, list(new.values()))
        every = (*from_json(read.verdicts_json), *verdicts)
        try:
            known_rules.refuse(f"{entry.path} ({entry.structure_id})", every)
        except InputError as error:
            return str(error)
        if not verdicts:
            return read
        notes = "; ".join(filter(None, (read.notes, *(verdict.found for verdict in verdicts))))
        return replace(read, verdicts_json=known_rules.to_json(every), notes=notes)

    def _member(self, structure: Structure) -> Member:
        assert self._shapes is not None
        self._shapes.learn(structure)  # a look into the cache, where its worker has put it
        shape = self._shapes.features(structure.structure_id, structure.sha256)
        return Member(structure.structure_id, structure.kind, shape)


def shape_of(structure: Structure) -> ShapeFeatures:
    return features_of(structure, settings_for("recommended").clouds)


def check_structures(
    manifest: str | Path,
    workers: int = 0,
    progress: Progress = lambda ingested: None,
    catalog: Catalog | None = None,
    rules: RuleOptions | None = None,
) -> list[Ingested]:
    """Read the structures of a manifest and say what is wrong; nothing is kept.

    Each is judged among those of a catalog, where there is one, and among the others of the manifest: "good",
    "odd" (with what a person should look at) or "failed" (with the reason).
    """
    entries = (rules or RuleOptions()).of(read_manifest(manifest))
    results: list[Ingested | tuple[Ingested, tuple[Verdict, ...], Member]] = []
    for name, read in each(_checked, entries, lambda entry: entry.structure_id, workers):
        results.append(Ingested(name, "failed", read) if isinstance(read, str) else read)
        progress(Ingested(name, "good"))
    admission, declared = Admission(catalog), {entry.structure_id: entry for entry in entries}
    together = [one[2] for one in results if isinstance(one, tuple)]
    checked = []
    for one in results:
        if isinstance(one, Ingested):
            checked.append(one)
            continue
        good, alone, member = one
        verdicts = (*alone, *admission.verdicts(member, declared[good.name], together))
        if refused := refusals(verdicts):
            good = replace(good, status="failed", reason="; ".join(f"{v}. {v.remedy}" for v in refused))
        elif verdicts:
            good = replace(good, status="odd", findings=tuple(map(str, verdicts)))
        checked.append(good)
    return checked


def _checked(entry: StructureEntry) -> tuple[Ingested, tuple[Verdict, ...], Member]:
    structure = meshes.read_structure(entry, judge=False)
    length, width, height = structure.vertices.max(axis=0) - structure.vertices.min(axis=0)
    size = f"{length:.1f} x {width:.1f} x {height:.1f} m, {len(structure.triangles)} triangles"
    member = Member(entry.structure_id, entry.kind, shape_of(structure))
    return Ingested(entry.structure_id, "good", size), from_json(structure.verdicts_json), member
