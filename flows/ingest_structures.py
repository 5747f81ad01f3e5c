"""Structures into the catalog."""

from __future__ import annotations

from prefect import flow
from prefect.states import State

from . import tasks
from .artifacts import ingested_artifacts
from .lineage import asset, making, source
from .parameters import Location, StructureBounds, StructureRule, bound_options
from .roots import check_roots
from .states import errors_in_words, ingested


@flow(name="ingest-structures", flow_run_name="structures of {manifest}")
@errors_in_words
def ingest_structures(
    manifest: Location,
    catalog: Location = "catalog",
    workers: int = 0,
    prune: bool = False,
    allow: list[StructureRule] = [],  # type: ignore[valid-type] # noqa: B006 - nobody changes it
    strict: bool = False,
    bounds: StructureBounds = StructureBounds(),  # type: ignore[valid-type] # noqa: B008
) -> State:
    """Read the meshes that a manifest names; what is new or changed is kept.

    Args:
        manifest: `structures.toml` or a CSV.
        catalog: Folder or object-store URI.
        workers: Processes; 0 takes one per core.
        prune: Retire structures that the manifest no longer names; their history stays.
        allow: Rules that are overruled for these structures, which is kept (docs/checks.md).
        strict: Refuse what is odd too.
        bounds: Of the rules, where they differ from the defaults.
    """
    check_roots(catalog=catalog, manifest=manifest)
    read = making(tasks.ingest_structures, asset(catalog, "structures"), [source(manifest)])
    files = read(catalog, manifest, workers, prune, allow, strict, bound_options(bounds))
    return ingested(ingested_artifacts("ingest-structures", files), files)
