"""The catalog's cache with the records asked for last at hand: those of a source serve all its targets."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from upplied.planning.correspondence.memo import Memo

R = TypeVar("R")


class Recent:
    """A memo before another: what it holds is neither read nor decoded again.

    Parameters
    ----------
    memo : Memo
        Asked for what is not at hand.
    max_bytes : int
        Of all arrays that are held; the records unused for longest go first.
    """

    def __init__(self, memo: Memo, max_bytes: int = 128 << 20) -> None:
        self._memo, self._max_bytes = memo, max_bytes
        self._held: OrderedDict[tuple[str, str], Any] = OrderedDict()
        self._bytes = 0

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The record of this stage and key."""
        name = stage, key
        if name not in self._held:
            self._held[name] = self._memo(stage, record_type, key, compute)
            self._bytes += nbytes(self._held[name])
        self._held.move_to_end(name)
        record: R = self._held[name]
        while self._bytes > self._max_bytes and self._held:
            self._bytes -= nbytes(self._held.popitem(last=False)[1])
        return record


def nbytes(value: Any) -> int:
    """Bytes of the arrays in a record."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if is_dataclass(value) and not isinstance(value, type):
        return sum(nbytes(getattr(value, item.name)) for item in fields(value))
    return 0
