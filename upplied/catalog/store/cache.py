"""The memo: any record of arrays and scalars as one Parquet file, found by stage and key.

The key holds all that a result depends on. A file that does not match its stage, key and hash is computed
again; losing the cache loses time, nothing else.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from upplied.catalog.schema.codec import decode, encode
from upplied.checks import check_id
from upplied.errors import CatalogError
from upplied.files import replace_file

log = logging.getLogger(__name__)

R = TypeVar("R")


class Cache:
    """Remembers records by content, in a folder that is made when the first is kept.

    Examples
    --------
    >>> cache = Cache("cache")                                                    # doctest: +SKIP
    >>> cache("clouds", Cloud, key, lambda: voxel_cloud(structure, settings))     # doctest: +SKIP
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)

    def __call__(self, stage: str, record_type: type[R], key: str, compute: Callable[[], R]) -> R:
        """The remembered record of this stage and key, or the computed one, which is then remembered."""
        if (record := self.get(stage, record_type, key)) is None:
            record = compute()
            self.put(stage, key, record)
        return record

    def get(self, stage: str, record_type: type[R], key: str, nameless: bool = False) -> R | None:
        """The remembered record; None where none can be believed. Version 0.1.0 wrote `nameless` ones."""
        path = self.path(stage, key)
        try:
            record = decode(path.read_bytes(), record_type, name="" if nameless else f"{stage}/{key}")
        except FileNotFoundError:
            return None
        except (OSError, CatalogError) as error:
            log.warning("cache entry %s is not believed and will be computed again: %s", path, error)
            return None
        with contextlib.suppress(OSError):  # read-only: the entry only looks older to `prune` than it is
            os.utime(path)
        return record

    def put(self, stage: str, key: str, record: object) -> None:
        """Remember a record; where that is impossible (disk full, read-only) only time is lost."""
        path = self.path(stage, key)
        try:  # an entry that a power cut tore is noticed
            replace_file(path, encode(record, f"{stage}/{key}"), lasting=False)
        except OSError as error:
            log.warning("cannot remember %s: %s", path, error)

    def path(self, stage: str, key: str) -> Path:
        """Where the record of this stage and key lies."""
        name = check_id(key, "cache key")
        return self.folder / check_id(stage, "cache stage") / name[:2] / f"{name}.parquet"

    def entries(self) -> list[tuple[float, int, Path]]:
        """When each entry was last used (s since 1970), its size in bytes and its path; oldest first."""
        uses = []
        for path in self.folder.glob("*/*/*.parquet"):
            with contextlib.suppress(FileNotFoundError):  # pruned by somebody else meanwhile
                known = path.stat()
                uses.append((known.st_mtime, known.st_size, path))
        return sorted(uses)

    def prune(self, max_bytes: int) -> int:
        """Forget the records unused for longest until at most `max_bytes` remain; bytes freed."""
        entries = self.entries()
        excess = sum(size for _, size, _ in entries) - max_bytes
        freed = 0
        for _, size, path in entries:
            if freed < excess:
                path.unlink(missing_ok=True)
                freed += size
        return freed
