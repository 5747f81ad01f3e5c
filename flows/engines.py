"""Where targets are planned: on this machine, on the machines of a work pool, or on a Dask or Ray cluster.

All of it is somebody else's engine. What is kept is the same, byte for byte, whichever plans it.
"""

from __future__ import annotations

from typing import Any

from prefect import get_run_logger, runtime
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner
from prefect.utilities.annotations import quote

from flows import pool, tasks
from flows.parameters import Resources
from flows.progress import advancing, progress
from upplied import fleet
from upplied.catalog import open_catalog
from upplied.errors import SettingsError

ELSEWHERE = 8  # processes of a cluster that shards are cut for, where nothing is said


def plan(catalog: str, jobs: list[fleet.Job], wish: fleet.Wish, resources: Resources) -> fleet.Result:
    """Plan jobs where the resources say; a task to a shard."""
    run_id = str(runtime.flow_run.id)
    if resources.engine == "local" or not jobs:
        return here(catalog, jobs, resources, run_id)
    if resources.engine == "pool":
        return _on_pool(catalog, jobs, wish, resources, run_id)
    return _elsewhere(catalog, jobs, resources, run_id)


def here(catalog: str, jobs: list[fleet.Job], resources: Resources, run_id: str) -> fleet.Result:
    """Tasks in threads feed one crew of worker processes."""
    session = fleet.Session(open_catalog(catalog), jobs, run_id, resources.of_fleet())
    tasks.SESSIONS[run_id] = session
    try:
        with ThreadPoolTaskRunner(max_workers=session.threads) as runner, session, progress(session):
            submitted = [
                runner.submit(
                    tasks.plan_shard, {"name": fleet.shard_name(shard), "run_id": run_id, "shard": number}
                )
                for number, shard in enumerate(session.shards)
            ]
            for future in submitted:
                future.result()
    finally:
        del tasks.SESSIONS[run_id]
    return session.result


def _on_pool(
    catalog: str, jobs: list[fleet.Job], wish: fleet.Wish, resources: Resources, run_id: str
) -> fleet.Result:
    """Runs of a deployment on a work pool; what no machine planned is planned here."""
    size = resources.shard_targets or pool.shard_targets(
        len({job.target_id for job in jobs}), pool.machines()
    )
    given = {
        "catalog": str(open_catalog(catalog).location),
        "run_id": run_id,
        "presets": wish.presets,
        "changes": wish.changes,
        "demonstrations": wish.demonstrations,
        "targets": wish.targets,
        "retry_failed": wish.retry_failed,
        "resources": resources.model_dump(include={"workers", "timeout_s", "memory_gib"}),
    }
    shards = fleet.bundles(jobs, size)
    with ThreadPoolTaskRunner(max_workers=min(len(shards), pool.MOST)) as runner:
        submitted = [
            runner.submit(
                tasks.plan_on_pool,
                {
                    "name": fleet.shard_name(shard),
                    "parameters": {**given, "keys": [job.key for job in shard]},
                },
            )
            for shard in shards
        ]
        for shard, future in advancing(list(zip(shards, submitted, strict=True))):
            try:
                future.result()
            except Exception as error:  # failed, crashed with its machine, or cancelled
                get_run_logger().warning("%s was lost: %s", fleet.shard_name(shard), error)
    result, missing = fleet.kept(open_catalog(catalog), jobs, run_id)
    if missing:
        result.include(here(catalog, missing, resources, run_id))
    return result


def _elsewhere(catalog: str, jobs: list[fleet.Job], resources: Resources, run_id: str) -> fleet.Result:
    """Tasks on a cluster; a shard that is lost with its process is planned again here, under guard."""
    location = str(open_catalog(catalog).location)
    result, lost = fleet.Result(), []
    shards = fleet.shards(jobs, resources.workers or ELSEWHERE)
    with _cluster(resources) as runner:
        submitted = [
            runner.submit(
                tasks.plan_elsewhere,
                {
                    "name": fleet.shard_name(shard),
                    "catalog": location,
                    "jobs": quote(shard),
                    "run_id": run_id,
                },
            )
            for shard in shards
        ]
        for shard, future in advancing(list(zip(shards, submitted, strict=True))):
            try:
                result.include(future.result())
            except Exception as error:  # the engine's own, whatever it is: the process went down
                get_run_logger().warning("%s was lost: %s", fleet.shard_name(shard), error)
                lost += shard
    if lost:
        _, left = fleet.kept(open_catalog(catalog), lost, run_id)
        result.include(here(catalog, left, resources, run_id))
    return result


def _cluster(resources: Resources) -> TaskRunner[Any]:
    """A task runner on the running cluster, or on a small one of its own where no address is given."""
    processes = resources.workers or fleet.cores()
    try:
        if resources.engine == "dask":
            from prefect_dask import DaskTaskRunner

            if resources.address:
                return DaskTaskRunner(address=resources.address)
            own = {"n_workers": processes, "threads_per_worker": 1, "dashboard_address": None}
            return DaskTaskRunner(cluster_kwargs=own)
        from prefect_ray import RayTaskRunner

        if resources.address:
            return RayTaskRunner(address=resources.address)
        own = {"num_cpus": processes, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
        return RayTaskRunner(init_kwargs=own)
    except ImportError as error:
        raise SettingsError(
            f"engine {resources.engine}",
            f"is not installed ({error.name})",
            remedy=f"pip install upplied[{resources.engine}]",
        ) from None
