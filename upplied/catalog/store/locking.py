"""One at a time in a folder, whoever else works on it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from upplied.errors import CatalogError

PATIENCE_S = 1800.0  # a publication of a large fleet takes minutes
_LOOK_S = 0.1
_TURN_S = 5.0  # of a writer that holds its turn for longer nobody waits: it was stopped, or is far away
_NEXT_S = 0.005


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; it ends with the process that holds it, however that ends."""
    try:
        handle = _opened(folder / ".lock")
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(folder), f"cannot be written: {error}", "", remedy) from None
    try:
        if not _taken(handle, PATIENCE_S, _LOOK_S):
            raise CatalogError(str(folder), "somebody else has been publishing there for long")
        yield
    finally:
        os.close(handle)


@contextmanager
def turn(path: Path) -> Iterator[None]:
    """Wait for the others who do the same, for some seconds at most; a courtesy, which nothing depends on."""
    handle = -1
    try:
        with suppress(OSError):
            handle = _opened(path)
            _taken(handle, _TURN_S, _NEXT_S)
        yield
    finally:
        if handle >= 0:
            os.close(handle)


def _opened(path: Path) -> int:
    path.parent.mkdir(parents=True, exist_ok=True)
    return os.open(path, os.O_RDWR | os.O_CREAT, 0o644)


def _taken(handle: int, patience_s: float, look_s: float) -> bool:
    """Whether the lock was taken in time; where there are no locks, it counts as taken."""
    try:
        import fcntl
    except ImportError:
        return True  # Windows: two who publish into one folder at once are not kept apart
    give_up = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > give_up:
                return False
            time.sleep(look_s)
        except OSError:
            return True  # a disk without locks: the generations still tell which is newer
        else:
            return True
