"""Every demonstration to every structure of its kind, touching only what changed."""

from __future__ import annotations

from itertools import count

from prefect import flow, runtime
from prefect.states import State

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.errors import CatalogError
from upplied.findings import campaign
from upplied.fleet.edits import carry_edits
from upplied.fleet.flights import fly_drafts

from .engines import Planned, plan
from .environment import check_roots
from .ingest import ingest_demonstrations, ingest_structures
from .parameters import ALL_CORES, Changes, Id, Location, Millimetres, Presets, Resources
from .states import ended, errors_in_words, planned, transfer_artifacts
from .tasks import asset, publish, recheck_plans, record_plans, stored

NO_CHANGES = Changes()
BOTH: Presets = ["recommended", "baseline"]


def run_name() -> str:
    """What a run does, in words."""
    parameters = runtime.flow_run.parameters
    flown = ", ".join(parameters.get("demonstrations") or []) or "every demonstration"
    targets = ", ".join(parameters.get("targets") or []) or "the fleet"
    return f"{flown} to {targets}"[:200]


@flow(name="transfer-fleet", flow_run_name=run_name)
@errors_in_words
def transfer_fleet(
    catalog: Location = "catalog",
    reports: str = "reports",
    manifest: str = "",
    prune: bool = False,
    logs: list[Location] | None = None,
    demonstrations: list[Id] | None = None,
    targets: list[Id] | None = None,
    presets: Presets = BOTH,
    changes: Changes = NO_CHANGES,
    retry_failed: bool = False,
    experiment: Id | None = None,
    fly: bool = False,
    campaigns: list[Id] | None = None,
    campaign_mm_px: Millimetres = 2.0,
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
    values = changes.model_dump(exclude_unset=True)
    plan_request = fleet.PlanRequest(tuple(presets), values, flown, there, retry_failed, experiment or "")
    store = open_catalog(catalog)
    if unread := [run.message or run.name for run in read if run.name != "Completed"]:
        try:
            store.identity.required()
        except CatalogError as error:  # the first night: why there is no catalog is what was not read
            return ended(str(error), unread, all_failed=True)
    structures, flights, plans = (
        asset(catalog, name) for name in ("structures", "demonstrations", "transfers")
    )
    record = stored("record-plans", record_plans, plans, [structures, flights])
    decision, outcome = fleet.Decision([], 0), Planned()
    # A structure that was read just now may not be what the plan in force was judged on.
    problems = [*stored("recheck-plans", recheck_plans)(store, resources.timeout_s), *unread]
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
    summary = transfer_artifacts(store, decision, outcome.result, reports)
    return planned(summary, outcome, problems, resources.most_lost)
