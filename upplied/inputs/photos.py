"""Times of photos, as a file lists them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from upplied.errors import InputError
from upplied.records import Ints

_MOST_PHOTOS = 1_000_000


def photo_times(path: str | Path) -> Ints:
    """Times of photos, ns, rising.

    Raises InputError if the file cannot be read, or holds none.
    """
    rule = "whole numbers, ns of the log's clock, one a line or in a column t_ns"
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            lines = [line for line in csv.reader(stream) if line and line[0].strip()][: _MOST_PHOTOS + 1]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read: {error}", rule) from None
    at = 0
    if lines and "t_ns" in (names := [name.strip() for name in lines[0]]):
        at, lines = names.index("t_ns"), lines[1:]
    try:
        times = np.array([int(line[at]) for line in lines], np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(str(path), f"holds what is no time: {error}", rule) from None
    if not 0 < len(times) <= _MOST_PHOTOS:
        raise InputError(str(path), f"holds {len(times)} times", f"1 to {_MOST_PHOTOS}")
    return np.sort(times)
