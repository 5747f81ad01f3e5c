"""What tells that a place is a catalog, which one, and how far its tables had come.

``catalog.json`` holds the name that was drawn when it was made; ``heads/<table>-<version>`` the newest
commit that somebody saw, with the hash of its entry: a log that ends before it has lost its newest entries.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import time
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import pyarrow as pa

from upplied.catalog.store.files import FileStore, explained
from upplied.errors import CatalogError

_FILE = "catalog.json"
_FORMAT = "upplied catalog"
_TRIED = (OSError, pa.ArrowException)
_CLOCK = "clock"
_TRUSTED = timedelta(seconds=2)  # apart by less, the clock of this machine is right: it has finer steps
_ASKED_AGAIN_S = 600.0  # an object store: each look costs two requests


class Identity:
    """Which catalog is at a place; one of version 0.1.0 has no identity, and is known by its `tables`."""

    def __init__(self, root: str, tables: Sequence[str]) -> None:
        self.files = FileStore(root)
        self._tables = tables
        self._id: str | None = None

    @property
    def id(self) -> str | None:
        """The name of the catalog; empty where an older program made it, None where there is none."""
        if not self._id:
            self._id = self._read()
        return self._id

    def required(self) -> str:
        """The same; a place that is no catalog is an error."""
        if (name := self.id) is None:
            rule = "a folder with catalog.json, or tables of an earlier version"
            remedy = "check the path and whether its disk is mounted"
            remedy += "; `upplied structures add` makes a new one"
            raise CatalogError(self.files.root, "is no catalog", rule, remedy)
        return name

    def made(self) -> str:
        """The name of the catalog, which is drawn now where there is none."""
        if not self.id:
            about = {"format": _FORMAT, "id": uuid.uuid4().hex, "made_at": datetime.now(UTC).isoformat()}
            content = _text(about).encode()
            explained(self.files.root, lambda: self.files.create(_FILE, content), doing="written")
            self._id = self._read()
        return self._id or ""

    def is_as_written(self) -> bool:
        """Whether no byte of the identity was changed; nobody can tell of what an older program wrote."""
        content = self.files.read(_FILE) if self.files.has(_FILE) else b"{}"
        about = json.loads(content)
        return "sha256" not in about or content == _text(about).encode()

    def _read(self) -> str | None:
        def content() -> bytes | str | None:
            if self.files.has(_FILE):
                return self.files.read(_FILE)
            return "" if any(self.files.has_folder(f"{name}/_delta_log") for name in self._tables) else None

        what = self.files.path(_FILE)
        try:
            if not isinstance(stored := explained(what, content, doing="read"), bytes):
                return stored
            about = json.loads(stored)
        except ValueError as error:
            raise CatalogError(what, f"is damaged: {error}", "", "take it from a backup") from None
        if not isinstance(about, dict) or about.get("format") != _FORMAT or type(about.get("id")) is not str:
            raise CatalogError(what, "is not the identity of a catalog", f'"format": "{_FORMAT}"')
        return str(about["id"])


def _text(about: dict[str, str]) -> str:
    about = {name: value for name, value in about.items() if name != "sha256"}
    sha256 = hashlib.sha256(json.dumps(about).encode()).hexdigest()
    return json.dumps({**about, "sha256": sha256}, indent=1) + "\n"


class Heads:
    """The newest version of one table, in the catalog at a root, that anybody saw."""

    def __init__(self, root: str, table: str) -> None:
        self._files = FileStore(f"{root.rstrip('/')}/heads")
        self._prefix = f"{table}-"
        self._noted = -1

    def seen(self) -> int:
        """The version; -1 where none was noted."""
        return max(self._names(), default=-1)

    def stated(self) -> str:
        """What was noted of the newest version; empty where nothing was."""
        names = self._names()
        return self._files.read(names[max(names)]).decode(errors="replace") if names else ""

    def note(self, version: int, stated: str = "") -> None:
        """Note a version that is committed; where that is impossible, its loss would not be noticed."""
        if version <= self._noted:
            return
        with contextlib.suppress(*_TRIED):
            # One file per version: whoever comes later never takes the note back.
            self._files.write(f"{self._prefix}{version:020}", stated.encode(), lasting=False)
            self._noted = version
            for older, name in self._names().items():
                if older < version:
                    self._files.remove(name)

    def _names(self) -> dict[int, str]:
        named = re.compile(re.escape(self._prefix) + r"(\d{20})")
        return {int(match[1]): name for name in self._files.names() if (match := named.fullmatch(name))}


class Clock:
    """The time at the root of a catalog, by the stamps of files written there: machines disagree."""

    def __init__(self, root: str) -> None:
        self._files = FileStore(f"{root.rstrip('/')}/heads")
        self._ahead = timedelta()  # of the place, before this machine
        self._looked: float | None = None

    def now(self) -> datetime:
        """The time there, UTC."""
        if self._files.local or self._looked is None or time.monotonic() - self._looked > _ASKED_AGAIN_S:
            try:
                self._files.write(_CLOCK, b"", lasting=False)
                there = self._files.filesystem().get_file_info(_CLOCK).mtime  # None where it is gone again
                ahead = there - datetime.now(UTC) if there else timedelta()
            except _TRIED:  # nothing may be written there
                ahead = timedelta()
            self._ahead = ahead if abs(ahead) > _TRUSTED else timedelta()
            self._looked = time.monotonic()
        return datetime.now(UTC) + self._ahead
