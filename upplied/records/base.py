"""The base of all records: array types, a repr with shapes, and cached results."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Value = TypeVar("Value")


class Record:
    """Base of the records: a repr that shows shapes, not numbers."""

    def derived(self, name: str, compute: Callable[[], Value]) -> Value:
        """A result that depends on this record alone, computed once; a changed copy computes its own.

        Its name says everything else that it depends on.
        """
        values: dict[str, Value] = self.__dict__.setdefault("_derived", {})
        if name not in values:
            values[name] = compute()
        return values[name]

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: another process derives its own results."""
        return {name: value for name, value in self.__dict__.items() if name != "_derived"}

    def __repr__(self) -> str:
        parts = []
        for item in fields(self):  # type: ignore[arg-type]
            value = getattr(self, item.name)
            shown = f"{value.dtype}{value.shape}" if isinstance(value, np.ndarray) else repr(value)
            parts.append(f"{item.name}={shown}")
        return f"{type(self).__name__}({', '.join(parts)})"


class Rows(Record):
    """A record whose fields are arrays, or such records, with a row each for the same things."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))  # type: ignore[arg-type]

    def rows(self, chosen: Ints | Bools | slice) -> Self:
        """Some of the things."""
        values = (getattr(self, item.name) for item in fields(self))  # type: ignore[arg-type]
        return type(self)(*(each.rows(chosen) if isinstance(each, Rows) else each[chosen] for each in values))

    @classmethod
    def stacked(cls, parts: Sequence[Self]) -> Self:
        """The things of several records one after another."""
        columns = [[getattr(part, item.name) for part in parts] for item in fields(cls)]  # type: ignore[arg-type]
        return cls(*(type(each[0]).stacked(each) if isinstance(each[0], Rows) else np.concatenate(each)
                     for each in columns))  # fmt: skip
