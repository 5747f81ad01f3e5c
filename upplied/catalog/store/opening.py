"""A Delta table that is open: made where there is none, as far as it once came, in a schema that is known.

Conflicts that delta-rs raises when many commit at once are tried again here: else rows would be lost.
"""

from __future__ import annotations

import json
import logging
import random
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pyarrow as pa
from deltalake import DeltaTable, Schema
from deltalake.exceptions import CommitFailedError, TableNotFoundError

from upplied.catalog.schema.tables import SCHEMA_VERSION, Table
from upplied.catalog.store.chain import CHECKPOINTS, unstated
from upplied.catalog.store.files import FileStore, explained
from upplied.catalog.store.identity import Heads, Identity
from upplied.errors import CatalogError

log = logging.getLogger(__name__)

T = TypeVar("T")

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
                done = act(delta)
                delta.update_incremental()
                self._heads.note(delta.version(), self._unstated(delta.version()))
                return done

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
        self._identity.made()
        with self._lock:
            delta = self._refreshed() or self._created()
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

    def _created(self) -> DeltaTable:
        if self._files.local:
            Path(self.uri).mkdir(parents=True, exist_ok=True)
        table, known = self.declared, {**_PROPERTIES, **self._skipping}
        about = {"name": table.name, "description": table.meaning, "raise_if_key_not_exists": False}
        self._delta = DeltaTable.create(self.uri, table.schema, "ignore", configuration=known, **about)
        return self._delta

    def _unstated(self, version: int) -> str:
        """The hashes that `unstated` tells of the log, as JSON."""
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
