"""What tells that a place is a catalog, which one, and how far its tables had come; and a table that is open.

``catalog.json`` holds the name that was drawn when it was made; ``heads/<table>-<version>`` the newest
commit that somebody saw, with the hash of its entry: a log that ends before it has lost its newest entries.
Conflicts that delta-rs raises when many commit at once are tried again here: else rows would be lost.
"""

import contextlib
import hashlib
import json
import logging
import random
import re
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
from deltalake import DeltaTable, Schema
from deltalake.exceptions import CommitFailedError, TableNotFoundError

from upplied.catalog.schema.tables import SCHEMA_VERSION, Table
from upplied.catalog.store.chain import CHECKPOINTS, unstated
from upplied.catalog.store.files import FileStore, explained
from upplied.errors import CatalogError

log = logging.getLogger(__name__)
T = TypeVar("T")

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

    def name(self) -> str:
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


_PATIENCE_S = 60.0  # of conflicts, before a writer gives up
VERSION_KEY = "upplied.schemaVersion"  # a property of each table
HASHED_KEY = "upplied.hashedFrom"  # another: the first version whose rows carry hashes
_PROPERTIES = {
    VERSION_KEY: str(SCHEMA_VERSION),
    HASHED_KEY: "0",
    "delta.checkpointInterval": str(CHECKPOINTS),
    "delta.logRetentionDuration": "interval 365 days",
    "delta.deletedFileRetentionDuration": "interval 30 days",
}


class OpenTable:
    """One table of a catalog, at its root; without it the identity says whether there is a catalog at all."""

    def __init__(self, root: str, declared: Table, identity: Identity | None = None) -> None:
        self.declared = declared
        self.uri = f"{root.rstrip('/')}/{declared.name}"
        self._root, self._identity = root, identity or Identity(root, [declared.name])
        self._heads, self._files = Heads(root, declared.name), FileStore(self.uri)
        self._log = FileStore(f"{self.uri}/_delta_log")
        self._lock = threading.Lock()
        self._delta: DeltaTable | None = None
        # Else delta-rs states the range of each of the first 32 columns to pyarrow, and of no other one.
        self._skipping = {"delta.dataSkippingStatsColumns": ",".join(declared.sought)}
        self._stated = (-1, "")  # of a version of the log: hashes of its entries that none of them states

    def delta(self) -> DeltaTable | None:
        """The table itself, as of its newest commit, for maintenance; None where there is none."""
        with self._lock:
            return self._refreshed()

    def change(self, act: Callable[[DeltaTable], T]) -> T | None:
        """Do maintenance on the newest version, again where a writer was faster; None without a table."""

        def once() -> T | None:
            with self._lock:
                if (delta := self._refreshed()) is None:
                    return None
                result = act(delta)
                delta.update_incremental()
                self._heads.note(delta.version(), self._unstated(delta.version()))
                return result

        return self._insist(once)

    def _insist(self, act: Callable[[], T]) -> T:
        give_up = time.monotonic() + _PATIENCE_S
        while True:
            try:
                return explained(self.uri, act, CommitFailedError)
            except CommitFailedError as conflict:
                if time.monotonic() > give_up:
                    fault = f"other writers were always faster: {conflict}"
                    raise CatalogError(self.uri, fault, "", "try again later") from None
                log.debug("%s: another writer was faster, trying again", self.uri)
                time.sleep(random.uniform(0.01, 0.25))

    def _ready(self) -> None:
        """Make the table where there is none, and add the columns that an older program lacked."""
        self._identity.name()
        with self._lock:
            if (delta := self._refreshed()) is None:
                if self._files.local:
                    Path(self.uri).mkdir(parents=True, exist_ok=True)
                table, properties = self.declared, {**_PROPERTIES, **self._skipping}
                about = {"name": table.name, "description": table.meaning, "raise_if_key_not_exists": False}
                delta = DeltaTable.create(self.uri, table.schema, "ignore", configuration=properties, **about)
                self._delta = delta
            columns = {field.name for field in delta.schema().fields}
            new = [field for field in self.declared.schema if field.name not in columns]
            if new:
                delta.alter.add_columns(list(Schema.from_arrow(pa.schema(new)).fields))
            known, changed = delta.metadata().configuration, dict(self._skipping)
            if int(known[VERSION_KEY]) < SCHEMA_VERSION:
                changed |= {VERSION_KEY: str(SCHEMA_VERSION), HASHED_KEY: str(delta.version() + 1)}
            if not changed.items() <= known.items():
                delta.alter.set_table_properties(changed, raise_if_not_exists=False)

    def _refreshed(self) -> DeltaTable | None:
        if self._delta is None:
            seen = explained(self.uri, self._heads.seen)  # before the log is read: it never runs ahead of it
            delta = explained(self.uri, lambda: opened(self.uri))
            version = -1 if delta is None else delta.version()
            if version < seen:
                lost = f"its versions {version + 1} to {seen} are missing" if version >= 0 else "is missing"
                remedy = f"take {self.uri} from a backup: what was in it would be lost, and planned again"
                raise CatalogError(self.uri, lost, "nothing that was committed goes away", remedy)
            if delta is None:  # it was never made
                self._identity.required()
            self._delta = delta
        else:
            explained(self.uri, self._delta.update_incremental)
            _check_version(self._delta, self.uri)  # a newer program may have come meanwhile
        return self._delta

    def _unstated(self, version: int) -> str:
        if self._stated[0] != version:
            self._stated = version, json.dumps(unstated(self._log, version))
        return self._stated[1]


def opened(uri: str) -> DeltaTable | None:
    """The table at a place; None where there is none, an error where this program would misread it."""
    try:
        delta = DeltaTable(uri)
    except TableNotFoundError:
        log_folder = Path(uri) / "_delta_log"  # of a local table; an error where we may not look into it
        there = "://" not in uri and log_folder.exists()
        if not there or not any(entry.suffix == ".json" for entry in log_folder.iterdir()):
            return None
        delta = DeltaTable(uri)  # another writer made the table since we looked
    _check_version(delta, uri)
    return delta


def _check_version(delta: DeltaTable, uri: str) -> None:
    version = delta.metadata().configuration.get(VERSION_KEY, "")
    if not version.isdigit() or int(version) > SCHEMA_VERSION:
        fault = f"has schema version {version or 'unknown'}"
        raise CatalogError(uri, fault, f"at most {SCHEMA_VERSION}", "use a newer version of upplied")
