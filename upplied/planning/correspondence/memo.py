"""How planning remembers what it finds out: by content, through whatever it is given to remember with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

R = TypeVar("R")


class Memo(Protocol):
    """Remembers results by content: the catalog's cache, or nothing at all."""

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The remembered record of this stage and key, or the computed one."""


def no_memo(stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
    """Computes every time."""
    return compute()


def remembering(memo: Memo, *hashes: str) -> Memo:
    """The memo where all inputs have a hash to remember them by, else none."""
    return memo if all(hashes) else no_memo
