"""The deployed flows: files into the catalog, every pair planned, published, kept small and checked."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import Annotated

from prefect import flow, runtime
from prefect.states import Completed, Failed, State
from pydantic import Field

from upplied import fleet
from upplied.catalog import compact, open_catalog, vacuum, verify
from upplied.errors import CatalogError
from upplied.findings import campaign
from upplied.fleet.edits import carry_edits
from upplied.fleet.flight_logs import add_flight_logs
from upplied.fleet.flights import fly_drafts
from upplied.fleet.gaps import plan_gaps
from upplied.fleet.ingest import passed_over
from upplied.inputs.passport import settings as passport
from upplied.inputs.rules import changed as changed_bounds
from upplied.inputs.sidecar import LogOptions

from . import parameters, states, tasks
from .engines import Planned, plan
from .environment import check_roots
from .parameters import Location
from .states import ended, errors_in_words
from .tasks import asset, publish, source, stored


def files_run() -> str:
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
    allow: list[parameters.StructureRule] = [],  # type: ignore[valid-type] # noqa: B006 - nobody changes it
    strict: bool = False,
    bounds: parameters.StructureBounds = parameters.StructureBounds(),  # type: ignore[valid-type] # noqa: B008
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
    rules = fleet.RuleOptions(tuple(allow), strict, changed_bounds(parameters.bound_options(bounds)))
    makes = asset(catalog, "structures"), [source(manifest)]
    read = stored("ingest-structures", fleet.ingest_structures, *makes)
    files = read(open_catalog(catalog), manifest, workers, prune=prune, rules=rules)
    return states.ingested(*states.ingested_artifacts("ingest-structures", files))


@flow(name="ingest-demonstrations", flow_run_name=files_run)
@errors_in_words
def ingest_demonstrations(
    logs: list[Location],
    catalog: Location = "catalog",
    workers: int = 0,
    allow: list[parameters.FlightRule] = [],  # type: ignore[valid-type] # noqa: B006 - nobody changes it
    strict: bool = False,
    bounds: parameters.FlightBounds = parameters.FlightBounds(),  # type: ignore[valid-type] # noqa: B008
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
    options = log_options(allow, strict, parameters.bound_options(bounds))
    makes = asset(catalog, "demonstrations"), [*map(source, logs)]
    read = stored("ingest-demonstrations", fleet.ingest_demonstrations, *makes)
    files = read(open_catalog(catalog), logs, workers, options=options)
    return states.ingested(*states.ingested_artifacts("ingest-demonstrations", [*files, *passed_over(logs)]))


def log_options(allow: Sequence[str], strict: bool, bounds: Sequence[str]) -> LogOptions:
    """What a run says of all its logs: rules that are overruled, whether oddities are refused, and bounds."""
    return LogOptions(allow=tuple(allow), strict=strict, passport=passport.changed(tuple(bounds)))


@flow(name="ingest-flights", flow_run_name=files_run)
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
    summary, files = states.ingested_artifacts(
        "ingest-flights", stored("ingest-flights", add_flight_logs, *makes)(store, logs)
    )
    problems = [item["reason"] for item in files if item["status"] == "failed"]
    lost = bool(problems) and len(problems) == len(files)
    short = [item for item in files if item["status"] == "added" and item["left_out"]]
    problems += [f"{item['name']} left out {item['left_out']}" for item in short]
    if gaps and short:
        problems += stored("plan-gaps", plan_gaps)(store, [item["flight"] for item in short])
    if reports:
        problems += publish(catalog, reports, "flights")
    return ended(summary, problems, lost)


NO_CHANGES = parameters.Changes()
BOTH: parameters.Presets = ["recommended", "baseline"]


def pairs_run() -> str:
    """What a run does, in words."""
    given = runtime.flow_run.parameters
    flown = ", ".join(given.get("demonstrations") or []) or "every demonstration"
    targets = ", ".join(given.get("targets") or []) or "the fleet"
    return f"{flown} to {targets}"[:200]


@flow(name="transfer-fleet", flow_run_name=pairs_run)
@errors_in_words
def transfer_fleet(
    catalog: Location = "catalog",
    reports: str = "reports",
    manifest: str = "",
    prune: bool = False,
    logs: list[Location] | None = None,
    demonstrations: list[parameters.Id] | None = None,
    targets: list[parameters.Id] | None = None,
    presets: parameters.Presets = BOTH,
    changes: parameters.Changes = NO_CHANGES,  # type: ignore[valid-type]
    retry_failed: bool = False,
    experiment: parameters.Id | None = None,
    fly: bool = False,
    campaigns: list[parameters.Id] | None = None,
    campaign_mm_px: parameters.Millimetres = 2.0,
    resources: parameters.Resources = parameters.ALL_CORES,
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
        experiment: A name; these plans are for comparison, and never become current.
        fly: Fly each new plan of `recommended` in simulated wind, and tell where it comes too near.
        campaigns: Findings whose places are to be looked at on every structure of their kind: a draft for
            each where no flight showed the place.
        campaign_mm_px: Millimetres a pixel, at most, of such looks.
        resources: Engine, processes, time and memory, and how much an engine may lose.
    """
    check_roots(catalog=catalog, reports=reports, manifest=manifest)
    read = []
    if manifest:
        read.append(ingest_structures(manifest, catalog, resources.workers, prune, return_state=True))
    if logs:
        read.append(ingest_demonstrations(logs, catalog, resources.workers, return_state=True))
    flown, there = tuple(demonstrations or ()), tuple(targets or ())
    given = changes.model_dump(exclude_unset=True)  # type: ignore[attr-defined]
    plan_request = fleet.PlanRequest(tuple(presets), given, flown, there, retry_failed, experiment or "")
    store = open_catalog(catalog)
    if unread := [run.message or run.name for run in read if run.name != "Completed"]:
        try:
            store.identity.required()
        except CatalogError as error:  # the first night: why there is no catalog is what was not read
            return ended(str(error), unread, all_failed=True)
    structures, flights, plans = (
        asset(catalog, name) for name in ("structures", "demonstrations", "transfers")
    )
    record = stored("record-plans", tasks.record_plans, plans, [structures, flights])
    decision, outcome = fleet.Decision([], 0), Planned()
    # A structure that was read just now may not be what the plan in force was judged on.
    problems = [*stored("recheck-plans", tasks.recheck_plans)(store, resources.timeout_s), *unread]
    # What lands while this run plans or publishes is planned by it as well: a run that is started
    # meanwhile is cancelled.
    for times in count():
        now, tried = fleet.decide(store, plan_request), {job.key for job in decision.jobs}
        new = [job for job in now.jobs if job.key not in tried]
        if times and not new:
            break
        decision = fleet.Decision([*decision.jobs, *new], decision.unchanged if times else now.unchanged)
        outcome.include(plan(catalog, new, resources))
        record(plans, runtime.flow_run.id, outcome.result)
        problems += stored("carry-edits", carry_edits)(store)
        if fly:
            problems += stored("fly-drafts", fly_drafts)(store, [job.key for job in new])
        if campaigns:
            jobs, unplanned = campaign.due_jobs(store, campaigns, campaign_mm_px, retry_failed)
            outcome.include(plan(catalog, jobs, resources))
            problems += [text for text in unplanned if text not in problems]
        if reports:
            problems += publish(catalog, reports)
    summary = states.transfer_artifacts(store, decision, outcome.result, reports)
    return states.planned(summary, outcome, problems, resources.most_lost)


@flow(name="publish-reports", flow_run_name="publish to {folder}")
@errors_in_words
def publish_reports(folder: Location = "reports", catalog: Location = "catalog") -> State:
    """Publish the catalog as plain Parquet, an HTML page and pictures.

    Args:
        folder: Where to; what it held is replaced.
        catalog: Folder or object-store URI.
    """
    check_roots(catalog=catalog, folder=folder)
    return ended(f"published to {folder}", publish(catalog, folder))


@flow(name="maintain-catalog", flow_run_name="maintain {catalog}")
@errors_in_words
def maintain_catalog(catalog: Location = "catalog", keep_days: Annotated[float, Field(ge=1)] = 30.0) -> State:
    """Merge small files, remove what nobody can ask for any more, and check every reference and hash.

    Args:
        catalog: Folder or object-store URI.
        keep_days: Versions younger than this can still be asked for.
    """
    check_roots(catalog=catalog)
    store = open_catalog(catalog)
    merged = stored("compact", compact)(store)
    stored("vacuum", vacuum)(store, keep_days)
    findings = [str(finding) for finding in stored("verify", verify)(store)]
    summary = states.maintenance_artifact(merged, findings)
    return Failed(message=summary) if findings else Completed(message=summary)
