"""Files read in worker processes: a bad one stops itself alone, an unchanged one is not parsed again."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from os.path import isabs, relpath
from pathlib import Path
from typing import TypeVar

from upplied.catalog import Catalog, open_catalog
from upplied.checks import suggested
from upplied.errors import InputError, UppliedError
from upplied.fleet.run import cores
from upplied.fleet.workers import JobKilled, Workers, WorkersBroken
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.inputs.passport.rules import findings_of
from upplied.inputs.rules import from_json
from upplied.inputs.sources.door import FileKind, kind_of
from upplied.inputs.sources.project_files import KINDS, Project, project_at
from upplied.planning.surface.parts import pieces_tell_parts
from upplied.recommend import shapes
from upplied.records import Demonstration, Placement, Structure

BATCH = 50  # files that are read before their records are committed together
Item = TypeVar("Item")
Read = TypeVar("Read")
Stored = TypeVar("Stored", Structure, Demonstration)


@dataclass(frozen=True)
class Ingested:
    name: str  # the id, or the file where no id is known
    # "added", "unchanged", "retired", "failed", "readable" (a trial), or "passed over": no flight
    status: str
    reason: str = ""
    findings: tuple[str, ...] = ()  # warnings, and rules that were overruled, in words
    file: str = ""
    words: str = ""  # what the file is, and the record that was made of it


Progress = Callable[[Ingested], None]


def each(
    read: Callable[[Item], Read],
    items: Sequence[Item],
    name: Callable[[Item], str],
    workers: int,
    same: Callable[[Item], Ingested | None] = lambda item: None,
) -> Iterator[tuple[str, Read | Ingested | str]]:
    """Name and record of each file, in order, or why there is none; one that is the `same` is not read."""
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


def content_of(read: Structure | Demonstration) -> tuple[str, ...]:
    """Values by which a record is known to be unchanged; a demonstration's hash is of all its words."""
    return (read.sha256, read.site, read.notes) if isinstance(read, Structure) else (read.sha256,)


def _added(name: str, read: Structure | Demonstration) -> Ingested:
    if isinstance(read, Structure):
        return Ingested(name, "added", findings=tuple(map(str, from_json(read.verdicts_json))))
    camera = f"camera {read.camera.hfov_deg:.0f} x {read.camera.vfov_deg:.0f} deg"
    seconds = float(read.t_ns[-1] - read.t_ns[0]) * 1e-9
    words = f"{name} of {read.structure_id}, {len(read)} poses, {seconds:.0f} s, {camera}"
    words += f"; {read.notes}" if read.notes else ""
    return Ingested(name, "added", findings=tuple(map(str, findings_of(read.passport))), words=words)


def stored(
    reads: Iterator[tuple[str, Stored | Ingested | str]],
    known: Mapping[str, tuple[str, ...]],
    identify: Callable[[Stored], str],
    add: Callable[[list[Stored]], object],
    progress: Progress,
) -> list[Ingested]:
    """What became of the files, their records added a batch at a time; a known one is left as it is."""
    ingested: list[Ingested] = []
    waiting: list[Stored] = []
    seen: dict[str, str] = {}
    for name, read in reads:
        item = "" if isinstance(read, str) else read.name if isinstance(read, Ingested) else identify(read)
        if isinstance(read, str):
            ingested.append(Ingested(name, "failed", read))
        elif (first := seen.setdefault(item, name)) is not name:
            reason = f"{name}: its id {item!r} is that of {first}. Rename one of them"
            ingested.append(Ingested(name, "failed", reason))
        elif isinstance(read, Ingested) or known.get(item) == content_of(read):
            ingested.append(Ingested(item, "unchanged"))
        else:
            ingested.append(_added(item, read))
            waiting.append(read)
        progress(ingested[-1])
        if len(waiting) >= BATCH:
            add(waiting)
            waiting = []
    if waiting:
        add(waiting)
    return ingested


log = logging.getLogger(__name__)


def learnt_structure(location: str, cache: Path, entry: StructureEntry) -> Structure:
    """The structure of one entry; its shape is remembered in the cache of the catalog at a location."""
    structure = read_structure(entry, judge=False)  # it is judged among others afterwards

    def learn() -> Structure:
        known = shapes.Shapes(open_catalog(location, cache))
        known.learn(structure)
        cloud = known.cloud(structure.structure_id, structure.sha256)
        return replace(structure, tells_parts=pieces_tell_parts(cloud))

    return _tried(learn, entry.structure_id) or structure


def learnt_flight(
    places: Mapping[str, tuple[str, Path]],
    place: tuple[str, Path],
    placements: Mapping[str, Placement],
    facts: Mapping[str, LogOptions],
    options: LogOptions | None,
    path: Path,
) -> Demonstration:
    """The demonstration of one file with its passport; what it saw is remembered.

    The catalog is at `place` (location and cache), or where `places` says; `facts` of single files stand
    for `options`. An `InputError` where the file, its passport or its structure is not good enough.
    """
    own = facts.get(str(path), options)
    if str(path) not in facts and path.is_file() and kind_of(path) in KINDS:
        project_at(path, own or LogOptions())
    catalog = open_catalog(*places.get(str(path), place))
    structures: list[Structure] = []

    def structure_of(structure_id: str) -> Structure:
        known = catalog.structures()["structure_id"]
        if structure_id not in set(known):
            fault = f"was flown on {structure_id!r}, which is not in the catalog"
            remedy = "add the structure first, or correct structure_id"
            raise InputError(str(path), fault, suggested(structure_id, known), remedy)
        structures.append(catalog.structure(structure_id))
        return structures[0]

    flight = read_demonstration(path, own, placements, structure_of)
    _tried(lambda: shapes.Shapes(catalog).learn_flight(flight, structures[0]), flight.demonstration_id)
    return flight


def gather(catalog: Catalog) -> None:
    """Put the features of structures with flights together, where all of them are known."""
    structures = catalog.structures().set_index("structure_id")
    flown = structures.loc[structures.index.intersection(catalog.demonstrations()["structure_id"])]
    shapes.Shapes(catalog).gather(shapes.content_of(flown.sort_index(), "mesh_sha256").to_dict())


def _tried(learn: Callable[[], Read], name: str) -> Read | None:
    """A file that was read is kept, whatever hinders this: it is found out, or told, when it is asked for."""
    try:
        return learn()
    except Exception as error:
        log.warning("%s: nothing is known of its shape yet: %s", name, error)
        return None


def is_project(file: FileKind) -> bool:
    return file.is_flight and file.path.is_file() and kind_of(file.path) in KINDS


def facts_of(
    files: list[FileKind], options: LogOptions, add: Callable[[list[StructureEntry]], list[Ingested]]
) -> tuple[list[FileKind], list[Ingested], dict[str, LogOptions]]:
    """The structures of projects that name none, stored by `add`, and the facts of the flights round them.

    Returns the files (photos of such a project are part of it), what became of each structure, and facts by
    file.
    """
    projects: dict[str, Project] = {}
    for one in filter(is_project, files):
        with suppress(UppliedError, OSError):  # `learnt_flight` reports it
            project = project_at(one.path, options)
            projects |= {} if project is None else {str(one.path): project}
    if not projects:
        return files, [], {}
    surfaces = {
        project.entry.structure_id: str(project.entry.path if isabs(name) else relpath(project.entry.path))
        for name, project in projects.items()
    }
    ingested = add([project.entry for project in projects.values()])
    words = "structure of a photogrammetry project"
    structures = [replace(one, file=surfaces.get(one.name, one.name), words=words) for one in ingested]
    roots = {project.folder for project in projects.values()}
    photos = {one.path for one in files if one.path.is_dir() and roots & {*one.path.resolve().parents}}
    words = "photos of a photogrammetry project"
    files = [replace(one, status="part", words=words) if one.path in photos else one for one in files]
    return files, structures, {name: project.facts for name, project in projects.items()}
