"""One run over the fleet: jobs in shards, shards to guarded workers, outcomes to the catalog.

From a task of an engine to a plan it is three calls: `Run.plan` of a shard, `Workers.run` of a job, and
`plan_job` in the worker process.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain, groupby, pairwise, zip_longest
from operator import attrgetter

from upplied.catalog import Catalog, open_catalog
from upplied.extras import required
from upplied.fleet.decisions import Job
from upplied.fleet.keeping import Keeper, Result, known_outcomes
from upplied.fleet.planner import Outcome, plan_job, prepare, this_process, without_path
from upplied.fleet.workers import JobKilled, Limits, Workers

SHARD_TARGETS = 64  # that a task of an engine plans at most
SHARDS_EACH = 8  # tasks to a worker where that makes smaller ones, so that all end at about the same time

Shard = tuple[Job, ...]
PlanJob = Callable[[Job], Outcome]
_PAIR = attrgetter("source_id", "target_id")


@dataclass(frozen=True)
class Resources:
    """What a run may use: processes (0: one per core) and the limits of each job."""

    workers: int = 0
    limits: Limits = field(default_factory=Limits)


class Run:
    """Plans jobs from one catalog; shards may be worked from any thread.

    Parameters
    ----------
    catalog : Catalog
        Holds the demonstrations and structures, and receives the plans.
    jobs : sequence of Job
        From `upplied.fleet.decide`.
    run_id : str
        Kept with every row.
    resources : Resources
    progress : callable
        Called with each outcome, in the order they come.
    engine : str
        Whose processes these are, with the name of its worker; kept with every row.
    plan : callable
        What plans a job in a worker process, by its name there.
    """

    def __init__(
        self,
        catalog: Catalog,
        jobs: Sequence[Job],
        run_id: str,
        resources: Resources | None = None,
        progress: Callable[[Outcome], None] = lambda outcome: None,
        engine: str = "local",
        plan: PlanJob = plan_job,
    ) -> None:
        required("open3d", "plan")
        resources = resources or Resources()
        self.count = max(1, min(resources.workers or cores(), len(jobs)))
        self.progress, self._plan_job = progress, plan
        self.shards = shards(jobs, self.count)
        self._workers = Workers(self.count, prepare, (str(catalog.location),), resources.limits)
        self._keeper = Keeper(catalog, run_id, engine)

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.close()
        self._keeper.close()

    @property
    def threads(self) -> int:
        """How many shards to work at a time: a little more than there are workers, so none waits."""
        return max(1, min(len(self.shards), self.count + 2))

    @property
    def result(self) -> Result:
        """Counts so far."""
        return self._keeper.result

    def plan(self, index: int) -> None:
        """Plan the jobs of one shard, one after the other, and wait for them."""
        for job in self.shards[index]:
            outcome = attempt(self._workers, job, self._plan_job)
            self._keeper.add(outcome)
            self.progress(outcome)


def transfer(
    catalog: Catalog,
    jobs: Sequence[Job],
    run_id: str,
    resources: Resources | None = None,
    progress: Callable[[Outcome], None] = lambda outcome: None,
    plan: PlanJob = plan_job,
) -> Result:
    """Plan every job and keep the outcomes, without any engine; parameters as those of `Run`.

    What is kept does not depend on the number of workers.
    """
    run = Run(catalog, jobs, run_id, resources, progress, plan=plan)
    with ThreadPoolExecutor(run.threads) as threads, run:
        for _ in threads.map(run.plan, range(len(run.shards))):
            pass
    return run.result


def plan_here(
    location: str,
    jobs: Sequence[Job],
    run_id: str,
    engine: str,
    limits: Limits | None = None,
    plan: PlanJob = plan_job,
) -> Result:
    """Plan jobs one after the other for a process of somebody else's engine, and count the outcomes.

    The engine decides where, the catalog keeps what comes of it. Jobs that were kept meanwhile, by
    whomever, are left out, so a shard that an engine starts twice is planned once. The planning is done
    in a guarded process beside this one, which stays for the next shard.
    """
    required("open3d", "plan")
    catalog = open_catalog(location)
    keeper = Keeper(catalog, run_id, engine)
    workers = _beside(location, limits or Limits())
    _, left = known_outcomes(catalog, jobs, run_id)
    try:
        for job in left:
            keeper.add(attempt(workers, job, plan))
    finally:
        keeper.close()
    return keeper.result


@lru_cache(maxsize=1)
def _beside(location: str, limits: Limits) -> Workers:
    return Workers(1, prepare, (location,), limits)


def attempt(workers: Workers, job: Job, plan: PlanJob = plan_job) -> Outcome:
    """Plan one job and wait for it; whatever happens to it, an outcome comes back.

    Raises
    ------
    WorkersClosed
        If the workers were closed meanwhile.
    """
    began = time.monotonic()
    try:
        return workers.run(plan, job)
    except JobKilled as death:
        lost = without_path(job, "failed", str(death))
        return Outcome(job, lost, time.monotonic() - began, process=this_process())


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shards(jobs: Sequence[Job], workers: int, targets: int = 0) -> list[Shard]:
    """Group jobs into what one task of an engine does, in an order that does not depend on timing.

    Jobs on one target share its clouds and its registration through the cache, so they follow one
    another. Where targets are too few to keep the workers busy, those on one target are parted, and
    the first job of every target comes before the second of any; never where a shard is to be of so many
    `targets`.
    """
    ordered = sorted(jobs, key=lambda job: (*_PAIR(job), job.demonstration_id, job.settings.preset, job.key))
    units: list[Shard] = [tuple(group) for _, group in groupby(ordered, key=_PAIR)]
    if not targets and len(units) < 4 * workers:
        units = [(job,) for row in zip_longest(*units) for job in row if job is not None]
    least = 0 if targets else SHARDS_EACH * workers
    count = min(len(units), max(least, -(-len(units) // (targets or SHARD_TARGETS))))
    ends = [len(units) * number // (count or 1) for number in range(count + 1)]
    return [tuple(chain.from_iterable(units[begin:end])) for begin, end in pairwise(ends)]


def shard_name(shard: Shard) -> str:
    """What a shard does, in words."""
    if len(shard) == 1:
        return str(shard[0])
    first, last = shard[0].target_id, shard[-1].target_id
    return f"{len(shard)} plans to {first}" + ("" if first == last else f" ... {last}")
