"""One run over the fleet: jobs in shards, shards to workers, outcomes to the catalog."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import groupby, zip_longest

from upplied.catalog import Catalog
from upplied.fleet.crew import Crew, Outcome, cores
from upplied.fleet.decisions import Job
from upplied.fleet.ledger import Ledger, Result
from upplied.fleet.workers import Limits

SINGLE_TARGETS = 1000  # up to here an engine's task is one target: 3 ms each, and it records them all
SHARD_TARGETS = 64  # beyond, a task is this many targets

Shard = tuple[Job, ...]


def shards(jobs: Sequence[Job], workers: int) -> list[Shard]:
    """Group jobs into what one task of an engine does, in an order that does not depend on timing.

    Jobs on one target share its clouds and its registration through the cache, so they follow one
    another. Where targets are too few to keep the workers busy, every job is a shard of its own, and
    the first job of every target comes before the second of any.
    """
    targets = _by_target(jobs)
    if len(targets) < 4 * workers:
        return [(job,) for row in zip_longest(*targets) for job in row if job is not None]
    if len(targets) <= SINGLE_TARGETS:
        return targets
    return bundles(jobs, SHARD_TARGETS)


def bundles(jobs: Sequence[Job], size: int) -> list[Shard]:
    """Group jobs by so many targets; the jobs on one target stay together."""
    targets = _by_target(jobs)
    starts = range(0, len(targets), size)
    return [tuple(job for target in targets[at : at + size] for job in target) for at in starts]


def _by_target(jobs: Sequence[Job]) -> list[Shard]:
    ordered = sorted(jobs, key=lambda job: (*_pair(job), job.demonstration_id, job.settings.preset, job.key))
    return [tuple(group) for _, group in groupby(ordered, key=_pair)]


def _pair(job: Job) -> tuple[str, str]:
    return job.source_id, job.target_id


def shard_name(shard: Shard) -> str:
    """What a shard does, in words."""
    if len(shard) == 1:
        return str(shard[0])
    first, last = shard[0].target_id, shard[-1].target_id
    return f"{len(shard)} plans to {first}" + ("" if first == last else f" ... {last}")


@dataclass(frozen=True)
class Resources:
    """What a run may use: processes (0: one per core) and the limits of each job."""

    workers: int = 0
    limits: Limits = field(default_factory=Limits)

    def crew(self, catalog: Catalog, jobs: int) -> Crew:
        """The workers for so many jobs."""
        return Crew(str(catalog.location), max(1, min(self.workers or cores(), jobs)), self.limits)


class Session:
    """Plans the jobs of one run; shards may be worked from any thread.

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
    """

    def __init__(
        self,
        catalog: Catalog,
        jobs: Sequence[Job],
        run_id: str,
        resources: Resources | None = None,
        progress: Callable[[Outcome], None] = lambda outcome: None,
    ) -> None:
        self._crew = (resources or Resources()).crew(catalog, len(jobs))
        self._ledger = Ledger(catalog, run_id)
        self.progress = progress
        self.total = len(jobs)
        self.shards = shards(jobs, self._crew.count)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self._crew.close()
        self._ledger.close()

    @property
    def threads(self) -> int:
        """How many shards to work at a time: a little more than there are workers, so none waits."""
        return max(1, min(len(self.shards), self._crew.count + 2))

    @property
    def result(self) -> Result:
        """Counts so far."""
        return self._ledger.result

    def work(self, index: int) -> None:
        """Plan the jobs of one shard, one after the other."""
        for job in self.shards[index]:
            outcome = self._crew.plan(job)
            self._ledger.add(outcome)
            self.progress(outcome)


def transfer(
    catalog: Catalog,
    jobs: Sequence[Job],
    run_id: str,
    resources: Resources | None = None,
    progress: Callable[[Outcome], None] = lambda outcome: None,
) -> Result:
    """Plan every job and keep the outcomes, without any engine; parameters as those of `Session`.

    What is kept does not depend on the number of workers.
    """
    session = Session(catalog, jobs, run_id, resources, progress)
    with ThreadPoolExecutor(session.threads) as threads, session:
        for _ in threads.map(session.work, range(len(session.shards))):
            pass
    return session.result
