"""Records kept once by their content, never changed: ``<folder>/<sha256>.parquet`` in the catalog."""

from __future__ import annotations

import re
from typing import Generic, TypeVar

import pyarrow as pa

from upplied.catalog.schema.codec import decode, encode, sha256_of
from upplied.catalog.store.errors import remedy_of
from upplied.catalog.store.files import FileStore
from upplied.errors import CatalogError

R = TypeVar("R")

_HASH = re.compile(r"[0-9a-f]{64}")


class ContentStore(Generic[R]):
    """The records of one kind in one catalog.

    Parameters
    ----------
    root : str
        Folder or object-store URI of the catalog.
    folder : str
        Such as ``meshes``.
    record_type : type
    remedy : str
        What a person does where one is damaged.
    """

    def __init__(self, root: str, folder: str, record_type: type[R], remedy: str) -> None:
        self.files = FileStore(f"{root.rstrip('/')}/{folder}")
        self.folder = folder
        self.record_type, self._remedy = record_type, remedy
        self._kept: set[str] = set()  # by this process: a surface's samples serve many plans

    def put(self, record: R) -> str:
        """Keep a record; returns its hash."""
        sha256 = sha256_of(record)
        if sha256 in self._kept:
            return sha256
        try:
            if not self.files.touched(file_name(sha256)):
                self.files.write(file_name(sha256), encode(record))
        except (OSError, pa.ArrowException) as error:
            remedy = "free space, or ask for the right to write there; nothing was changed"
            raise CatalogError(self.path(sha256), f"cannot be written: {error}", "", remedy) from None
        self._kept.add(sha256)
        return sha256

    def get(self, sha256: str) -> R:
        """The record of a hash.

        Raises
        ------
        CatalogError
            If it is not there, or is damaged.
        """
        try:
            return decode(self.files.read(file_name(sha256)), self.record_type, sha256)
        except (OSError, pa.ArrowException) as error:
            path = self.path(sha256)
            raise CatalogError(path, f"cannot be read: {error}", "", remedy_of(path, str(error))) from None
        except CatalogError:
            raise CatalogError(self.path(sha256), "is damaged", "", self._remedy) from None

    def path(self, sha256: str) -> str:
        """Where a record lies."""
        return self.files.path(file_name(sha256))


def file_name(sha256: str) -> str:
    """The name of the file of a record; what is no hash is refused."""
    if not _HASH.fullmatch(sha256):
        raise CatalogError(f"content {sha256[:80]!r}", "is no hash", "64 hexadecimal digits")
    return f"{sha256}.parquet"
