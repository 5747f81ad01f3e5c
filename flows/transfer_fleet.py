"""Every demonstration to every structure of its kind, touching only what changed."""

from __future__ import annotations

from prefect import flow, runtime
from prefect.states import Completed, Failed, State

from flows import tasks
from flows.artifacts import transfer_artifacts
from flows.engines import plan
from flows.ingest_demonstrations import ingest_demonstrations
from flows.ingest_structures import ingest_structures
from flows.parameters import Changes, Id, Location, Presets, Resources, wish_of
from upplied import fleet
from upplied.catalog import open_catalog
from upplied.errors import UppliedError

NO_CHANGES, ALL_CORES = Changes(), Resources()


def run_name() -> str:
    """What a run does, in words."""
    given = runtime.flow_run.parameters
    flown = ", ".join(given.get("demonstrations") or []) or "every demonstration"
    targets = ", ".join(given.get("targets") or []) or "the fleet"
    return f"{flown} to {targets}"[:200]


@flow(name="transfer-fleet", flow_run_name=run_name)
def transfer_fleet(
    catalog: Location = "catalog",
    reports: str = "reports",
    manifest: str = "",
    prune: bool = False,
    logs: list[Location] | None = None,
    demonstrations: list[Id] | None = None,
    targets: list[Id] | None = None,
    presets: Presets = ("recommended", "baseline"),
    changes: Changes = NO_CHANGES,
    retry_failed: bool = False,
    resources: Resources = ALL_CORES,
) -> State:
    """Plan every pair whose inputs changed since it was planned, and publish.

    Args:
        catalog: Folder or object-store URI.
        reports: Folder to publish to; empty publishes nothing.
        manifest: Structures to read first; empty reads none.
        prune: Retire structures that the manifest no longer names; their history stays.
        logs: Logs, or folders of them, to read first.
        demonstrations: Ids; none means every one.
        targets: Ids; none means every structure of the demonstration's kind.
        presets: What to plan for each pair.
        changes: Settings that differ from the presets'.
        retry_failed: Also plan again what failed before.
        resources: Engine, processes, time and memory.
    """
    wish = wish_of(presets, changes, demonstrations, targets, retry_failed)
    kept = open_catalog(catalog)
    try:
        if manifest:
            ingest_structures(manifest, catalog, resources.workers, prune)
        if logs:
            ingest_demonstrations(logs, catalog, resources.workers)
        decision = fleet.decide(kept, wish)
        result = plan(catalog, decision.jobs, wish, resources)
    except UppliedError as error:  # what a person can mend is told in words
        return Failed(message=str(error))
    if reports:
        tasks.publish_reports(catalog, reports)
    return Completed(message=transfer_artifacts(kept, decision, result, reports))
