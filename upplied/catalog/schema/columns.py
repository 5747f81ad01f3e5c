"""What a column and a table of the catalog are: names, types, units, meanings, constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa

TYPES = {
    "text": pa.string(),
    "real": pa.float64(),
    "whole": pa.int64(),
    "truth": pa.bool_(),
    "moment": pa.timestamp("us", tz="UTC"),
}
MOMENT = TYPES["moment"]
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
        if self.low is not None and self.high is not None:
            parts.append(f"{self.low:g} to {self.high:g}")
        elif self.low is not None:
            parts.append(f"at least {self.low:g}")
        return ", ".join(parts)

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

    @property
    def is_chained(self) -> bool:
        """Whether the rows follow each other by their hashes."""
        return BEFORE_SHA256 in self.names
