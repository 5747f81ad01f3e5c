"""The log of one Delta table: opened, followed to its newest commit, and never behind what was seen of it."""

from __future__ import annotations

import threading
from pathlib import Path

import pyarrow as pa
import pyarrow.dataset as ds
from deltalake import DeltaTable
from deltalake.exceptions import TableNotFoundError

from upplied.catalog.schema.migrations import SCHEMA_VERSION
from upplied.catalog.schema.tables import Table
from upplied.catalog.store.errors import explained
from upplied.catalog.store.files import FileStore
from upplied.catalog.store.identity import Heads, Identity
from upplied.catalog.store.log_hashes import CHECKPOINTS
from upplied.errors import CatalogError

VERSION_KEY = "upplied.schemaVersion"  # a property of each table
HASHED_KEY = "upplied.hashedFrom"  # another: the first version whose rows carry hashes
_PROPERTIES = {
    VERSION_KEY: str(SCHEMA_VERSION),
    HASHED_KEY: "0",
    "delta.checkpointInterval": str(CHECKPOINTS),
    "delta.logRetentionDuration": "interval 365 days",
    "delta.deletedFileRetentionDuration": "interval 30 days",
}


class TableLog:
    """What `StoredTable` reads and commits through."""

    def __init__(self, root: str, declared: Table, identity: Identity | None = None) -> None:
        self.declared = declared
        self.uri = f"{root.rstrip('/')}/{declared.name}"
        self._identity = identity or Identity(root, [declared.name])
        self._heads = Heads(root, declared.name)
        self._files = FileStore(self.uri)
        self._lock = threading.Lock()
        self._delta: DeltaTable | None = None
        # Else delta-rs states the range of each of the first 32 columns to pyarrow, and of no other one.
        self._skipping = {"delta.dataSkippingStatsColumns": ",".join(declared.sought)}

    def rows_of(self, delta: DeltaTable) -> ds.Dataset:
        """The rows of one version, read by pyarrow itself.

        Through delta-rs's own file system one process in seven aborted at its exit, since pyarrow's
        threads may outlive the interpreter that it calls back into.
        """
        return delta.to_pyarrow_dataset(filesystem=self._files.filesystem())

    def rows_in(self, delta: DeltaTable, names: list[str]) -> ds.Dataset:
        """The rows of some data files of a version, a newer program's columns among them.

        (The dataset of all files states the range of every column of every file, which costs far more.)
        """
        return ds.dataset(names, pa.schema(delta.schema().to_arrow()), "parquet", self._files.filesystem())

    def delta(self) -> DeltaTable | None:
        """The table itself, as of its newest commit, for maintenance; None where there is none."""
        with self._lock:
            return self._refreshed()

    def _refreshed(self) -> DeltaTable | None:
        if self._delta is None:
            seen = explained(self.uri, self._heads.seen)  # before the log is read: it never runs ahead of it
            delta = explained(self.uri, lambda: opened(self.uri))
            self._check(-1 if delta is None else delta.version(), seen)
            self._delta = delta
        else:
            explained(self.uri, self._delta.update_incremental)
            _check_version(self._delta, self.uri)  # a newer program may have come meanwhile
        return self._delta

    def _check(self, version: int, seen: int) -> None:
        """Whether the log reaches as far as it once did; a table that is not there was never made."""
        if version < seen:
            lost = f"its versions {version + 1} to {seen} are missing" if version >= 0 else "is missing"
            remedy = f"take {self.uri} from a backup: what was in it would be lost, and planned again"
            raise CatalogError(self.uri, lost, "nothing that was committed goes away", remedy)
        if version < 0:
            self._identity.required()

    def _created(self) -> DeltaTable:
        if self._files.local:
            Path(self.uri).mkdir(parents=True, exist_ok=True)
        self._delta = DeltaTable.create(
            self.uri,
            self.declared.schema,
            mode="ignore",
            name=self.declared.name,
            description=self.declared.meaning,
            configuration={**_PROPERTIES, **self._skipping},
            raise_if_key_not_exists=False,
        )
        return self._delta

    def _older(self, version: int) -> ds.Dataset | None:
        current = self.delta()
        if current is None:
            return None
        if not 0 <= version <= current.version():
            raise CatalogError(f"{self.uri} version {version}", "does not exist", f"0 to {current.version()}")
        return explained(f"{self.uri} version {version}", lambda: self.rows_of(DeltaTable(self.uri, version)))


def opened(uri: str) -> DeltaTable | None:
    """The table at a place; None where there is none, an error where this program would misread it."""
    try:
        delta = DeltaTable(uri)
    except TableNotFoundError:
        if not _has_commits(uri):
            return None
        delta = DeltaTable(uri)  # another writer made the table since we looked
    _check_version(delta, uri)
    return delta


def _check_version(delta: DeltaTable, uri: str) -> None:
    version = delta.metadata().configuration.get(VERSION_KEY, "")
    if not version.isdigit() or int(version) > SCHEMA_VERSION:
        found = f"has schema version {version or 'unknown'}"
        raise CatalogError(uri, found, f"at most {SCHEMA_VERSION}", "use a newer version of upplied")


def _has_commits(uri: str) -> bool:
    """Whether a local table has a log after all; raises where we may not look into it."""
    log_folder = Path(uri) / "_delta_log"
    if "://" in uri or not log_folder.exists():
        return False
    return any(entry.suffix == ".json" for entry in log_folder.iterdir())
