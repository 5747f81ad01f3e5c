"""Logs of flights into the catalog: what they saw, the flights for what they left out, and the pages."""

from __future__ import annotations

from prefect import flow, runtime
from prefect.states import State

from . import tasks
from .artifacts import ingested_artifacts
from .lineage import asset, making, source
from .parameters import Location
from .roots import check_roots
from .states import ended, errors_in_words


def run_name() -> str:
    """What a run reads, in words."""
    return f"flights of {', '.join(runtime.flow_run.parameters['logs'])}"[:200]


@flow(name="ingest-flights", flow_run_name=run_name)
@errors_in_words
def ingest_flights(
    logs: list[Location], catalog: Location = "catalog", reports: str = "reports", gaps: bool = True
) -> State:
    """Read logs of flights; each is laid on the plan in force that it lies on best, and judged.

    Args:
        logs: MCAP files, or folders of them.
        catalog: Folder or object-store URI.
        reports: Folder to publish to; empty publishes nothing.
        gaps: Plan the flight for what a flight left out of what its plan shows; it is a draft.
    """
    for log in logs:
        check_roots(logs=log)
    check_roots(catalog=catalog, reports=reports)
    read = making(tasks.ingest_flights, asset(catalog, "flights"), [*map(source, logs)])
    files = read(catalog, logs)
    problems = [item["reason"] for item in files if item["status"] == "failed"]
    lost = bool(problems) and len(problems) == len(files)
    short = [item for item in files if item["status"] == "added" and item["left_out"]]
    problems += [f"{item['name']} left out {item['left_out']}" for item in short]
    if gaps and short:
        problems += tasks.plan_gaps(catalog, [item["flight"] for item in short])
    if reports:
        publish = making(tasks.publish_reports, asset(reports, "reports"), [asset(catalog, "flights")])
        problems += publish(catalog, reports)
    return ended(ingested_artifacts("ingest-flights", files), problems, lost)
