"""Where targets are planned: on this machine, on the machines of a work pool, or on a Dask or Ray cluster.

All of it is somebody else's engine. What is kept is the same, byte for byte, whichever plans it.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from prefect import get_run_logger, runtime
from prefect.futures import PrefectFuture
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from upplied import fleet
from upplied.catalog import Catalog, open_catalog
from upplied.errors import SettingsError
from upplied.fleet import manifest

from . import pool, tasks
from .parameters import Resources
from .progress import advancing, progress

if TYPE_CHECKING:
    from collections.abc import Iterator

ELSEWHERE = 8  # processes of a cluster that shards are cut for, where nothing is said


@dataclass
class Planned:
    """What came of a run's jobs, and of how many shards an engine lost."""

    result: fleet.Result = field(default_factory=fleet.Result)
    shards: int = 0
    lost: list[str] = field(default_factory=list)  # why, of each that was lost and planned by the run itself

    def include(self, other: Planned) -> None:
        """Add what came of more jobs."""
        self.result.include(other.result)
        self.shards += other.shards
        self.lost += other.lost

    @property
    def told(self) -> str:
        """How many shards were lost, and why, in words; empty where none was."""
        if not self.lost:
            return ""
        reasons = "; ".join(dict.fromkeys(self.lost))
        return f"{len(self.lost)} of {self.shards} shards were lost by the engine and planned here: {reasons}"


def plan(catalog: str, jobs: Sequence[fleet.Job], resources: Resources, run_id: str = "") -> Planned:
    """Plan jobs where the resources say; a task to a shard."""
    run_id = run_id or str(runtime.flow_run.id)
    if resources.engine == "local" or not jobs:
        return Planned(here(catalog, jobs, resources, run_id))
    if resources.engine == "pool":
        return _on_pool(open_catalog(catalog), jobs, resources, run_id)
    return _elsewhere(open_catalog(catalog), jobs, resources, run_id)


def here(
    catalog: str, jobs: Sequence[fleet.Job], resources: Resources, run_id: str, engine: str = "local"
) -> fleet.Result:
    """Tasks in threads feed the worker processes of this machine."""
    run = fleet.Run(open_catalog(catalog), jobs, run_id, resources.of_fleet(), engine=engine)
    tasks.RUNS[run_id] = run
    try:
        with ThreadPoolTaskRunner(max_workers=run.threads) as runner, run, progress(run):
            submitted = [
                runner.submit(
                    tasks.plan_shard, {"name": fleet.shard_name(shard), "run_id": run_id, "shard": number}
                )
                for number, shard in enumerate(run.shards)
            ]
            for future in submitted:
                future.result()
    finally:
        del tasks.RUNS[run_id]
    return run.result


def _on_pool(catalog: Catalog, jobs: Sequence[fleet.Job], resources: Resources, run_id: str) -> Planned:
    """Runs of a deployment on a work pool; what no machine planned is planned here."""
    size = resources.shard_targets or pool.shard_targets(
        len({job.target_id for job in jobs}), pool.machines()
    )
    shards = fleet.bundles(jobs, size)
    asked = resources.model_dump(include={"workers", "timeout_s", "memory_gib"})
    given: dict[str, Any] = {"catalog": str(catalog.location), "run_id": run_id, "resources": asked}
    with (
        _written(catalog, run_id, shards) as names,
        ThreadPoolTaskRunner(max_workers=min(len(shards), pool.MOST)) as runner,
    ):
        submitted = [
            runner.submit(
                tasks.plan_on_pool,
                {"name": fleet.shard_name(shard), "parameters": {**given, "shard": name}},
            )
            for shard, name in zip(shards, names, strict=True)
        ]
        lost = _waited_for(shards, submitted)
    return _completed(catalog, jobs, resources, run_id, Planned(shards=len(shards), lost=lost))


def _elsewhere(catalog: Catalog, jobs: Sequence[fleet.Job], resources: Resources, run_id: str) -> Planned:
    """Tasks on a cluster; what is lost with its process is planned here."""
    shards = fleet.shards(jobs, resources.workers or ELSEWHERE)
    limits: dict[str, Any] = {"timeout_s": resources.timeout_s, "memory_gib": resources.memory_gib}
    given: dict[str, Any] = {
        "catalog": str(catalog.location),
        "run_id": run_id,
        "engine": resources.engine,
        "limits": limits,
    }
    with _written(catalog, run_id, shards) as names, _cluster(resources) as runner:
        submitted = [
            runner.submit(
                tasks.plan_elsewhere, {"name": fleet.shard_name(shard), "shard": name, "given": given}
            )
            for shard, name in zip(shards, names, strict=True)
        ]
        lost = _waited_for(shards, submitted)
    return _completed(catalog, jobs, resources, run_id, Planned(shards=len(shards), lost=lost))


@contextmanager
def _written(catalog: Catalog, run_id: str, shards: Sequence[fleet.Shard]) -> Iterator[list[str]]:
    """The shards where all machines can read them, as long as the block lasts."""
    try:
        yield manifest.write_shards(catalog, run_id, shards)
    finally:
        manifest.remove_shards(catalog, run_id)


def _waited_for(shards: Sequence[fleet.Shard], submitted: Sequence[PrefectFuture[Any]]) -> list[str]:
    """Wait for every shard; why each of those that were lost was."""
    lost = []
    for shard, future in advancing(list(zip(shards, submitted, strict=True))):
        try:
            future.result()
        except Exception as error:  # the engine's own, whatever it is: failed, or gone with its process
            get_run_logger().warning("%s was lost: %s", fleet.shard_name(shard), error)
            lost.append(f"{type(error).__name__}: {error}".split("\n")[0][:200])
    return lost


def _completed(
    catalog: Catalog, jobs: Sequence[fleet.Job], resources: Resources, run_id: str, planned: Planned
) -> Planned:
    """Count what was kept, by whomever, and plan here what was not."""
    planned.result, missing = fleet.kept(catalog, jobs, run_id)
    if missing:
        planned.result.include(here(str(catalog.location), missing, resources, run_id))
    return planned


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
        alone = {"num_cpus": processes, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
        return RayTaskRunner(init_kwargs=alone)
    except ImportError as error:
        raise SettingsError(
            f"engine {resources.engine}",
            f"is not installed ({error.name})",
            remedy=f"pip install upplied[{resources.engine}]",
        ) from None
