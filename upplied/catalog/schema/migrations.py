"""Rows of every earlier schema as rows of this one.

A table's schema version is one of its properties. Columns may be added without raising it: an older
program keeps what it does not know when it merges files or adds a version of a row, and reads past it.
It is raised where an older program would go wrong, which then refuses in words. A newer program
reads older tables as they are and raises their version with its first row.

- 1 (0.1.0): rows stood in the order of their writers' clocks.
- 2: rows stand in the order of commits (`commit_version`; in a row of version 1 it is -1, and among those
  the clocks count as before), and `transfers.added_at` tells when a plan was added, which in a row of
  version 1 is when it was planned.
- 3: rows carry a hash (`row_sha256`), and those of tables that belong to one place follow each other
  (`before_sha256`): the first that does follows the hash of all that came before there were hashes.
  The steps of a commit are a file (`upplied.catalog.store.steps`); those of earlier commits stay in tables.
"""

from __future__ import annotations

from collections.abc import Collection

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.tables import Table

SCHEMA_VERSION = 3

_FROM_BEFORE = -1  # the commit of rows of schema version 1
_NEEDS = {"added_at": "planned_at"}  # column -> the one it is taken from where it is missing


def needed(table: Table, columns: list[str]) -> list[str]:
    """These columns, and those that they are filled from in older rows."""
    more = [_NEEDS[name] for name in columns if _NEEDS.get(name) in table.names]
    return list(dict.fromkeys([*columns, *more]))


def missing(table: Table, names: Collection[str]) -> list[str]:
    """Columns without which rows are of no schema that there ever was."""
    filled = {"commit_version", *_NEEDS}
    return [c.name for c in table.columns if c.required and c.name not in {*names, *filled}]


def upgraded(table: Table, rows: pa.Table) -> pa.Table:
    """Rows of this or an earlier schema, null where a program knew no such column, with what they lacked."""
    for at, field in enumerate(rows.schema):
        column = rows.column(at)
        if not column.null_count:
            continue
        if field.name == "commit_version":
            column = column.fill_null(_FROM_BEFORE)
        elif field.name == "added_at" and "planned_at" in rows.schema.names:
            column = pc.coalesce(column, rows["planned_at"])
        elif pa.types.is_string(field.type):
            column = column.fill_null("")
        else:
            continue
        rows = rows.set_column(at, field, column)
    return rows


def in_schema(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    """Rows in these columns and types; those that an older program lacked are null."""
    known = set(rows.schema.names)
    columns = [
        rows[field.name].cast(field.type) if field.name in known else pa.nulls(len(rows), field.type)
        for field in schema
    ]
    return pa.table(columns, schema=schema)
