"""Where targets are planned: this machine, a work pool, Dask or Ray; what is kept is the same."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeVar

import httpx
from prefect import Task, flow, get_run_logger, runtime, task
from prefect.artifacts import create_progress_artifact, update_progress_artifact
from prefect.cache_policies import NO_CACHE
from prefect.states import Completed, State
from prefect.task_runners import TaskRunner, ThreadPoolTaskRunner

from upplied import fleet
from upplied.catalog import Catalog, open_catalog
from upplied.checks import some
from upplied.cli.terminal import progress
from upplied.extras import extra
from upplied.findings import campaign
from upplied.fleet import planner

from . import pool, states, tasks
from .environment import check_roots
from .parameters import ALL_CORES, Location, Resources

ELSEWHERE = 8  # processes of a cluster that shards are cut for, where nothing is said
EVERY_S = 5.0  # progress is told
KEY = "transfer-fleet-progress"

Shard = TypeVar("Shard")


@dataclass
class Planned:
    """What came of a run's jobs, and what an engine lost meanwhile."""

    result: fleet.Result = field(default_factory=fleet.Result)
    shards: int = 0
    lost: list[str] = field(default_factory=list)  # why, of each that was lost and planned by the run itself
    workers: list[str] = field(default_factory=list)  # that began a shard and did not end it
    repeated: list[str] = field(default_factory=list)  # those shards, each with who ended it

    def include(self, other: Planned) -> None:
        """Add what came of more jobs."""
        self.result.include(other.result)
        for name in ("shards", "lost", "workers", "repeated"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def attempted(self, shards: Mapping[str, fleet.Shard], attempts: Sequence[planner.Attempt]) -> None:
        """Take in who worked on which shard, by their names, and whose work did not end."""
        unended = [each for each in attempts if not each.ended]
        self.workers += sorted({each.worker for each in unended})
        by = {each.shard: each.worker for each in attempts if each.ended}
        for name in dict.fromkeys(each.shard for each in unended):
            self.repeated.append(f"{fleet.shard_name(shards[name])} (by {by.get(name, 'this run')})")

    @property
    def loss(self) -> str:
        """Which workers and shards were lost, why, and who did their work; empty where none was."""
        text = []
        if self.workers:
            text.append(f"Lost workers: {some(self.workers)}; done again: {some(self.repeated)}")
        if self.lost:
            lost = f"{len(self.lost)} of {self.shards} shards were lost by the engine and planned here"
            text.append(f"{lost}: {some(self.lost)}")
        return ". ".join(text)


def plan(catalog: str, jobs: Sequence[fleet.Job], resources: Resources, run_id: str = "") -> Planned:
    """Plan jobs where the resources say; a task to a shard."""
    run_id = run_id or str(runtime.flow_run.id)
    if resources.engine == "local" or not jobs:
        return Planned(here(catalog, jobs, resources, run_id))
    return _elsewhere(open_catalog(catalog), jobs, resources, run_id)


def here(
    catalog: str, jobs: Sequence[fleet.Job], resources: Resources, run_id: str, engine: str = "local"
) -> fleet.Result:
    """Tasks in threads feed the worker processes of this machine."""
    limits = fleet.Limits(resources.timeout_s, resources.memory_gib)
    own = fleet.Resources(resources.workers, limits)
    run = fleet.Run(open_catalog(catalog), jobs, run_id, own, engine=engine, plan=campaign.plan_job)

    @task(name="plan", task_run_name="{name}", cache_policy=NO_CACHE)
    def plan_here(name: str, shard: int) -> None:
        """Plan one shard of the run in its worker processes."""
        run.plan(shard)

    named = [{"name": fleet.shard_name(shard), "shard": at} for at, shard in enumerate(run.shards)]
    with ThreadPoolTaskRunner(max_workers=run.threads) as runner, run:
        for future in advancing([runner.submit(plan_here, shard) for shard in named]):
            future.result()
    return run.result


def _elsewhere(catalog: Catalog, jobs: Sequence[fleet.Job], resources: Resources, run_id: str) -> Planned:
    """Shards as tasks, written where all machines read them; what no engine kept is planned here."""
    runner: TaskRunner[Any]
    planning: Task[..., None]
    terms: dict[str, Any] = {"catalog": str(catalog.location), "run_id": run_id}
    if resources.engine == "pool":  # runs of a deployment on a work pool
        machines = pool.machines()
        size = resources.shard_targets or pool.shard_targets(len({job.target_id for job in jobs}), machines)
        shards, planning = fleet.shards(jobs, machines, size), pool.plan_on_pool
        terms["resources"] = resources.model_dump(include={"workers", "timeout_s", "memory_gib"})
        runner = ThreadPoolTaskRunner(max_workers=min(len(shards), pool.MOST))
    else:  # tasks on a cluster
        shards, planning = fleet.shards(jobs, resources.workers or ELSEWHERE), tasks.plan_elsewhere
        limits = resources.model_dump(include={"timeout_s", "memory_gib"})
        terms |= {"engine": resources.engine, "limits": limits}
        runner = _cluster(resources)
    planned = Planned(shards=len(shards))
    try:
        names = planner.write_shards(catalog, run_id, shards)
        named = dict(zip(names, shards, strict=True))
        with runner:
            submitted = [
                runner.submit(planning, {"name": fleet.shard_name(shard), "shard": name, "terms": terms})
                for name, shard in named.items()
            ]
            for shard, future in advancing(list(zip(shards, submitted, strict=True))):
                try:
                    future.result()
                except Exception as error:  # the engine's own: failed, or gone with its process
                    get_run_logger().warning("%s was lost: %s", fleet.shard_name(shard), error)
                    planned.lost.append(f"{type(error).__name__}: {error}".split("\n")[0][:200])
        planned.attempted(named, planner.attempts(catalog, run_id))
    finally:
        planner.remove_shards(catalog, run_id)
    planned.result, missing = fleet.known_outcomes(catalog, jobs, run_id)
    if missing:
        planned.result.include(here(str(catalog.location), missing, resources, run_id))
    return planned


def _cluster(resources: Resources) -> TaskRunner[Any]:
    """A task runner on the running cluster, or on a small one of its own where no address is given."""
    processes = resources.workers or fleet.cores()
    with extra(resources.engine):
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


def advancing(shards: Sequence[Shard]) -> Iterator[Shard]:
    """Shards that are being planned, one after the other; the bar moves as each has been waited for.

    Prefect is told every few seconds. Others plan meanwhile, whether its server answers or not.
    """
    artifact, due = None, -math.inf
    with progress("shards", len(shards)) as advance:
        for count in range(len(shards) + 1):
            if count == len(shards) or time.monotonic() >= due:
                percent, due = 100.0 * count / len(shards) if shards else 100.0, time.monotonic() + EVERY_S
                with suppress(httpx.HTTPError):  # the server is away: the next look tells as well
                    if artifact is None:
                        artifact = create_progress_artifact(percent, key=KEY)
                    else:
                        update_progress_artifact(artifact, percent)
            if count < len(shards):
                yield shards[count]
                advance()


@flow(name="plan-shard")
@states.errors_in_words
def plan_shard(catalog: Location, run_id: str, shard: str, resources: Resources = ALL_CORES) -> State:
    """Plan those pairs of a shard that the catalog has no plan for yet.

    The catalog says what is missing: a shard that is started twice is planned once.

    Args:
        catalog: Folder or object-store URI that all machines reach.
        run_id: Of the run over the fleet, kept with every plan.
        shard: Name of the shard, which lies beside the catalog's tables.
        resources: Processes, time and memory on this machine.
    """
    check_roots(catalog=catalog)
    jobs, worker = planner.read_shard(catalog, shard), tasks.worker_of("pool")
    _, missing = fleet.known_outcomes(open_catalog(catalog), jobs, run_id)
    with planner.attempt(catalog, shard, worker):
        result = here(catalog, missing, resources, run_id, worker)
    return Completed(message=str(result))
