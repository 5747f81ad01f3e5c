"""Demonstrations into the catalog."""

from __future__ import annotations

from prefect import flow
from prefect.states import Completed, State

from flows import tasks
from flows.artifacts import ingested_artifacts
from flows.parameters import Location


@flow(name="ingest-demonstrations", flow_run_name="demonstrations of {logs}")
def ingest_demonstrations(logs: list[Location], catalog: Location = "catalog", workers: int = 0) -> State:
    """Read logs, or folders of them; what is new or changed is kept.

    Args:
        logs: MCAP files, or folders of them.
        catalog: Folder or object-store URI.
        workers: Processes; 0 takes one per core.
    """
    ingested = tasks.ingest_demonstrations(catalog, logs, workers)
    return Completed(message=ingested_artifacts("ingest-demonstrations", ingested))
