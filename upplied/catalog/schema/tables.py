"""The tables of the catalog, declared once in ``tables.csv`` and ``columns.csv``: key, type, unit, meaning.

Stored tables, published Parquet, checks and ``catalog/README.md`` (by ``python -m`` with this module) follow
from there. A row without a type is the column of that name as the last table above has it.

A table's schema version is one of its properties, raised with the first row of a program whose rows an older
one would misread, which then refuses; newer ones read older tables as they are. Columns may be added alike.

- 1 (0.1.0): rows stood in the order of their writers' clocks.
- 2: rows stand in the order of commits (`commit_version`; -1 in a row of version 1, and among those the
  clocks count as before), and `transfers.added_at` tells when a plan was added, not when it was planned.
- 3: rows carry a hash (`row_sha256`), and those of tables that belong to one place follow each other
  (`before_sha256`; the first one all of before). The steps of a commit are a file (`catalog.store.delta`).
"""

import csv
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

TYPES = {"text": pa.string(), "real": pa.float64(), "whole": pa.int64(), "truth": pa.bool_()}
MOMENT = TYPES["moment"] = pa.timestamp("us", tz="UTC")
_WORDS = dict(zip(TYPES.values(), ("text", "float64", "int64", "bool", "time, UTC, us"), strict=True))
#: Hash of a row, and that of the row before it in a table whose rows follow each other.
ROW_SHA256, BEFORE_SHA256 = "row_sha256", "before_sha256"


@dataclass(frozen=True)
class Column:
    """One column, and what is allowed in it."""

    name: str
    type: pa.DataType
    unit: str
    meaning: str
    required: bool = False  # never null, never an empty text
    allowed: tuple[str, ...] = ()  # the only ones allowed, where there are any
    low: float | None = None
    high: float | None = None

    @property
    def constraint(self) -> str:
        """What is allowed, in words."""
        parts = ["required"] if self.required else []
        if self.allowed:
            parts.append("one of " + ", ".join(self.allowed))
        if self.low is not None:
            parts.append(f"at least {self.low:g}" if self.high is None else f"{self.low:g} to {self.high:g}")
        return ", ".join(parts)


@dataclass(frozen=True)
class Table:
    """One table: what a row is, what names it, and its columns."""

    name: str
    meaning: str
    key: tuple[str, ...]
    columns: tuple[Column, ...]
    order: tuple[str, ...]  # of the rows in merged files: what is asked for together lies together

    @cached_property
    def schema(self) -> pa.Schema:
        """The Arrow schema, with unit and meaning as metadata of each field."""
        return pa.schema(
            [pa.field(c.name, c.type, metadata={"unit": c.unit, "meaning": c.meaning}) for c in self.columns]
        )

    @cached_property
    def names(self) -> list[str]:
        """The names of the columns, in order."""
        return [column.name for column in self.columns]

    @cached_property
    def sought(self) -> list[str]:
        """The columns that rows are looked for by: files are skipped by the ranges of these alone."""
        others = ("kind", "commit_version", "added_at")
        return [name for name in self.names if name.endswith("_id") or name in others]

    @property
    def is_chained(self) -> bool:
        """Whether the rows follow each other by their hashes."""
        return BEFORE_SHA256 in self.names


def _rows(name: str) -> "csv.DictReader[str]":
    return csv.DictReader(files(__package__).joinpath(name).read_text(encoding="utf-8").splitlines())


def _declared() -> dict[str, Table]:
    tables, columns, last = dict[str, Table](), dict[str, list[Column]](), dict[str, Column]()
    for row in _rows("columns.csv"):
        name, allowed = row["column"], tuple(row["allowed"].split("|")) if row["allowed"] else ()
        low, high = (float(bound) if bound else None for bound in (row["low"], row["high"]))
        if row["type"]:
            required, kind = row["required"] == "yes", TYPES[row["type"]]
            last[name] = Column(name, kind, row["unit"], row["meaning"], required, allowed, low, high)
        columns.setdefault(row["table"], []).append(last[name])
    for row in _rows("tables.csv"):
        name, key, order = row["table"], tuple(row["key"].split()), tuple(row["order"].split())
        tables[name] = Table(name, row["meaning"], key, tuple(columns[name]), order)
    return tables


TABLES = _declared()
#: The tables of steps, and whose rows own them.
STEPS = {"waypoints": "transfers", "poses": "demonstrations"}
SCHEMA_VERSION = 3


def needed(table: Table, columns: list[str]) -> list[str]:
    """These columns, and the one that `added_at` is filled from in older rows."""
    more = ["planned_at"] if "added_at" in columns and "planned_at" in table.names else []
    return list(dict.fromkeys([*columns, *more]))


def upgraded(table: Table, rows: pa.Table) -> pa.Table:
    """Rows of this or an earlier schema, null where a program knew no such column, with what they lacked."""
    for at, field in enumerate(rows.schema):
        column = rows.column(at)
        if not column.null_count:
            continue
        if field.name == "commit_version":
            column = column.fill_null(-1)  # of schema version 1
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
    known, columns = dict(zip(rows.schema.names, rows.columns, strict=True)), list[pa.ChunkedArray]()
    for field in schema:
        column = known[field.name] if field.name in known else pa.nulls(len(rows), field.type)
        columns.append(column if column.type == field.type else column.cast(field.type))
    return pa.table(columns, schema=schema)


def data_dictionary() -> str:
    """The data dictionary as Markdown, for people who open the tables."""
    preface = files(__package__).joinpath("dictionary.md").read_text(encoding="utf-8")
    parts = [preface.format(version=SCHEMA_VERSION)]
    for table in TABLES.values():
        parts.append(f"## {table.name}\n\n{table.meaning[0].upper()}{table.meaning[1:]}.\n")
        parts.append("| column | type | unit | meaning | constraint |\n|---|---|---|---|---|")
        for c in table.columns:
            parts.append(f"| `{c.name}` | {_WORDS[c.type]} | {c.unit} | {c.meaning} | {c.constraint} |")
        parts.append("")
    return "\n".join(parts).rstrip() + "\n"


if __name__ == "__main__":
    Path(__file__).parents[3].joinpath("catalog", "README.md").write_text(data_dictionary(), "utf-8")
