"""Demonstrations into the catalog."""

from __future__ import annotations

from prefect import flow, runtime
from prefect.states import Completed, State

from flows import tasks
from flows.artifacts import ingested_artifacts
from flows.parameters import Location


def run_name() -> str:
    """What a run reads, in words."""
    return f"demonstrations of {', '.join(runtime.flow_run.parameters['logs'])}"[:200]


@flow(name="ingest-demonstrations", flow_run_name=run_name)
def ingest_demonstrations(logs: list[Location], catalog: Location = "catalog", workers: int = 0) -> State:
    """Read logs, or folders of them; what is new or changed is kept.

    Args:
        logs: MCAP files, or folders of them.
        catalog: Folder or object-store URI.
        workers: Processes; 0 takes one per core.
    """
    ingested = tasks.ingest_demonstrations(catalog, logs, workers)
    return Completed(message=ingested_artifacts("ingest-demonstrations", ingested))
