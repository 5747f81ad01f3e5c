"""Where targets are planned: in worker processes of this machine, or on a Dask or Ray cluster.

All of it is somebody else's engine. What is kept is the same, byte for byte, whichever plans it.
"""

from __future__ import annotations

from typing import Any

from prefect import get_run_logger, runtime
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner
from prefect.utilities.annotations import quote

from flows import tasks
from flows.parameters import Resources
from flows.progress import progress
from upplied import fleet
from upplied.catalog import open_catalog
from upplied.errors import SettingsError

ELSEWHERE = 8  # processes of a cluster that shards are cut for, where nothing is said


def plan(catalog: str, jobs: list[fleet.Job], resources: Resources) -> fleet.Result:
    """Plan jobs where the resources say; a task to a shard."""
    if resources.engine == "local":
        return _here(catalog, jobs, resources)
    return _elsewhere(catalog, jobs, resources)


def _here(catalog: str, jobs: list[fleet.Job], resources: Resources) -> fleet.Result:
    """Tasks in threads feed one crew of worker processes."""
    run_id = str(runtime.flow_run.id)
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


def _elsewhere(catalog: str, jobs: list[fleet.Job], resources: Resources) -> fleet.Result:
    """Tasks on a cluster; a shard that is lost with its process is planned again here, under guard."""
    run_id = str(runtime.flow_run.id)
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
        for shard, future in zip(shards, submitted, strict=True):
            try:
                result.include(future.result())
            except Exception as error:  # the engine's own, whatever it is: the process went down
                get_run_logger().warning("%s was lost: %s", fleet.shard_name(shard), error)
                lost += shard
    if lost:
        done = open_catalog(catalog).known_transfers(job.key for job in lost)
        result.include(_here(catalog, [job for job in lost if job.key not in done], resources))
    return result


def _cluster(resources: Resources) -> TaskRunner[Any]:
    """A task runner on the running cluster, or on a small one of its own where no address is given."""
    try:
        if resources.engine == "dask":
            from prefect_dask import DaskTaskRunner

            own = {"n_workers": resources.workers or fleet.cores(), "threads_per_worker": 1}
            if resources.address:
                return DaskTaskRunner(address=resources.address)
            return DaskTaskRunner(cluster_kwargs={**own, "dashboard_address": None})
        from prefect_ray import RayTaskRunner

        return RayTaskRunner(address=resources.address or None)
    except ImportError as error:
        raise SettingsError(
            f"engine {resources.engine}",
            f"is not installed ({error.name})",
            remedy=f"pip install upplied[{resources.engine}]",
        ) from None
