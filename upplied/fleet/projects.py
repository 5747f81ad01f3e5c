"""Photogrammetry projects that bring their own structure: the surface and the flight in one command."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from os.path import isabs, relpath
from pathlib import Path

from upplied.errors import UppliedError
from upplied.fleet.admission import RuleOptions
from upplied.fleet.learn import learnt_flight
from upplied.fleet.reading import Ingested
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.sources.door import Found, kind_of
from upplied.inputs.sources.project_files import KINDS, Project, project_at
from upplied.records import Demonstration, Placement


def is_project(found: Found) -> bool:
    """Whether a file is that of the cameras of a project."""
    return found.is_flight and found.path.is_file() and kind_of(found.path) in KINDS


def facts_of(
    found: list[Found],
    options: LogOptions,
    add: Callable[[list[StructureEntry]], list[Ingested]],
) -> tuple[list[Found], list[Ingested], dict[str, LogOptions]]:
    """The structures of projects that name none, and the facts of the flights round them.

    Parameters
    ----------
    found : list of Found
        Files of a survey.
    options : LogOptions
        Facts about all of them.
    add : callable
        Stores the structures of entries.

    Returns
    -------
    found : list of Found
        The same; photos in the folder of such a project are part of it.
    ingested : list of Ingested
        What became of each structure.
    facts : dict of str to LogOptions
        By the file of the cameras.
    """
    projects: dict[str, Project] = {}
    for one in filter(is_project, found):
        with suppress(UppliedError, OSError):  # `read_flight` reports it
            project = project_at(one.path, options)
            projects |= {} if project is None else {str(one.path): project}
    if not projects:
        return found, [], {}
    surfaces = {
        project.entry.structure_id: str(project.entry.path if isabs(name) else relpath(project.entry.path))
        for name, project in projects.items()
    }
    ingested = add(RuleOptions(strict=options.strict).of([project.entry for project in projects.values()]))
    words = "structure of a photogrammetry project"
    structures = [replace(one, file=surfaces.get(one.name, one.name), words=words) for one in ingested]
    roots = {project.folder for project in projects.values()}
    photos = {one.path for one in found if one.path.is_dir() and roots & {*one.path.resolve().parents}}
    words = "photos of a photogrammetry project"
    found = [replace(one, status="part", words=words) if one.path in photos else one for one in found]
    return found, structures, {name: project.facts for name, project in projects.items()}


def read_flight(
    places: Mapping[str, tuple[str, Path]],
    place: tuple[str, Path],
    placements: Mapping[str, Placement],
    facts: Mapping[str, LogOptions],
    options: LogOptions,
    path: Path,
) -> Demonstration:
    """In a worker: the flight of one file, by its own facts and catalog where it has them.

    Raises
    ------
    InputError
        If it cannot be read, or is a project whose structure is not known well enough.
    """
    if str(path) not in facts and path.is_file() and kind_of(path) in KINDS:
        project_at(path, options)
    return learnt_flight(*places.get(str(path), place), placements, path, facts.get(str(path), options))
