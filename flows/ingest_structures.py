"""Structures into the catalog."""

from __future__ import annotations

from prefect import flow
from prefect.states import Completed, State

from flows import tasks
from flows.artifacts import ingested_artifacts
from flows.parameters import Location


@flow(name="ingest-structures", flow_run_name="structures of {manifest}")
def ingest_structures(
    manifest: Location, catalog: Location = "catalog", workers: int = 0, prune: bool = False
) -> State:
    """Read the meshes that a manifest names; what is new or changed is kept.

    Args:
        manifest: `structures.toml` or a CSV.
        catalog: Folder or object-store URI.
        workers: Processes; 0 takes one per core.
        prune: Retire structures that the manifest no longer names; their history stays.
    """
    ingested = tasks.ingest_structures(catalog, manifest, workers, prune)
    return Completed(message=ingested_artifacts("ingest-structures", ingested))
