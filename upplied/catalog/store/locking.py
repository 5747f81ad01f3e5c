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
    """Hold the folder's lock; it ends with the process that holds it, however that ends.

    Where there are no locks (Windows, some disks) it counts as held: generations still tell which is newer.
    """
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

    Nobody overtakes: the first who waits holds a second lock until it has the first, and whoever comes back
    for another turn needs that second lock too. The kernel wakes them, so that a loaded machine, on which a
    look now and then would mostly find the turn taken, makes nobody wait longer than the others work.
    """
    with _waited(_TURN_S, path.with_suffix(".next"), path):
        yield


@contextmanager
def _waited(patience_s: float, *paths: Path) -> Iterator[bool]:
    """Wait for the last of some locks, each of which is held until the next one is; whether it is held."""
    waiting = _Waiting(paths)
    waiting.start()
    held = waiting.ended.wait(patience_s)
    try:
        yield held
    finally:
        waiting.leave()


class _Waiting(threading.Thread):
    """Waits in the kernel, which knows no patience; whoever gives up leaves it behind."""

    def __init__(self, paths: tuple[Path, ...]) -> None:
        super().__init__(name=f"lock of {paths[-1].name}", daemon=True)
        self._paths = paths
        self._handles: list[int] = []
        self._left = False
        self._lock = threading.Lock()
        self.ended = threading.Event()

    def run(self) -> None:
        with suppress(OSError, ImportError):
            import fcntl

            for path in self._paths:
                path.parent.mkdir(parents=True, exist_ok=True)
                self._handles.append(handle := os.open(path, os.O_RDWR | os.O_CREAT, 0o644))
                fcntl.flock(handle, fcntl.LOCK_EX)
                if len(self._handles) > 1:
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
