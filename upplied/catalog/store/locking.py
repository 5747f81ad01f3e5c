"""One at a time in a folder, whoever else works on it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from upplied.errors import CatalogError

PATIENCE_S = 1800.0  # a publication of a large fleet takes minutes
_LOOK_S = 0.1


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; it ends with the process that holds it, however that ends."""
    path = folder / ".lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(folder), f"cannot be written: {error}", "", remedy) from None
    try:
        _wait(handle, folder)
        yield
    finally:
        os.close(handle)


def _wait(handle: int, folder: Path) -> None:
    try:
        import fcntl
    except ImportError:
        return  # Windows: two who publish into one folder at once are not kept apart
    give_up = time.monotonic() + PATIENCE_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > give_up:
                raise CatalogError(str(folder), "somebody else has been publishing there for long") from None
            time.sleep(_LOOK_S)
        except OSError:
            return  # a disk without locks: the generations still tell which is newer
        else:
            return
