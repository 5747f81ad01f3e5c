"""Runs of deployments: one that a person asks for, and shards on machines that share the catalog alone."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from prefect import get_client, task
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import FlowRun, WorkerStatus
from prefect.deployments import run_deployment
from prefect.exceptions import FailedRun, ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Cancelled
from prefect.utilities.urls import url_for

from upplied.errors import SettingsError
from upplied.fleet.run import SHARD_TARGETS

POOL = "planners"
FLEET, SHARD = "transfer-fleet/transfer-fleet", "plan-shard/plan-shard"  # deployments
EVERY_S = 1.0
MOST = 64  # shards that are offered at a time; a machine takes one
SHARDS_EACH = 8  # to a machine


class NotAccepted(Exception):
    """The server did not take the run; the text says why."""


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


@task(name="plan-on-pool", task_run_name="{name}", cache_policy=NO_CACHE, retries=1)
def plan_on_pool(name: str, shard: str, terms: dict[str, Any]) -> None:
    """Plan one shard on a machine of the work pool, on another one if that is lost; else a `FailedRun`."""
    run = run_deployment(SHARD, parameters={**terms, "shard": shard}, flow_run_name=name[:200], timeout=0)

    def look(client: SyncPrefectClient, run: FlowRun) -> None:
        if run.state is not None and run.state.is_scheduled() and not _online(client):
            client.set_flow_run_state(run.id, Cancelled(message="No worker is left on the pool."))

    run = _followed(run, look)
    if run.state is None or not run.state.is_completed():
        raise FailedRun(f"{name}: {run.state.name}: {run.state.message}" if run.state else name)


def _online(client: SyncPrefectClient) -> int:
    try:
        client.read_work_pool(POOL)
    except ObjectNotFound:
        return 0
    return sum(worker.status == WorkerStatus.ONLINE for worker in client.read_workers_for_work_pool(POOL))


def _followed(run: FlowRun, look: Callable[[SyncPrefectClient, FlowRun], object]) -> FlowRun:
    """A run when it has ended, looked at now and then."""
    with get_client(sync_client=True) as client:
        while True:
            run = client.read_flow_run(run.id)
            look(client, run)
            if run.state is not None and run.state.is_final():
                return run
            time.sleep(EVERY_S)


def run_now(parameters: Sequence[str], watch: bool, say: Callable[[str], None]) -> bool:
    """Submit transfer-fleet with parameters as NAME=VALUE (JSON), and `watch` it; whether all went well.

    Each line for the person goes to `say`. `NotAccepted` where the server refuses the run or knows no such
    deployment.
    """
    values = dict(map(_parameter, parameters))
    try:
        with get_client(sync_client=True) as client:
            schema = client.read_deployment_by_name(FLEET).parameter_openapi_schema or {}
        known = schema.get("properties", values)
        if unknown := sorted(values.keys() - known.keys()):
            raise NotAccepted(f"{', '.join(unknown)}: no such parameter; known: {', '.join(sorted(known))}")
        run = run_deployment(FLEET, parameters=values, timeout=0, as_subflow=False)
    except ObjectNotFound:
        raise NotAccepted(f"there is no deployment {FLEET}: upplied deploy") from None
    except PrefectHTTPStatusError as error:
        raise NotAccepted(_refusal(error)) from None
    say(f"{run.name}: {url_for(run) or run.id}")
    if not watch:
        return True
    states: list[str | None] = []

    def look(client: SyncPrefectClient, run: FlowRun) -> None:
        if (state := run.state) is not None and state.name not in states[-1:]:
            states.append(state.name)
            say(f"{state.name}: {state.message}" if state.message else str(state.name))

    ended = _followed(run, look).state
    return ended is not None and ended.is_completed() and ended.name == "Completed"


def _parameter(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise NotAccepted(f"{text!r} is not NAME=VALUE")
    try:
        return name, json.loads(value)
    except ValueError:
        raise NotAccepted(f"{name}: {value!r} is not JSON; text needs quotes: {name}='\"...\"'") from None


def _refusal(error: PrefectHTTPStatusError) -> str:
    try:
        return str(error.response.json().get("detail") or error)
    except ValueError:
        return str(error)
