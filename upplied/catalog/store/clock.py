"""What time it is where a catalog lies, whatever the clock of this machine says.

Machines that fill one catalog disagree about the time. The place itself does not: a file that is
written there is stamped by one clock, that of the disk's machine or of the object store.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta

import pyarrow as pa

from upplied.catalog.store.files import FileStore

_FILE = "clock"
_TRUSTED = timedelta(seconds=2)  # apart by less, the clock of this machine is right: it has finer steps
_ASKED_AGAIN_S = 600.0  # an object store: each look costs two requests


class Clock:
    """The time at the root of a catalog, a folder or an object-store URI."""

    def __init__(self, root: str) -> None:
        self._files = FileStore(f"{root.rstrip('/')}/heads")
        self._ahead = timedelta()  # of the place, before this machine
        self._looked: float | None = None

    def now(self) -> datetime:
        """The time there, UTC."""
        if self._files.local or self._looked is None or time.monotonic() - self._looked > _ASKED_AGAIN_S:
            there = self._there()
            ahead = timedelta() if there is None else there - datetime.now(UTC)
            self._ahead = ahead if abs(ahead) > _TRUSTED else timedelta()
            self._looked = time.monotonic()
        return datetime.now(UTC) + self._ahead

    def _there(self) -> datetime | None:
        """The stamp of a file that is written now; None where nothing may be written."""
        try:
            self._files.write(_FILE, b"", lasting=False)
            stamp: datetime | None = self._files.filesystem().get_file_info(_FILE).mtime
        except (OSError, pa.ArrowException):
            return None
        return stamp
