"""How planning remembers what it finds out: by content, through whatever it is given to remember with."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from upplied.config import digest
from upplied.provenance import method

METHOD_VERSION = "44"

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


def content_key(*parts: Any) -> str:
    """Key of a result in the cache: the method as it is, its libraries, and all that went in."""
    return digest({"method": METHOD_VERSION, **method(), "parts": [digest(part) for part in parts]})
