"""Files into the catalog: a bad one stops itself alone, an unchanged one, by its bytes, is left as it is."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Cache, Catalog, open_catalog
from upplied.config import digest
from upplied.errors import InputError
from upplied.fleet import reading
from upplied.fleet.admission import Admission, RuleOptions
from upplied.fleet.reading import Ingested, Progress
from upplied.inputs import logs as log_reader
from upplied.inputs import meshes
from upplied.inputs.concerns import nominal_problems
from upplied.inputs.manifests import StructureEntry, read_manifest
from upplied.inputs.passport.rules import RULES
from upplied.inputs.rules import check_allowed
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.sources.door import FileKind, survey
from upplied.records import Placement, Structure

_LISTED = ("flight", "refused")  # of the files of a survey, those that may be flights


def ingest_structures(
    catalog: Catalog,
    manifest: str | Path,
    workers: int = 0,
    progress: Progress = lambda ingested: None,
    prune: bool = False,
    rules: RuleOptions | None = None,
) -> list[Ingested]:
    """Read the structures of a manifest and keep those that are new or changed.

    Parameters
    ----------
    catalog : Catalog
    manifest : path
        `structures.toml` or a CSV.
    workers : int
        Processes; 0 takes one per core.
    progress : callable
        Called with what became of each file.
    prune : bool
        Retire structures that the manifest no longer names, and with them their plans; history stays.
    rules : RuleOptions, optional
        Which rules are overruled, and their bounds.

    Raises
    ------
    InputError
        If the manifest itself cannot be read.
    """
    entries = (rules or RuleOptions()).of(read_manifest(manifest))
    ingested, known = _added(catalog, entries, workers, progress)
    if prune:
        gone = sorted(known - {entry.structure_id for entry in entries})
        catalog.retire_structures(gone)
        ingested += [Ingested(name, "retired") for name in gone]
    return ingested


def _added(
    catalog: Catalog, entries: list[StructureEntry], workers: int, progress: Progress = lambda ingested: None
) -> tuple[list[Ingested], set[str]]:
    """What became of the structures of these entries, and the ids that were known before."""
    table = catalog.create().structures()
    known = {row.structure_id: (row.sha256, row.site, row.notes) for row in table.itertuples()}
    sizes = dict(zip(table["structure_id"], table[_SIZES].to_numpy(), strict=True))
    before = _Stored(known, sizes, catalog.cache)
    read = partial(reading.learnt_structure, *_place(catalog))
    reads = reading.each(read, entries, lambda entry: entry.structure_id, workers, before.same)
    by_id = {entry.structure_id: entry for entry in entries}
    admitted = before.noted(Admission(catalog).admitted(reads, by_id, reading.BATCH), by_id)
    ingested = reading.stored(admitted, known, lambda it: it.structure_id, catalog.add_structures, progress)
    return ingested, set(known)


def ingest_demonstrations(
    catalog: Catalog,
    logs: Iterable[str | Path],
    workers: int = 0,
    progress: Progress = lambda ingested: None,
    options: LogOptions | None = None,
    dry_run: bool = False,
) -> list[Ingested]:
    """Read flights of any kind, or folders of them, and keep those that are new or changed.

    Parameters
    ----------
    catalog, workers, progress
        As above.
    logs : paths
        Logs, photogrammetry projects, missions, folders of photos, or folders of all of these; their content
        decides what each is (`upplied.inputs.sources.door`). A project that names no structure brings its own
        (`upplied.inputs.sources.project_files`).
    options : LogOptions, optional
        Facts about all of them; among them the rules of their passports that are overruled.
    dry_run : bool
        Read and judge, and keep nothing; there need not be a catalog.

    Returns
    -------
    list of Ingested
        Of every flight, and of what looks like one and cannot be read; the rest tells `passed_over`.

    Raises
    ------
    InputError, SettingsError
        If a name does not exist, or a rule that is to be overruled does not.
    """
    options = options or LogOptions()
    check_allowed(options.allow, RULES)
    entries = _surveyed(logs)
    if not dry_run and any(map(reading.is_project, entries)):  # which may be the first to bring a structure
        catalog.create()
    with ExitStack() as stack:
        home = catalog
        if dry_run:  # structures of projects go into a catalog that is thrown away
            home = open_catalog(stack.enter_context(TemporaryDirectory(prefix="upplied-"))).create()
            catalog = catalog if catalog.identity.id is not None else home
        table = catalog.demonstrations()
        if options.strict:  # flights with warnings are judged again
            table = table[table["verdict"] != "warned"]
        known = {row.demonstration_id: (row.sha256,) for row in table.itertuples()}
        rules = RuleOptions(strict=options.strict)
        add_structures = lambda entries: _added(home, rules.of(entries), workers)[0]  # noqa: E731
        entries, structures, facts = reading.facts_of(entries, options, add_structures)
        flights = {str(one.path): one for one in entries if one.is_flight}
        places = {name: _place(home) for name in facts}
        placements = placements_of(catalog.structures())
        if facts:
            placements |= placements_of(home.structures())
        read = partial(reading.learnt_flight, places, _place(catalog), placements, facts, options)

        def same(path: Path) -> Ingested | None:
            """Whether a log and the facts about it are as they were."""
            if not known:
                return None
            own = facts.get(str(path), options)
            name, sha256 = log_reader.fingerprint(path, own, placements)
            return Ingested(name, "unchanged") if known.get(name) == (sha256,) else None

        reads = reading.each(read, [one.path for one in flights.values()], str, workers, same)
        add = (lambda read: None) if dry_run else catalog.add_demonstrations
        ingested = reading.stored(reads, known, lambda it: it.demonstration_id, add, progress)
    if not dry_run:
        reading.gather(catalog)
    status = {"added": "readable"} if dry_run else {}
    named = [replace(one, status=status.get(one.status, one.status)) for one in (*structures, *ingested)]
    by_file = dict(zip(flights, named[len(structures) :], strict=True))
    listed = [_listed(one, by_file.get(str(one.path))) for one in entries if one.status in _LISTED]
    return [*named[: len(structures)], *listed]


def passed_over(logs: Iterable[str | Path]) -> list[Ingested]:
    """The files that are named, or lie in folders that are named, and are no flights nor parts of one."""
    return [_listed(one, None) for one in _surveyed(logs) if one.status == "other"]


def _listed(file: FileKind, ingested: Ingested | None) -> Ingested:
    if ingested is not None:
        words = f"{file.words}: {ingested.words}" if ingested.words else file.words
        return replace(ingested, file=str(file.path), words=words)
    remedy = file.remedy and f". {file.remedy[0].upper()}{file.remedy[1:]}"
    status = "failed" if file.status == "refused" else "passed over"
    return Ingested(file.path.name, status, f"{file.path}: {file.words}{remedy}", file=str(file.path))


def _place(catalog: Catalog) -> tuple[str, Path]:
    return catalog.location, catalog.cache.folder


def placements_of(structures: pd.DataFrame) -> dict[str, Placement]:
    placed = structures[structures["lat_deg"].notna()]
    columns = ["structure_id", "lat_deg", "lon_deg", "alt_m", "heading_deg", "datum"]
    return {row[0]: Placement(*row[1:]) for row in placed[columns].itertuples(index=False)}


def find_logs(logs: Iterable[str | Path]) -> list[Path]:
    """The flights that are named, or lie in named folders, unreadable ones too; none is an error."""
    return [one.path for one in _surveyed(logs) if one.status in _LISTED]


def _surveyed(logs: Iterable[str | Path]) -> list[FileKind]:
    """What the files are; one that is named and is no flight is refused, not passed over."""
    names = [Path(log) for log in logs]
    entries = [
        replace(one, status="refused", words="is not a readable flight")
        if one.status == "other" and one.path in names
        else one
        for one in survey(names)
    ]
    if not any(one.status in _LISTED for one in entries):
        raise InputError(", ".join(map(str, names)) or "logs", "contain no flight", "at least one log")
    return entries


_SIZES = ["size_x_m", "size_y_m", "size_z_m"]
_WORDS = "manifest-words"  # of the cache: site and notes of an entry


@dataclass(frozen=True)
class _Stored:
    """What the catalog knows of its structures, by id; the cache notes which entry gave a row's words."""

    content: Mapping[str, tuple[str, ...]]  # hash, site and notes
    size_m: Mapping[str, np.ndarray]
    cache: Cache

    def same(self, entry: StructureEntry) -> Ingested | None:
        """Whether file and entry are as they were; a nominal size that fails is for the reader to tell."""
        name = entry.structure_id
        if name not in self.content:
            return None
        box = np.stack([np.zeros(3), self.size_m[name]])
        if nominal_problems(box, entry, ()) or meshes.fingerprint(entry) != self.content[name][0]:
            return None
        _, site, notes = self.content[name]
        begins = f"{notes}; ".startswith(f"{entry.notes}; ") or not entry.notes
        stated = self.cache.get(_WORDS, tuple, digest(self.content[name]))
        words = stated or (site, entry.notes if begins else notes)
        return Ingested(name, "unchanged") if words == (entry.site, entry.notes) else None

    def noted(
        self, reads: Iterator[tuple[str, Any]], entries: Mapping[str, StructureEntry]
    ) -> Iterator[tuple[str, Any]]:
        """The same, each structure with a note of which entry gave its words."""
        for name, read in reads:
            if isinstance(read, Structure):
                words = entries[name].site, entries[name].notes
                self.cache.put(_WORDS, digest(reading.content_of(read)), words)
            yield name, read
