"""The tasks: each calls one function of `upplied.fleet` and hands on nothing but names and counts.

Data lives in the catalog and its cache. Prefect keeps no results of ours (`NO_CACHE`), and its task
table is not the record of what is done: the catalog is.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from operator import attrgetter
from typing import Any

from prefect import task
from prefect.assets import add_asset_metadata, materialize
from prefect.cache_policies import NO_CACHE
from prefect.events import emit_event
from prefect.states import State
from prefect.tasks import exponential_backoff

from upplied import fleet
from upplied.catalog import open_catalog
from upplied.catalog.verbs import maintenance, verification
from upplied.errors import CatalogError
from upplied.findings import campaign, queries
from upplied.fleet import edits, flights, gaps
from upplied.fleet import manifest as shards
from upplied.fleet.flight_logs import add_flight_logs
from upplied.fleet.ingest import passed_over
from upplied.inputs import structure_rules
from upplied.inputs.passport import settings as passport
from upplied.inputs.sidecar import LogOptions

from . import pool
from .lineage import SOMEWHERE, asset

RECALLED = "upplied.plan.recalled"  # the event of a plan in force that is not safe any more
RUNS: dict[str, fleet.Run] = {}  # of this process, by run id


def store_failed(task: Any, run: Any, state: State[Any]) -> bool:
    """Whether a task ended because a store was away or refused, which may be over in a moment."""
    try:
        state.result()
    except (CatalogError, OSError):
        return True
    except BaseException:
        return False
    return False


# Of what reads and writes stores: tried again after about 2, 4 and 8 s, where it was the store that failed.
STORED: dict[str, Any] = {
    "cache_policy": NO_CACHE,
    "retries": 3,
    "retry_delay_seconds": exponential_backoff(2),
    "retry_jitter_factor": 0.5,
    "retry_condition_fn": store_failed,
}


@materialize(SOMEWHERE, name="ingest-structures", task_run_name="ingest structures", **STORED)
def ingest_structures(
    catalog: str,
    manifest: str,
    workers: int,
    prune: bool,
    allow: Sequence[str] = (),
    strict: bool = False,
    limits: Sequence[str] = (),
) -> list[dict[str, str]]:
    """Every structure of a manifest into the catalog; a bad file stops itself alone."""
    rules = fleet.RuleOptions(tuple(allow), strict, structure_rules.changed(limits))
    ingested = fleet.ingest_structures(open_catalog(catalog), manifest, workers, prune=prune, rules=rules)
    return [_plain(item) for item in ingested]


@materialize(SOMEWHERE, name="ingest-demonstrations", task_run_name="ingest demonstrations", **STORED)
def ingest_demonstrations(
    catalog: str,
    logs: list[str],
    workers: int,
    allow: Sequence[str] = (),
    strict: bool = False,
    limits: Sequence[str] = (),
) -> list[dict[str, str]]:
    """Every log into the catalog; a bad log stops itself alone."""
    options = LogOptions(allow=tuple(allow), strict=strict, passport=passport.changed(tuple(limits)))
    ingested = fleet.ingest_demonstrations(open_catalog(catalog), logs, workers, options=options)
    return [_plain(item) for item in (*ingested, *passed_over(logs))]


@materialize(SOMEWHERE, name="ingest-flights", task_run_name="ingest flights", **STORED)
def ingest_flights(catalog: str, logs: list[str]) -> list[dict[str, str]]:
    """Every log of a flight into the catalog; a bad log stops itself alone."""
    return add_flight_logs(open_catalog(catalog), logs)


@task(name="plan-gaps", task_run_name="plan gaps", **STORED)
def plan_gaps(catalog: str, flights: list[str]) -> list[str]:
    """A draft for what each flight left out; why there is none, in words."""
    return gaps.plan_gaps(open_catalog(catalog), flights)


@materialize(SOMEWHERE, name="record-plans", task_run_name="record plans", cache_policy=NO_CACHE)
def record_plans(catalog: str, run_id: str, result: fleet.Result) -> None:
    """Tell Prefect what of the catalog's plans a run made."""
    counts = {"ok": result.ok, "refused": result.refused, "failed": result.failed}
    add_asset_metadata(asset(catalog, "transfers"), {"run_id": run_id, **counts})


@task(name="recheck-plans", task_run_name="recheck plans in force", **STORED)
def recheck_plans(catalog: str, timeout_s: float) -> list[str]:
    """Judge plans in force whose structure changed; what a person should look at, in words."""
    rechecked = fleet.recheck(open_catalog(catalog), fleet.Limits(timeout_s))
    for each in filter(attrgetter("recalled"), rechecked):
        names = {"id": f"upplied.plan.{each.transfer_id}", "name": each.target_id}
        resource = {f"prefect.resource.{key}": name for key, name in names.items()}
        emit_event(RECALLED, resource, payload={"transfer_id": each.transfer_id, "why": each.note})
    return [str(each) for each in rechecked if each.troubled]


@task(name="plan", task_run_name="{name}", cache_policy=NO_CACHE)
def plan_shard(name: str, run_id: str, shard: int) -> None:
    """Plan one shard of a run in its worker processes."""
    RUNS[run_id].plan(shard)


@task(name="plan-elsewhere", task_run_name="{name}", cache_policy=NO_CACHE)
def plan_elsewhere(name: str, shard: str, given: dict[str, Any]) -> None:
    """Plan one shard in the process that an engine chose."""
    catalog, limits, worker = given["catalog"], fleet.Limits(**given["limits"]), worker_of(given["engine"])
    # Before anything is noted: a run that has ended took its shards away.
    jobs = shards.read_shard(catalog, shard)
    with shards.attempt(catalog, shard, worker):
        fleet.plan_here(catalog, jobs, given["run_id"], worker, limits, campaign.plan_job)


def worker_of(engine: str) -> str:
    """The engine and its worker that this process belongs to, by the name that the engine knows it by."""
    if engine == "dask":
        from distributed import get_worker

        return f"dask:{get_worker().address.split('://')[-1]}"
    if engine == "ray":
        from ray import get_runtime_context

        return f"ray:{get_runtime_context().get_worker_id()}"
    return f"{engine}:{os.environ.get('PREFECT__WORKER_NAME') or socket.gethostname()}"


@task(name="plan-on-pool", task_run_name="{name}", cache_policy=NO_CACHE, retries=1)
def plan_on_pool(name: str, shard: str, given: dict[str, Any]) -> None:
    """Plan one shard on a machine of the work pool; on another one if that is lost."""
    pool.run_on_pool(name, {**given, "shard": shard})


@materialize(SOMEWHERE, name="publish-reports", task_run_name="publish to {folder}", **STORED)
def publish_reports(catalog: str, folder: str) -> list[str]:
    """Write the published tables, pages and pictures; what could not be drawn, in words."""
    store = open_catalog(catalog)
    return [*queries.study_kinds(store), *fleet.publish(store, folder, map_of=queries.kind_map).problems]


@task(name="carry-edits", task_run_name="carry edits over", **STORED)
def carry_edits(catalog: str) -> list[str]:
    """Take what people changed of plans over to newer drafts; what could not be, in words."""
    return edits.carry_edits(open_catalog(catalog))


@task(name="fly-drafts", task_run_name="fly drafts", **STORED)
def fly_drafts(catalog: str, keys: list[str]) -> list[str]:
    """Fly new plans in simulated wind; those that come too near, in words."""
    return flights.fly_drafts(open_catalog(catalog), keys)


@task(name="compact", task_run_name="compact {catalog}", **STORED)
def compact(catalog: str) -> dict[str, int]:
    """Merge small files; how many, by table."""
    return maintenance.compact(open_catalog(catalog))


@task(name="vacuum", task_run_name="vacuum {catalog}", **STORED)
def vacuum(catalog: str, keep_days: float) -> None:
    """Remove files that no version young enough needs."""
    maintenance.vacuum(open_catalog(catalog), keep_days)


@task(name="verify", task_run_name="verify {catalog}", **STORED)
def verify(catalog: str) -> list[str]:
    """What is wrong with the catalog, in words; empty where all is well."""
    return [str(finding) for finding in verification.verify(open_catalog(catalog))]


def _plain(item: fleet.Ingested) -> dict[str, str]:
    """What became of a file, as text for pages."""
    return {**vars(item), "findings": "; ".join(item.findings)}
