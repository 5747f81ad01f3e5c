"""Demonstrations into the catalog."""

from __future__ import annotations

from prefect import flow, runtime
from prefect.states import State

from . import tasks
from .artifacts import ingested_artifacts
from .lineage import asset, making, source
from .parameters import FlightBounds, FlightRule, Location, bound_options
from .roots import check_roots
from .states import errors_in_words, ingested


def run_name() -> str:
    """What a run reads, in words."""
    return f"demonstrations of {', '.join(runtime.flow_run.parameters['logs'])}"[:200]


@flow(name="ingest-demonstrations", flow_run_name=run_name)
@errors_in_words
def ingest_demonstrations(
    logs: list[Location],
    catalog: Location = "catalog",
    workers: int = 0,
    allow: list[FlightRule] = [],  # type: ignore[valid-type] # noqa: B006 - nobody changes it
    strict: bool = False,
    bounds: FlightBounds = FlightBounds(),  # type: ignore[valid-type] # noqa: B008
) -> State:
    """Read flights of any kind, or folders of them; what is new or changed is kept.

    Args:
        logs: Logs, photogrammetry projects, missions, folders of photos, or folders of all of these.
        catalog: Folder or object-store URI.
        workers: Processes; 0 takes one per core.
        allow: Rules that are overruled for these logs, which is kept (docs/checks.md).
        strict: Refuse what is odd too.
        bounds: Of the rules, where they differ from the defaults.
    """
    for log in logs:
        check_roots(logs=log)
    check_roots(catalog=catalog)
    read = making(tasks.ingest_demonstrations, asset(catalog, "demonstrations"), [*map(source, logs)])
    files = read(catalog, logs, workers, allow, strict, bound_options(bounds))
    return ingested(ingested_artifacts("ingest-demonstrations", files), files)
