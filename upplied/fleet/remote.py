"""Plan a shard where it lands: in a process of somebody else's engine, with the catalog as the only tie."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from upplied.catalog import open_catalog
from upplied.fleet import crew
from upplied.fleet.decisions import Job
from upplied.fleet.ledger import Ledger, Result


def plan_here(location: str, jobs: Sequence[Job], run_id: str) -> Result:
    """Plan jobs one after the other in this process, keep the outcomes, and count them.

    For the processes of Dask, Ray or a work pool: the engine decides where, the catalog keeps what
    comes of it, and only counts travel back. Jobs that were kept meanwhile, by whomever, are left out,
    so a shard that an engine starts twice is planned once.
    """
    catalog = open_catalog(location)
    ledger = Ledger(catalog, run_id)
    _prepared(location)
    done = catalog.settled((job.key for job in jobs), retry_failed=True, run_id=run_id)
    try:
        for job in jobs:
            if job.key not in done:
                ledger.add(crew.plan_in_process(job))
    finally:
        ledger.close()
    return ledger.result


@lru_cache(maxsize=1)
def _prepared(location: str) -> None:
    crew.prepare(location)
