"""Shards as runs of the deployment `plan-shard`: Prefect's work pool hands them to machines.

The machines share the catalog and nothing else. What comes of a shard is read from the catalog, not
from Prefect.
"""

from __future__ import annotations

import time
from typing import Any

from prefect import get_client
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import FlowRun, WorkPoolStatus
from prefect.deployments import run_deployment
from prefect.exceptions import FailedRun, ObjectNotFound
from prefect.states import Cancelled

from upplied.errors import SettingsError

POOL = "planners"
DEPLOYMENT = "plan-shard/plan-shard"
EVERY_S = 5.0
MOST = 64  # shards that are offered at a time; a machine takes one


def check_pool() -> None:
    """Refuse to hand out work that nobody would take.

    Raises
    ------
    SettingsError
        If no worker is online.
    """
    with get_client(sync_client=True) as client:
        if not _attended(client):
            raise SettingsError(
                "engine pool",
                f"finds no worker online on the work pool {POOL!r}",
                remedy=f"on each machine: prefect worker start --pool {POOL} --limit 1",
            )


def run_on_pool(name: str, parameters: dict[str, Any]) -> None:
    """Plan a shard on some machine of the pool and wait for it.

    Raises
    ------
    FailedRun
        If it did not complete, or nobody is left to take it.
    """
    run = run_deployment(DEPLOYMENT, parameters=parameters, flow_run_name=name[:200], timeout=0)
    with get_client(sync_client=True) as client:
        while not _final(run):
            time.sleep(EVERY_S)
            run = client.read_flow_run(run.id)
            if run.state is not None and run.state.is_scheduled() and not _attended(client):
                client.set_flow_run_state(run.id, Cancelled(message="No worker is left on the pool."))
                run = client.read_flow_run(run.id)
    if run.state is None or not run.state.is_completed():
        raise FailedRun(f"{name}: {run.state.name}: {run.state.message}" if run.state else name)


def _final(run: FlowRun) -> bool:
    return run.state is not None and run.state.is_final()


def _attended(client: SyncPrefectClient) -> bool:
    try:
        return client.read_work_pool(POOL).status == WorkPoolStatus.READY
    except ObjectNotFound:
        return False
