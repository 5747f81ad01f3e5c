"""Functions of the library as tasks of Prefect's, and what is made of what as its assets.

Prefect keeps no results of ours (`NO_CACHE`): the catalog is the record of what is done.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from urllib.parse import quote

from prefect import Task, task
from prefect.assets import Asset, AssetProperties, add_asset_metadata
from prefect.cache_policies import NO_CACHE
from prefect.events import emit_event
from prefect.states import State
from prefect.tasks import MaterializingTask, exponential_backoff

from upplied import fleet
from upplied.catalog import Catalog, open_catalog
from upplied.errors import CatalogError
from upplied.findings import campaign, queries
from upplied.fleet import planner

P = ParamSpec("P")
R = TypeVar("R")

RECALLED = "upplied.plan.recalled"  # the event of a plan in force that is not safe any more
MEANING = {
    "structures": "The structures of a fleet, with their meshes.",
    "demonstrations": "The flights of experts.",
    "flights": "Flights of the plans, and what they showed.",
    "transfers": "The plans: every demonstration to every structure of its kind.",
    "reports": "Plain Parquet, pages and pictures for people.",
}


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


def stored(
    name: str, act: Callable[P, R], makes: Asset | None = None, of: Sequence[Asset | str] = ()
) -> Callable[P, R]:
    """A function that reads and writes stores, as a task; with `makes`, one that tells what it makes `of`."""
    options = {**STORED, "name": name, "task_run_name": name.replace("-", " ")}
    if makes is None:
        return Task(act, **options)
    return MaterializingTask(act, assets=[makes], asset_deps=list(of), **options)


def asset(location: str, name: str) -> Asset:
    """A table of the catalog at a location, or the publication there, by its name in `MEANING`."""
    place = source(location)
    key = place if name == "reports" else f"{place.rstrip('/')}/{name}"
    return Asset(key=key, properties=AssetProperties(name=name, description=MEANING[name]))


def source(location: str) -> str:
    """The key of a file or folder that is read."""
    return location if "://" in location else f"file://{quote(str(Path(location).absolute()))}"


def record_plans(plans: Asset, run_id: str, result: fleet.Result) -> None:
    """Tell Prefect what of the catalog's plans a run made."""
    counts = {"ok": result.ok, "refused": result.refused, "failed": result.failed}
    add_asset_metadata(plans, {"run_id": run_id, **counts})


def recheck_plans(catalog: Catalog, timeout_s: float) -> list[str]:
    """Judge plans in force whose structure changed; what a person should look at, in words."""
    rechecked = fleet.recheck(catalog, fleet.Limits(timeout_s))
    for each in filter(attrgetter("recalled"), rechecked):
        names = {"id": f"upplied.plan.{each.transfer_id}", "name": each.target_id}
        resource = {f"prefect.resource.{key}": name for key, name in names.items()}
        emit_event(RECALLED, resource, payload={"transfer_id": each.transfer_id, "why": each.note})
    return [str(each) for each in rechecked if each.troubled]


def publish(catalog: str, folder: str, of: str = "transfers") -> list[str]:
    """Write the published tables, pages and pictures as a task; what could not be drawn, in words."""

    def publish_reports(store: Catalog) -> list[str]:
        return [*queries.study_kinds(store), *fleet.publish(store, folder, map_of=queries.kind_map).problems]

    return stored("publish-reports", publish_reports, asset(folder, "reports"), [asset(catalog, of)])(
        open_catalog(catalog)
    )


@task(name="plan-elsewhere", task_run_name="{name}", cache_policy=NO_CACHE)
def plan_elsewhere(name: str, shard: str, terms: dict[str, Any]) -> None:
    """Plan one shard in the process that an engine chose."""
    catalog, limits, worker = terms["catalog"], fleet.Limits(**terms["limits"]), worker_of(terms["engine"])
    # Before anything is noted: a run that has ended took its shards away.
    jobs = planner.read_shard(catalog, shard)
    with planner.attempt(catalog, shard, worker):
        fleet.plan_here(catalog, jobs, terms["run_id"], worker, limits, campaign.plan_job)


def worker_of(engine: str) -> str:
    """The engine and its worker that this process belongs to, by the name that the engine knows it by."""
    if engine == "dask":
        from distributed import get_worker

        return f"dask:{get_worker().address.split('://')[-1]}"
    if engine == "ray":
        from ray import get_runtime_context

        return f"ray:{get_runtime_context().get_worker_id()}"
    return f"{engine}:{os.environ.get('PREFECT__WORKER_NAME') or socket.gethostname()}"
