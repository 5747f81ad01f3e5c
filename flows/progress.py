"""How far a run is: a bar on the terminal, and a progress artifact in Prefect."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from prefect.artifacts import create_progress_artifact, update_progress_artifact

from upplied.cli.terminal import progress as bar
from upplied.fleet import Session

EVERY_S = 5.0
KEY = "transfer-fleet-progress"

Shard = TypeVar("Shard")


@contextmanager
def progress(session: Session) -> Iterator[None]:
    """Show the progress of a session while it is worked."""
    artifact = create_progress_artifact(progress=0.0, key=KEY)
    shown = [time.monotonic()]
    lock = threading.Lock()
    with bar("planning", session.total) as advance:

        def tell(_: object) -> None:
            advance()
            with lock:
                due = time.monotonic() - shown[0] > EVERY_S
                if due:
                    shown[0] = time.monotonic()
            if due:
                update_progress_artifact(artifact, 100.0 * session.result.total / max(session.total, 1))

        session.progress = tell
        yield
    update_progress_artifact(artifact, 100.0)


def advancing(shards: Sequence[Shard]) -> Iterator[Shard]:
    """Shards that are worked elsewhere, one after the other; the bar moves as each has been waited for."""
    artifact = create_progress_artifact(progress=0.0, key=KEY)
    with bar("shards", len(shards)) as advance:
        for number, shard in enumerate(shards, 1):
            yield shard
            advance()
            update_progress_artifact(artifact, 100.0 * number / len(shards))
