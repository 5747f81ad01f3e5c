"""What all records have in common: array types, a repr that shows shapes, and results kept with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Value = TypeVar("Value")


class Record:
    """Base of the records: a repr that shows shapes, not numbers."""

    def derived(self, name: str, compute: Callable[[], Value]) -> Value:
        """What follows from this record alone, computed once and kept in it; a changed copy has its own.

        Parameters
        ----------
        name : str
            Of the result, and of whatever else it depends on.
        compute : callable
        """
        kept: dict[str, Value] = self.__dict__.setdefault("_derived", {})
        if name not in kept:
            kept[name] = compute()
        return kept[name]

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
