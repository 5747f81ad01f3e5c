"""What a column and a table of the catalog are: names, types, units, meanings, constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa

TEXT, REAL, WHOLE, TRUTH = pa.string(), pa.float64(), pa.int64(), pa.bool_()
MOMENT = pa.timestamp("us", tz="UTC")


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
        said = ["required"] if self.required else []
        if self.allowed:
            said.append("one of " + ", ".join(self.allowed))
        if self.low is not None and self.high is not None:
            said.append(f"{self.low:g} to {self.high:g}")
        elif self.low is not None:
            said.append(f"at least {self.low:g}")
        return ", ".join(said)

    @property
    def field(self) -> pa.Field:
        """The Arrow field, with unit and meaning as metadata."""
        return pa.field(self.name, self.type, metadata={"unit": self.unit, "meaning": self.meaning})


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
        """The Arrow schema."""
        return pa.schema([column.field for column in self.columns])

    @property
    def names(self) -> list[str]:
        """The names of the columns, in order."""
        return [column.name for column in self.columns]


def identity(name: str, meaning: str) -> Column:
    """A text that every row has."""
    return Column(name, TEXT, "", meaning, required=True)


COMMIT = identity("commit_id", "name of the commit that wrote the row")
COMMIT_VERSION = Column(
    "commit_version",
    WHOLE,
    "1",
    "number of that commit: of two rows the one with the larger number is the newer, whatever clocks say; "
    "-1 in rows of schema version 1",
    required=True,
    low=-1,
)
ROW_SHA256 = Column(
    "row_sha256", TEXT, "", "hash of all that the row says; empty in rows of before schema version 3"
)
BEFORE_SHA256 = Column(
    "before_sha256",
    TEXT,
    "",
    "`row_sha256` of the row before it, which is part of its own: no row can be changed or taken away unseen",
)
ADDED = "by the clock of the place, never before what was added earlier"


def committed(when: str, chained: bool = True) -> tuple[Column, ...]:
    """The columns that say by which commit a row came, when, in words, and after which row."""
    moment = Column("added_at", MOMENT, "UTC", f"{when}, {ADDED}", required=True)
    return COMMIT, moment, COMMIT_VERSION, ROW_SHA256, *((BEFORE_SHA256,) if chained else ())
