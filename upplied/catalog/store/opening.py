"""A Delta table as it is found: whether it is one, of which schema version, and its rows in our columns."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
from deltalake import DeltaTable
from deltalake.exceptions import TableNotFoundError

from upplied.catalog.schema.migrations import SCHEMA_VERSION
from upplied.errors import CatalogError

VERSION_KEY = "upplied.schemaVersion"  # a property of each table
HASHED_KEY = "upplied.hashedFrom"  # another: the first version whose rows carry hashes


def in_schema(found: pa.Table, schema: pa.Schema) -> pa.Table:
    """Rows in these columns and types; those that an older program lacked are null."""
    columns = [
        found[field.name].cast(field.type)
        if field.name in found.schema.names
        else pa.nulls(len(found), field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)


def opened(uri: str) -> DeltaTable | None:
    try:
        delta = DeltaTable(uri)
    except TableNotFoundError:
        if not _has_commits(uri):
            return None
        delta = DeltaTable(uri)  # another writer made the table since we looked
    check_version(delta, uri)
    return delta


def check_version(delta: DeltaTable, uri: str) -> None:
    """Refuse a table that a newer program changed so that this one would misread it."""
    version = delta.metadata().configuration.get(VERSION_KEY, "")
    if not version.isdigit() or int(version) > SCHEMA_VERSION:
        raise CatalogError(
            uri,
            f"has schema version {version or 'unknown'}",
            f"at most {SCHEMA_VERSION}",
            "use a newer version of upplied",
        )


def _has_commits(uri: str) -> bool:
    """Whether a local table has a log after all; raises where we may not look into it."""
    log_folder = Path(uri) / "_delta_log"
    if "://" in uri or not log_folder.exists():
        return False
    return any(entry.suffix == ".json" for entry in log_folder.iterdir())
