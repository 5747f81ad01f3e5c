"""How far a run is: a bar on the terminal, and a progress artifact in Prefect."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import copy_context
from functools import partial
from typing import TypeVar

import httpx
from prefect.artifacts import create_progress_artifact, update_progress_artifact

from upplied.cli.terminal import progress

EVERY_S = 5.0
KEY = "transfer-fleet-progress"

Shard = TypeVar("Shard")


def advancing(shards: Sequence[Shard]) -> Iterator[Shard]:
    """Shards that are being planned, one after the other; the bar moves as each has been waited for."""
    done = 0
    with progress("shards", len(shards)) as advance, _logged(lambda: done, len(shards)):
        for shard in shards:
            yield shard
            done += 1
            advance()


@contextmanager
def _logged(done: Callable[[], int], of: int) -> Iterator[None]:
    """Tell Prefect every few seconds, from a thread of its own: planning never waits for the server."""
    ended = threading.Event()
    tell = partial(copy_context().run, _tell, lambda: 100.0 * done() / of if of else 100.0, ended)
    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        ended.set()
        teller.join(EVERY_S)


def _tell(percent: Callable[[], float], ended: threading.Event) -> None:
    artifact, last = None, False
    while True:
        with suppress(httpx.HTTPError):  # the server is away: the next look tells as well
            if artifact is None:
                artifact = create_progress_artifact(percent(), key=KEY)
            else:
                update_progress_artifact(artifact, percent())
        if last:
            return
        last = ended.wait(EVERY_S)
