"""Files read in a worker process, and what questions will ask of them found out with them.

So a structure that was just taken in is compared with thousands of others in a moment: the question
needs neither its mesh nor the flights over the others again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from pathlib import Path

from upplied.catalog import Catalog, open_catalog
from upplied.inputs.logs import read_demonstration
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.recommend.shapes import Shapes, content_of
from upplied.records import Demonstration, Placement, Structure

log = logging.getLogger(__name__)


def learnt_structure(location: str, cache: Path, entry: StructureEntry) -> Structure:
    """The structure of one entry; its shape is remembered in the cache of the catalog at a location."""
    structure = read_structure(entry)
    _tried(lambda: Shapes(open_catalog(location, cache)).learn(structure), entry.structure_id)
    return structure


def learnt_flight(
    location: str, cache: Path, placements: Mapping[str, Placement], path: Path
) -> Demonstration:
    """The demonstration of one log; what it saw is remembered where its structure is in the catalog."""
    flight = read_demonstration(path, placements=placements)

    def learn() -> None:
        catalog = open_catalog(location, cache)
        if flight.structure_id in set(catalog.structures()["structure_id"]):
            Shapes(catalog).learn_flight(flight, catalog.structure(flight.structure_id))

    _tried(learn, flight.demonstration_id)
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
