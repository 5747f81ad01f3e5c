"""The tasks: each calls one function of `upplied.fleet` and hands on nothing but names and counts.

Data lives in the catalog and its cache. Prefect keeps no results of ours (`NO_CACHE`), and its task
table is not the record of what is done: the catalog is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.utilities.annotations import quote

from flows import pool
from upplied import fleet
from upplied.catalog import open_catalog
from upplied.catalog.verbs import maintenance, verification

SESSIONS: dict[str, fleet.Session] = {}  # of the runs in this process, by run id


@task(name="ingest-structures", task_run_name="ingest structures", cache_policy=NO_CACHE)
def ingest_structures(catalog: str, manifest: str, workers: int, prune: bool) -> list[dict[str, str]]:
    """Every structure of a manifest into the catalog; a bad file stops itself alone."""
    ingested = fleet.ingest_structures(open_catalog(catalog), manifest, workers, prune=prune)
    return [vars(item) for item in ingested]


@task(name="ingest-demonstrations", task_run_name="ingest demonstrations", cache_policy=NO_CACHE)
def ingest_demonstrations(catalog: str, logs: list[str], workers: int) -> list[dict[str, str]]:
    """Every log into the catalog; a bad log stops itself alone."""
    return [vars(item) for item in fleet.ingest_demonstrations(open_catalog(catalog), logs, workers)]


@task(name="plan", task_run_name="{name}", cache_policy=NO_CACHE)
def plan_shard(name: str, run_id: str, shard: int) -> None:
    """Plan one shard of a run in its worker processes."""
    SESSIONS[run_id].work(shard)


@task(name="plan-elsewhere", task_run_name="{name}", cache_policy=NO_CACHE)
def plan_elsewhere(name: str, catalog: str, jobs: quote[Sequence[fleet.Job]], run_id: str) -> fleet.Result:
    """Plan one shard in the process that an engine chose."""
    return fleet.plan_here(catalog, jobs.unquote(), run_id)


@task(name="plan-on-pool", task_run_name="{name}", cache_policy=NO_CACHE, retries=1)
def plan_on_pool(name: str, parameters: dict[str, Any]) -> None:
    """Plan one shard on a machine of the work pool; on another one if that is lost."""
    pool.run_on_pool(name, parameters)


@task(name="publish-reports", task_run_name="publish to {folder}", cache_policy=NO_CACHE)
def publish_reports(catalog: str, folder: str) -> None:
    """Write the published tables, pages and pictures."""
    fleet.publish(open_catalog(catalog), folder)


@task(name="compact", task_run_name="compact {catalog}", cache_policy=NO_CACHE)
def compact(catalog: str) -> dict[str, int]:
    """Merge small files; how many, by table."""
    return maintenance.compact(open_catalog(catalog))


@task(name="vacuum", task_run_name="vacuum {catalog}", cache_policy=NO_CACHE)
def vacuum(catalog: str, keep_days: float) -> None:
    """Remove files that no version young enough needs."""
    maintenance.vacuum(open_catalog(catalog), keep_days)


@task(name="verify", task_run_name="verify {catalog}", cache_policy=NO_CACHE)
def verify(catalog: str) -> list[str]:
    """What is wrong with the catalog, in words; empty where all is well."""
    return [str(finding) for finding in verification.verify(open_catalog(catalog))]
