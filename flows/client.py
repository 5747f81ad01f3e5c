"""A run asked for by a person: submitted, followed, and its end told in words."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

from prefect import get_client
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import FlowRun
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.utilities.urls import url_for

DEPLOYMENT = "transfer-fleet/transfer-fleet"
EVERY_S = 1.0


class NotAccepted(Exception):
    """The server did not take the run; the text says why."""


def run_now(parameters: Sequence[str], watch: bool, say: Callable[[str], None]) -> bool:
    """Submit transfer-fleet with parameters as NAME=VALUE (JSON), and `watch` it; whether all went well.

    Each line for the person goes to `say`. `NotAccepted` where the server refuses the run or knows no such
    deployment.
    """
    given = dict(map(_parameter, parameters))
    try:
        with get_client(sync_client=True) as client:
            schema = client.read_deployment_by_name(DEPLOYMENT).parameter_openapi_schema or {}
        known = schema.get("properties", given)
        if unknown := sorted(given.keys() - known.keys()):
            raise NotAccepted(f"{', '.join(unknown)}: no such parameter; known: {', '.join(sorted(known))}")
        run = run_deployment(DEPLOYMENT, parameters=given, timeout=0, as_subflow=False)
    except ObjectNotFound:
        raise NotAccepted(f"there is no deployment {DEPLOYMENT}: upplied deploy") from None
    except PrefectHTTPStatusError as error:
        raise NotAccepted(_refusal(error)) from None
    say(f"{run.name}: {url_for(run) or run.id}")
    if not watch:
        return True
    with get_client(sync_client=True) as client:
        ended = _followed(client, run, say)
    return ended.state is not None and ended.state.is_completed() and ended.state.name == "Completed"


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


def _followed(client: SyncPrefectClient, run: FlowRun, say: Callable[[str], None]) -> FlowRun:
    message = ""
    while True:
        run = client.read_flow_run(run.id)
        if (state := run.state) is not None:
            if state.name != message:
                message = state.name or ""
                say(f"{message}: {state.message}" if state.message else message)
            if state.is_final():
                return run
        time.sleep(EVERY_S)
