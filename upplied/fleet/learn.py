"""Files read in a worker process, and what questions will ask of them found out with them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from os.path import isabs, relpath
from pathlib import Path

from upplied.catalog import Catalog, open_catalog
from upplied.checks import suggested
from upplied.errors import InputError, UppliedError
from upplied.fleet.admission import RuleOptions
from upplied.fleet.reading import Ingested
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.inputs.sources.door import FileKind, kind_of
from upplied.inputs.sources.project_files import KINDS, Project, project_at
from upplied.planning.surface.parts import pieces_tell_parts
from upplied.recommend.shapes import Shapes, content_of
from upplied.records import Demonstration, Placement, Structure

log = logging.getLogger(__name__)


def learnt_structure(location: str, cache: Path, entry: StructureEntry) -> Structure:
    """The structure of one entry; its shape is remembered in the cache of the catalog at a location."""
    structure = read_structure(entry, judge=False)  # it is judged among others afterwards
    labels: list[bool] = []

    def learn() -> None:
        shapes = Shapes(open_catalog(location, cache))
        shapes.learn(structure)
        labels.append(pieces_tell_parts(shapes.cloud(structure.structure_id, structure.sha256)))

    _tried(learn, entry.structure_id)
    return replace(structure, tells_parts=labels[0]) if labels else structure


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
    _tried(lambda: Shapes(catalog).learn_flight(flight, structures[0]), flight.demonstration_id)
    return flight


def gather(catalog: Catalog) -> None:
    """Put the features of structures with flights together, where all of them are known."""
    structures = catalog.structures().set_index("structure_id")
    flown = structures.loc[structures.index.intersection(catalog.demonstrations()["structure_id"])]
    Shapes(catalog).gather(content_of(flown.sort_index(), "mesh_sha256").to_dict())


def _tried(learn: Callable[[], None], name: str) -> None:
    """A file that was read is kept, whatever hinders this: it is found out, or told, when it is asked for."""
    try:
        learn()
    except Exception as error:
        log.warning("%s: nothing is known of its shape yet: %s", name, error)


def is_project(file: FileKind) -> bool:
    """Whether a file is that of the cameras of a project."""
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
    ingested = add(RuleOptions(strict=options.strict).of([project.entry for project in projects.values()]))
    words = "structure of a photogrammetry project"
    structures = [replace(one, file=surfaces.get(one.name, one.name), words=words) for one in ingested]
    roots = {project.folder for project in projects.values()}
    photos = {one.path for one in files if one.path.is_dir() and roots & {*one.path.resolve().parents}}
    words = "photos of a photogrammetry project"
    files = [replace(one, status="part", words=words) if one.path in photos else one for one in files]
    return files, structures, {name: project.facts for name, project in projects.items()}
