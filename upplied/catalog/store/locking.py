"""One at a time in a folder, whoever else works on it."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from upplied.errors import CatalogError

PATIENCE_S = 1800.0  # a publication of a large fleet takes minutes
_LOOK_S = 0.1
_TURN_S = 5.0  # of a writer that holds its turn for longer nobody waits: it was stopped, or is far away


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
    """Wait for the others who do the same, for some seconds at most; a courtesy, which nothing depends on.

    Nobody overtakes: the first who waits holds a second lock until it has the first, and whoever comes back
    for another turn needs that second lock too. The kernel wakes them, so that a loaded machine, on which a
    look now and then would mostly find the turn taken, makes nobody wait longer than the others work.
    """
    waiting = _Waiting(path)
    waiting.start()
    waiting.ended.wait(_TURN_S)
    try:
        yield
    finally:
        waiting.leave()


class _Waiting(threading.Thread):
    """Waits in the kernel, which knows no patience; whoever gives up leaves it behind."""

    def __init__(self, path: Path) -> None:
        super().__init__(name=f"turn of {path.name}", daemon=True)
        self._paths = (path.with_suffix(".next"), path)
        self._handles: list[int] = []
        self._left = False
        self._lock = threading.Lock()
        self.ended = threading.Event()

    def run(self) -> None:
        with suppress(OSError, ImportError):
            import fcntl

            for path in self._paths:
                self._handles.append(handle := _opened(path))
                fcntl.flock(handle, fcntl.LOCK_EX)
            os.close(self._handles.pop(0))
        with self._lock:
            self.ended.set()
            if self._left:
                self._close()

    def leave(self) -> None:
        """Let the next one in, now or as soon as this one would have had its turn."""
        with self._lock:
            self._left = True
            if self.ended.is_set():
                self._close()

    def _close(self) -> None:
        while self._handles:
            os.close(self._handles.pop())


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
