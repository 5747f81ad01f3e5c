"""Files into the catalog: a bad one stops itself alone, an unchanged one is left as it is.

What is unchanged is known by its bytes and is not parsed again. The rest is read in worker
processes: a file that crashes a reader costs itself alone, and many are read at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from upplied.catalog import Cache, Catalog
from upplied.config import digest
from upplied.errors import InputError, UppliedError
from upplied.fleet.admission import Admission, RuleOptions
from upplied.fleet.learn import gather, learnt_flight, learnt_structure
from upplied.fleet.run import cores
from upplied.fleet.workers import JobKilled, Workers, WorkersBroken
from upplied.inputs import logs as log_reader
from upplied.inputs import meshes
from upplied.inputs.concerns import nominal_problems
from upplied.inputs.manifests import StructureEntry, read_manifest
from upplied.inputs.passport.passport import findings_of
from upplied.inputs.passport.rules import RULES
from upplied.inputs.rules import check_allowed, from_json
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.sources.door import Found, survey
from upplied.records import Demonstration, Placement, Structure

BATCH = 50  # files read before what they hold is committed together

Item = TypeVar("Item")
Read = TypeVar("Read")
Kept = TypeVar("Kept", Structure, Demonstration)


@dataclass(frozen=True)
class Ingested:
    """What became of one file."""

    name: str  # the id, or the file where no id is known
    status: (
        str  # "added", "unchanged", "retired", "failed", "readable" (a trial), or "passed over": no flight
    )
    reason: str = ""
    findings: tuple[str, ...] = ()  # what is odd about it, or was overruled, in words
    file: str = ""
    words: str = ""  # what it is, and as what it was taken


Progress = Callable[[Ingested], None]


def _silent(ingested: Ingested) -> None:
    """Nobody watches."""


def ingest_structures(
    catalog: Catalog,
    manifest: str | Path,
    workers: int = 0,
    progress: Progress = _silent,
    prune: bool = False,
    asked: RuleOptions | None = None,
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
    asked : RuleOptions, optional
        Which rules are overruled, and their bounds.

    Raises
    ------
    InputError
        If the manifest itself cannot be read.
    """
    entries = (asked or RuleOptions()).of(read_manifest(manifest))
    table = catalog.create().structures()
    known = {row.structure_id: (row.sha256, row.site, row.notes) for row in table.itertuples()}
    sizes = dict(zip(table["structure_id"], table[_SIZES].to_numpy(), strict=True))
    stored = _Stored(known, sizes, catalog.cache)
    read = partial(learnt_structure, *_place(catalog))
    reads = each(read, entries, lambda entry: entry.structure_id, workers, stored.same)
    by_id = {entry.structure_id: entry for entry in entries}
    admitted = stored.noted(Admission(catalog).admitted(reads, by_id, BATCH), by_id)
    ingested = _keep(admitted, known, lambda it: it.structure_id, catalog.add_structures, progress)
    if prune:
        gone = sorted(known.keys() - {entry.structure_id for entry in entries})
        catalog.retire_structures(gone)
        ingested += [Ingested(name, "retired") for name in gone]
    return ingested


def ingest_demonstrations(
    catalog: Catalog,
    logs: Iterable[str | Path],
    workers: int = 0,
    progress: Progress = _silent,
    options: LogOptions | None = None,
    dry_run: bool = False,
) -> list[Ingested]:
    """Read flights of any kind, or folders of them, and keep those that are new or changed.

    Parameters
    ----------
    catalog, workers, progress
        As above.
    logs : paths
        Logs, photogrammetry projects, missions, folders of photos, or folders of all of these; what
        each is, its content tells (`upplied.inputs.sources.door`).
    options : LogOptions, optional
        What may be said of all of them; among it the rules of their passports that are overruled.
    dry_run : bool
        Read and judge, and keep nothing.

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
    table = catalog.demonstrations()
    if options.strict:  # what was taken with a warning is asked again
        table = table[table["verdict"] != "warned"]
    known = {row.demonstration_id: (row.sha256,) for row in table.itertuples()}
    placements = placements_of(catalog.structures())
    read = partial(learnt_flight, *_place(catalog), placements, options=options)
    same = partial(_same_log, known, placements, options)
    found = _surveyed([Path(log) for log in logs])
    flights = {str(one.path): one for one in found if one.is_flight}
    reads = each(read, [one.path for one in flights.values()], str, workers, same)
    add = (lambda read: None) if dry_run else catalog.add_demonstrations
    ingested = _keep(reads, known, lambda it: it.demonstration_id, add, progress)
    if not dry_run:
        gather(catalog)
    status = {"added": "readable"} if dry_run else {}
    named = [replace(one, status=status.get(one.status, one.status)) for one in ingested]
    taken = dict(zip(flights, named, strict=True))
    return [_told(one, taken.get(str(one.path))) for one in found if one.status in ("flight", "refused")]


def passed_over(logs: Iterable[str | Path]) -> list[Ingested]:
    """The files that are named, or lie in folders that are named, and are no flights nor parts of one."""
    return [_told(one, None) for one in _surveyed([Path(log) for log in logs]) if one.status == "other"]


def _told(found: Found, taken: Ingested | None) -> Ingested:
    """What became of a file, with what it is."""
    if taken is not None:
        words = f"{found.words}: {taken.words}" if taken.words else found.words
        return replace(taken, file=str(found.path), words=words)
    refused = found.status == "refused"
    reason = f"{found.path}: {found.words}"
    return Ingested(found.path.name, "failed" if refused else "passed over", reason, file=str(found.path))


def _place(catalog: Catalog) -> tuple[str, Path]:
    return catalog.location, catalog.cache.folder


def placements_of(structures: pd.DataFrame) -> dict[str, Placement]:
    """Where the known structures stand, for logs in latitude and longitude."""
    placed = structures[structures["lat_deg"].notna()]
    columns = ["structure_id", "lat_deg", "lon_deg", "alt_m", "heading_deg", "datum"]
    return {row[0]: Placement(*row[1:]) for row in placed[columns].itertuples(index=False)}


def find_logs(logs: Iterable[str | Path]) -> list[Path]:
    """The flights that are named, or lie in the folders that are named; files that cannot be read among them.

    Raises
    ------
    InputError
        If a name does not exist, or there is no flight at all.
    """
    return [one.path for one in _surveyed([Path(log) for log in logs]) if one.status in ("flight", "refused")]


def _surveyed(names: list[Path]) -> list[Found]:
    """What the files are; one that is named and is no flight is refused, not passed over."""
    found = [
        replace(one, status="refused", words="is no flight that can be read")
        if one.status == "other" and one.path in names
        else one
        for one in survey(names)
    ]
    if not any(one.status in ("flight", "refused") for one in found):
        raise InputError(", ".join(map(str, names)) or "logs", "no flight was found", "at least one log")
    return found


_SIZES = ["size_x_m", "size_y_m", "size_z_m"]


@dataclass(frozen=True)
class _Stored:
    """What the catalog knows of its structures, by id.

    The words of a row are those of its entry, and what was found on the way. Which entry gave which words is
    noted in the cache; where that is lost, a row is as its entry says if its words begin so.
    """

    said: Mapping[str, tuple[str, ...]]  # hash, site and notes
    size_m: Mapping[str, np.ndarray]
    cache: Cache

    def same(self, entry: StructureEntry) -> Ingested | None:
        """Whether file and entry are as they were; a nominal size that fails is for the reader to tell."""
        name = entry.structure_id
        if name not in self.said:
            return None
        box = np.stack([np.zeros(3), self.size_m[name]])
        if nominal_problems(box, entry, ()) or meshes.fingerprint(entry) != self.said[name][0]:
            return None
        _, site, notes = self.said[name]
        begins = f"{notes}; ".startswith(f"{entry.notes}; ") or not entry.notes
        told = _Words(site, entry.notes if begins else notes)
        words = self.cache.get(_WORDS, _Words, digest(self.said[name])) or told
        return Ingested(name, "unchanged") if words == _Words(entry.site, entry.notes) else None

    def noted(
        self, reads: Iterator[tuple[str, Any]], entries: Mapping[str, StructureEntry]
    ) -> Iterator[tuple[str, Any]]:
        """The same, each structure with a note of which entry gave its words."""
        for name, read in reads:
            if isinstance(read, Structure):
                entry = entries[name]
                self.cache.put(_WORDS, digest(_said(read)), _Words(entry.site, entry.notes))
            yield name, read


@dataclass(frozen=True)
class _Words:
    """What an entry says that no plan depends on."""

    site: str
    notes: str


_WORDS = "words"


def _said(read: Structure | Demonstration) -> tuple[str, ...]:
    """What is new or changed where it differs; a demonstration's hash is of all its words."""
    return (read.sha256, read.site, read.notes) if isinstance(read, Structure) else (read.sha256,)


def _same_log(
    known: Mapping[str, tuple[str, ...]], placements: Mapping[str, Placement], options: LogOptions, path: Path
) -> Ingested | None:
    """Whether a log and what is said of it are as they were."""
    if not known:
        return None
    name, sha256 = log_reader.fingerprint(path, options, placements)
    return Ingested(name, "unchanged") if known.get(name) == (sha256,) else None


def each(
    read: Callable[[Item], Read],
    items: Sequence[Item],
    name: Callable[[Item], str],
    workers: int,
    same: Callable[[Item], Ingested | None] = lambda item: None,
) -> Iterator[tuple[str, Read | Ingested | str]]:
    """Name and record of each file, in order; where there is no record, the reason.

    A file that is the `same` as before is not read; whatever hinders that look, the reader tells.
    """
    count = max(1, min(workers or cores(), len(items)))
    with Workers(count) as pool, ThreadPoolExecutor(count) as threads:

        def one(item: Item) -> tuple[str, Read | Ingested | str]:
            with suppress(UppliedError, OSError, ValueError):
                if (before := same(item)) is not None:
                    return name(item), before
            try:
                return name(item), pool.run(read, item)
            except WorkersBroken:
                raise
            except (JobKilled, UppliedError) as error:
                return name(item), f"{name(item)}: {error}" if isinstance(error, JobKilled) else str(error)
            except Exception as error:
                return name(item), f"{name(item)}: {type(error).__name__}: {error}"

        remaining = iter(items)
        while batch := list(islice(remaining, BATCH)):
            yield from threads.map(one, batch)


def _findings(read: Structure | Demonstration) -> tuple[str, ...]:
    """What is odd about it, or was overruled, in words."""
    if isinstance(read, Demonstration):
        return tuple(map(str, findings_of(read.passport)))
    return tuple(map(str, from_json(read.verdicts_json)))


def _words(read: Structure | Demonstration) -> str:
    """As what a flight is taken."""
    if not isinstance(read, Demonstration):
        return ""
    camera = f"camera {read.camera.hfov_deg:.0f} x {read.camera.vfov_deg:.0f} deg"
    seconds = float(read.t_ns[-1] - read.t_ns[0]) * 1e-9
    notes = f"; {read.notes}" if read.notes else ""
    return (
        f"{read.demonstration_id} of {read.structure_id}, {len(read)} poses, {seconds:.0f} s, {camera}{notes}"
    )


def _keep(
    reads: Iterator[tuple[str, Kept | Ingested | str]],
    known: Mapping[str, tuple[str, ...]],
    identify: Callable[[Kept], str],
    add: Callable[[list[Kept]], object],
    progress: Progress,
) -> list[Ingested]:
    ingested: list[Ingested] = []
    waiting: list[Kept] = []
    seen: dict[str, str] = {}
    for name, read in reads:
        item = "" if isinstance(read, str) else read.name if isinstance(read, Ingested) else identify(read)
        if isinstance(read, str):
            ingested.append(Ingested(name, "failed", read))
        elif (first := seen.setdefault(item, name)) is not name:
            ingested.append(Ingested(name, "failed", f"{name}: its id {item!r} is that of {first}"))
        elif isinstance(read, Ingested) or known.get(item) == _said(read):
            ingested.append(Ingested(item, "unchanged"))
        else:
            words = _words(read)
            ingested.append(Ingested(item, "added", findings=_findings(read), words=words))
            waiting.append(read)
        progress(ingested[-1])
        if len(waiting) >= BATCH:
            add(waiting)
            waiting = []
    if waiting:
        add(waiting)
    return ingested
