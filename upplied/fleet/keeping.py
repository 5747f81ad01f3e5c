"""Keeps what came of the jobs of a run: counted at once, committed a batch at a time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from upplied.catalog import Catalog
from upplied.fleet.decisions import Job
from upplied.fleet.planner import Outcome
from upplied.planning.correspondence.memo import METHOD_VERSION
from upplied.provenance import recorded

log = logging.getLogger(__name__)


BATCH = 100  # outcomes that are committed together at the latest
_STATUSES = ("ok", "refused", "failed", "superseded")
EVERY_S = 10.0  # a killed run loses no more than this much work


class Keeper:
    """Collects outcomes from any thread and commits them together.

    With every row stand the run, and the engine with the name of its worker (``dask:10.0.0.7:40123``).
    """

    def __init__(self, catalog: Catalog, run_id: str, engine: str = "local") -> None:
        self._catalog, self._run_id, self._engine = catalog, run_id, engine
        self._waiting: list[Outcome] = []
        self._last = time.monotonic()
        self._lock = threading.Lock()  # of what waits, held for a moment
        self._committing = threading.Lock()  # so that outcomes still come in while others are committed
        self.result = Result()

    def add(self, outcome: Outcome) -> None:
        """Take one outcome in."""
        if outcome.detail:
            log.error("%s: %s\n%s", outcome.job, outcome.plan.reason, outcome.detail)
        with self._lock:
            self.result.count(outcome.job, outcome.plan.status, outcome.plan.reason)
            if outcome.plan.status != "superseded":
                self._waiting.append(outcome)
            due = len(self._waiting) >= BATCH or time.monotonic() - self._last > EVERY_S
            batch = self._taken() if due else []
        if batch:
            self._commit(batch)

    def close(self) -> None:
        """Commit what still waits, after what is being committed."""
        with self._lock:
            batch = self._taken()
        self._commit(batch)

    def _taken(self) -> list[Outcome]:
        batch, self._waiting, self._last = self._waiting, [], time.monotonic()
        return batch

    def _commit(self, batch: list[Outcome]) -> None:
        ordered = sorted(batch, key=lambda outcome: outcome.job.key)
        with self._committing:
            try:
                if ordered:
                    self._catalog.add_plans([(o.job.key, o.plan, self._provenance(o)) for o in ordered])
            except Exception:  # they wait again: the disk may have room at the end
                with self._lock:
                    self._waiting = batch + self._waiting
                raise

    def _provenance(self, outcome: Outcome) -> dict[str, Any]:
        hashes = ("demonstration_sha256", "source_sha256", "target_sha256")
        return {
            "run_id": self._run_id,
            "planned_on": f"{outcome.process}/{self._engine}",
            "method_version": METHOD_VERSION,
            **recorded(),
            "planning_s": outcome.seconds,
            "settings": outcome.job.settings,
            "siblings": outcome.job.siblings,
            "purpose": outcome.job.purpose,
            **dict(zip(hashes, outcome.job.sha256, strict=True)),
        }


@dataclass
class Result:
    """Counts of a run, and what did not succeed."""

    ok: int = 0
    refused: int = 0
    failed: int = 0
    superseded: int = 0  # their inputs changed while the run was under way: the next run plans them
    troubles: list[tuple[str, str, str]] = field(default_factory=list)  # job, status, reason

    def count(self, job: Job, status: str, reason: str) -> None:
        """Count what came of one job."""
        setattr(self, status, getattr(self, status) + 1)
        if status != "ok":
            self.troubles.append((str(job), status, reason))

    def include(self, other: Result) -> None:
        """Add the counts of another shard."""
        for status in _STATUSES:
            setattr(self, status, getattr(self, status) + getattr(other, status))
        self.troubles += other.troubles

    @property
    def total(self) -> int:
        """All outcomes."""
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
