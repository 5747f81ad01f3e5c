"""Files into the catalog: structures, demonstrations, and flights of plans, each by a flow of its own."""

from __future__ import annotations

from collections.abc import Sequence

from prefect import flow, runtime
from prefect.states import State

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.fleet.flight_logs import add_flight_logs
from upplied.fleet.gaps import plan_gaps
from upplied.fleet.ingest import passed_over
from upplied.inputs.rules import PassportSettings, StructureSettings
from upplied.inputs.sidecar import LogOptions

from .environment import check_roots
from .parameters import FlightBounds, FlightRule, Location, StructureBounds, StructureRule, bound_options
from .states import errors_in_words, ingested, ingested_artifacts
from .tasks import asset, publish, source, stored


def run_name() -> str:
    """What a run reads, in words."""
    what = runtime.flow_run.flow_name.removeprefix("ingest-")
    return f"{what} of {', '.join(runtime.flow_run.parameters['logs'])}"[:200]


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
    rules = fleet.RuleOptions(tuple(allow), strict, StructureSettings.changed(bound_options(bounds)))
    makes = asset(catalog, "structures"), [source(manifest)]
    read = stored("ingest-structures", fleet.ingest_structures, *makes)
    files = read(open_catalog(catalog), manifest, workers, prune=prune, rules=rules)
    return ingested(*ingested_artifacts("ingest-structures", files))


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
    check_roots(catalog=catalog, logs=logs)
    options = log_options(allow, strict, bound_options(bounds))
    makes = asset(catalog, "demonstrations"), [*map(source, logs)]
    read = stored("ingest-demonstrations", fleet.ingest_demonstrations, *makes)
    files = read(open_catalog(catalog), logs, workers, options=options)
    return ingested(*ingested_artifacts("ingest-demonstrations", [*files, *passed_over(logs)]))


def log_options(allow: Sequence[str], strict: bool, bounds: Sequence[str]) -> LogOptions:
    """What a run says of all its logs: rules that are overruled, whether oddities are refused, and bounds."""
    return LogOptions(allow=tuple(allow), strict=strict, passport=PassportSettings.changed(bounds))


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
    check_roots(catalog=catalog, logs=logs, reports=reports)
    store, makes = open_catalog(catalog), (asset(catalog, "flights"), [*map(source, logs)])
    summary, files = ingested_artifacts(
        "ingest-flights", stored("ingest-flights", add_flight_logs, *makes)(store, logs)
    )
    short = [item for item in files if item["status"] == "added" and item["left_out"]]
    problems = [f"{item['name']} left out {item['left_out']}" for item in short]
    if gaps and short:
        problems += stored("plan-gaps", plan_gaps)(store, [item["flight"] for item in short])
    if reports:
        problems += publish(catalog, reports, "flights")
    return ingested(summary, files, problems)
