"""One at a time in a folder, whoever else works on it."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from upplied.errors import CatalogError

PATIENCE_S = 1800.0  # a publication of a large fleet takes minutes
_TURN_S = 5.0  # of a writer that holds its turn for longer nobody waits: it was stopped, or is far away


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock until the process ends or leaves; where there are no locks it counts as held."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ".lock").touch()
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(folder), f"cannot be written: {error}", "", remedy) from None
    with _waited(PATIENCE_S, folder / ".lock") as held:
        if not held:
            raise CatalogError(str(folder), "somebody else has been publishing there for long")
        yield


@contextmanager
def turn(path: Path) -> Iterator[None]:
    """Wait for the others who do the same, for some seconds at most; a courtesy, which nothing depends on.

    Nobody overtakes: the first who waits holds a second lock, which whoever comes back for another turn
    needs too. The kernel wakes them: looks now and then would mostly find the turn taken on a loaded
    machine.
    """
    with _waited(_TURN_S, path.with_suffix(".next"), path):
        yield


@contextmanager
def _waited(patience_s: float, *paths: Path) -> Iterator[bool]:
    """Wait for the last of some locks, each held until the next one is; whether it is held.

    A thread waits in the kernel, which knows no patience; whoever gives up leaves it behind to pass the
    lock on.
    """
    handles, closing = list[int](), threading.Lock()
    ended, left = threading.Event(), threading.Event()

    def wait() -> None:
        with suppress(OSError, ImportError):
            import fcntl

            for path in paths:
                path.parent.mkdir(parents=True, exist_ok=True)
                handles.append(handle := os.open(path, os.O_RDWR | os.O_CREAT, 0o644))
                fcntl.flock(handle, fcntl.LOCK_EX)
                if len(handles) > 1:
                    os.close(handles.pop(0))
        ended.set()
        close()

    def close() -> None:
        with closing:
            while handles and ended.is_set() and left.is_set():
                os.close(handles.pop())

    threading.Thread(target=wait, name=f"lock of {paths[-1].name}", daemon=True).start()
    try:
        yield ended.wait(patience_s)
    finally:
        left.set()
        close()
