"""One run over the fleet: jobs in shards, shards to guarded workers, outcomes to the catalog.

Three calls: `Run.plan` of a shard, `Workers.run` of a job, and `plan_job` in the worker process.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain, groupby, pairwise, zip_longest
from operator import attrgetter
from typing import Any

from upplied.catalog import Catalog, open_catalog
from upplied.extras import required
from upplied.fleet.decisions import Job
from upplied.fleet.planner import Outcome, Shard, plan_job, prepare, this_process, without_path
from upplied.fleet.workers import JobKilled, Limits, Workers
from upplied.planning.correspondence.memo import METHOD_VERSION
from upplied.provenance import recorded

log = logging.getLogger(__name__)

SHARD_TARGETS = 64  # that a task of an engine plans at most
SHARDS_EACH = 8  # tasks to a worker where that makes smaller ones, so that all end at about the same time

PlanJob = Callable[[Job], Outcome]
_PAIR = attrgetter("source_id", "target_id")


@dataclass(frozen=True)
class Resources:
    """What a run may use: processes (0: one per core) and the limits of each job."""

    workers: int = 0
    limits: Limits = field(default_factory=Limits)


class Run(AbstractContextManager["Run"]):
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
        # Shards to work at a time: a little more than there are workers, so none waits.
        self.threads = max(1, min(len(self.shards), self.count + 2))
        self._workers = Workers(self.count, prepare, (str(catalog.location),), resources.limits)
        self._keeper = Keeper(catalog, run_id, engine)
        self.result = self._keeper.result  # counts so far

    def __exit__(self, *_: object) -> None:
        self._workers.close()
        self._keeper.close()

    def plan(self, index: int) -> None:
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
) -> "Result":
    """Plan every job in a `Run` without any engine; what is kept does not depend on how many workers."""
    run = Run(catalog, jobs, run_id, resources, progress, plan=plan)
    with ThreadPoolExecutor(run.threads) as threads, run:
        list(threads.map(run.plan, range(len(run.shards))))
    return run.result


def plan_here(
    location: str,
    jobs: Sequence[Job],
    run_id: str,
    engine: str,
    limits: Limits | None = None,
    plan: PlanJob = plan_job,
) -> "Result":
    """Plan jobs one after the other for a process of somebody else's engine, and count the outcomes.

    Jobs that were kept meanwhile, by whomever, are left out: a shard that is started twice is planned once.
    The planning is done in a guarded process beside this one, which stays for the next shard.
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
    """Plan one job and wait for it; whatever happens, an outcome comes back, unless workers are closed."""
    began = time.monotonic()
    try:
        return workers.run(plan, job)
    except JobKilled as death:
        lost = without_path(job, "failed", str(death))
        return Outcome(job, lost, time.monotonic() - began, process=this_process())


def cores() -> int:
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
    first, last = shard[0].target_id, shard[-1].target_id
    several = f"{len(shard)} plans to {first}" + ("" if first == last else f" ... {last}")
    return several if len(shard) > 1 else str(shard[0])


BATCH = 100  # outcomes that are committed together at the latest
_STATUSES = ("ok", "refused", "failed", "superseded")
EVERY_S = 10.0  # a killed run loses no more than this much work


class Keeper:
    """Collects outcomes from any thread and commits them together, with the run and the engine's worker."""

    def __init__(self, catalog: Catalog, run_id: str, engine: str = "local") -> None:
        self._catalog, self._run_id, self._engine = catalog, run_id, engine
        self._waiting: list[Outcome] = []
        self._last = time.monotonic()
        self._lock = threading.Lock()  # of what waits, held for a moment
        self._committing = threading.Lock()  # so that outcomes still come in while others are committed
        self.result = Result()

    def add(self, outcome: Outcome) -> None:
        if outcome.detail:
            log.error("%s: %s\n%s", outcome.job, outcome.plan.reason, outcome.detail)
        with self._lock:
            self.result.count(outcome.job, outcome.plan.status, outcome.plan.reason)
            if outcome.plan.status != "superseded":
                self._waiting.append(outcome)
            due = len(self._waiting) >= BATCH or time.monotonic() - self._last > EVERY_S
        if due:
            self.close()

    def close(self) -> None:
        """Commit what still waits, after what is being committed."""
        with self._lock:
            batch, self._waiting, self._last = self._waiting, [], time.monotonic()
        plans = [(o.job.key, o.plan, self._provenance(o)) for o in sorted(batch, key=lambda o: o.job.key)]
        with self._committing:
            try:
                if plans:
                    self._catalog.add_plans(plans)
            except Exception:  # they wait again: the disk may have room at the end
                with self._lock:
                    self._waiting = batch + self._waiting
                raise

    def _provenance(self, outcome: Outcome) -> dict[str, Any]:
        job, hashes = outcome.job, ("demonstration_sha256", "source_sha256", "target_sha256")
        return {
            "run_id": self._run_id,
            "planned_on": f"{outcome.process}/{self._engine}",
            "method_version": METHOD_VERSION,
            **recorded(),
            "planning_s": outcome.seconds,
            **{name: getattr(job, name) for name in ("settings", "siblings", "purpose")},
            **dict(zip(hashes, job.sha256, strict=True)),
        }


@dataclass
class Result:
    ok: int = 0
    refused: int = 0
    failed: int = 0
    superseded: int = 0  # their inputs changed while the run was under way: the next run plans them
    troubles: list[tuple[str, str, str]] = field(default_factory=list)  # job, status, reason

    def count(self, job: Job, status: str, reason: str) -> None:
        setattr(self, status, getattr(self, status) + 1)
        if status != "ok":
            self.troubles.append((str(job), status, reason))

    def include(self, other: "Result") -> None:
        for status in _STATUSES:
            setattr(self, status, getattr(self, status) + getattr(other, status))
        self.troubles += other.troubles

    @property
    def total(self) -> int:
        return sum(getattr(self, status) for status in _STATUSES)

    def __str__(self) -> str:
        counted = f"{self.ok} ok, {self.refused} refused, {self.failed} failed"
        return counted + (f", {self.superseded} superseded" if self.superseded else "")


def known_outcomes(catalog: Catalog, jobs: Sequence[Job], run_id: str = "") -> tuple[Result, list[Job]]:
    """Counts of what the catalog holds of these jobs, whoever planned them, and the jobs it does not hold.

    Of failures those of the run `run_id` alone count, where it is said: earlier ones were to be tried again.
    """
    outcomes = catalog.settled((job.key for job in jobs), retry_failed=bool(run_id), run_id=run_id)
    result, missing = Result(), []
    for job in jobs:
        if job.key in outcomes:
            result.count(job, *outcomes[job.key])
        else:
            missing.append(job)
    return result, missing
