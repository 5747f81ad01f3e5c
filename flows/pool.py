"""Shards as runs of the deployment `plan-shard` on machines that share the catalog, and nothing else."""

from __future__ import annotations

import math
import time
from typing import Any

from prefect import get_client
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import WorkerStatus
from prefect.deployments import run_deployment
from prefect.exceptions import FailedRun, ObjectNotFound
from prefect.states import Cancelled

from upplied.errors import SettingsError
from upplied.fleet.run import SHARD_TARGETS

POOL = "planners"
DEPLOYMENT = "plan-shard/plan-shard"
EVERY_S = 2.0
MOST = 64  # shards that are offered at a time; a machine takes one
SHARDS_EACH = 8  # to a machine


def machines() -> int:
    """How many machines take shards; none is an error: nobody would take what is handed out."""
    with get_client(sync_client=True) as client:
        count = _online(client)
    if not count:
        remedy = f"on each machine: prefect worker start --pool {POOL} --limit 1"
        raise SettingsError("engine pool", f"finds no worker online on the work pool {POOL!r}", "", remedy)
    return count


def shard_targets(targets: int, count: int) -> int:
    """Targets of a shard: some shards a machine, so that all end together, of 64 targets at least."""
    each = max(1, min(SHARDS_EACH, targets // (count * SHARD_TARGETS)))
    return math.ceil(targets / (count * each))


def run_on_pool(name: str, parameters: dict[str, Any]) -> None:
    """Plan a shard on some machine of the pool and wait for it; `FailedRun` where it is not completed."""
    run = run_deployment(DEPLOYMENT, parameters=parameters, flow_run_name=name[:200], timeout=0)
    with get_client(sync_client=True) as client:
        while run.state is None or not run.state.is_final():
            time.sleep(EVERY_S)
            run = client.read_flow_run(run.id)
            if run.state is not None and run.state.is_scheduled() and not _online(client):
                client.set_flow_run_state(run.id, Cancelled(message="No worker is left on the pool."))
                run = client.read_flow_run(run.id)
    if run.state is None or not run.state.is_completed():
        raise FailedRun(f"{name}: {run.state.name}: {run.state.message}" if run.state else name)


def _online(client: SyncPrefectClient) -> int:
    try:
        client.read_work_pool(POOL)
    except ObjectNotFound:
        return 0
    return sum(worker.status == WorkerStatus.ONLINE for worker in client.read_workers_for_work_pool(POOL))
