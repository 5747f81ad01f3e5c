"""Files read in a worker process, and what questions will ask of them found out with them.

So a structure that was just taken in is compared with thousands of others in a moment: the question
needs neither its mesh nor the flights over the others again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from upplied.catalog import Catalog, open_catalog
from upplied.errors import InputError
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
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
    location: str,
    cache: Path,
    placements: Mapping[str, Placement],
    path: Path,
    options: LogOptions | None = None,
) -> Demonstration:
    """The demonstration of one log with its passport; what it saw is remembered.

    Raises
    ------
    InputError
        If its structure is not in the catalog, or it breaks a rule that is not overruled.
    """
    catalog = open_catalog(location, cache)
    structures: list[Structure] = []

    def structure_of(structure_id: str) -> Structure:
        known = sorted(catalog.structures()["structure_id"])
        if structure_id not in known:
            near = get_close_matches(structure_id, known, 3) or known[:8]
            raise InputError(
                str(path),
                f"was flown on {structure_id!r}, which is not in the catalog",
                f"a structure of the catalog: {', '.join(near) or 'it holds none'}",
                "add the structure first, or correct structure_id",
            )
        structures.append(catalog.structure(structure_id))
        return structures[0]

    flight = read_demonstration(path, options, placements, structure_of)
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
