"""Normalised meshes, kept once per content: ``meshes/<sha256>.parquet`` in the catalog."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa
import pyarrow.fs as pafs

from upplied.catalog.codec import decode, encode, sha256_of
from upplied.catalog.files import replace_file
from upplied.errors import CatalogError
from upplied.records import Structure

_HASH = re.compile(r"[0-9a-f]{64}")
_REMEDY = "free space, or ask for the right to write there; nothing was changed"


class MeshStore:
    """The meshes of one catalog, content-addressed, never changed.

    Parameters
    ----------
    root : str
        Folder or object-store URI of the catalog.
    """

    def __init__(self, root: str) -> None:
        self.folder = f"{root.rstrip('/')}/meshes"
        self._local = "://" not in root
        self._remote: pafs.FileSystem | None = None

    def put(self, structure: Structure) -> str:
        """Keep the mesh of a structure; returns its hash."""
        bare = _bare(structure)
        sha256 = sha256_of(bare)
        try:
            if not self.has(sha256):
                self._write(sha256, encode(bare))
        except (OSError, pa.ArrowException) as error:
            raise CatalogError(self.path(sha256), f"cannot be written: {error}", "", _REMEDY) from None
        return sha256

    def get(self, sha256: str) -> Structure:
        """A structure of that mesh, without name.

        Raises
        ------
        CatalogError
            If the mesh is not there, or is damaged.
        """
        try:
            found = decode(self._read(sha256), Structure)
            damaged = sha256_of(found) != sha256
        except (OSError, pa.ArrowException) as error:
            raise CatalogError(self.path(sha256), f"cannot be read: {error}") from None
        except CatalogError:
            damaged = True
        if damaged:
            raise CatalogError(self.path(sha256), "is damaged", "", "delete it and add the structure again")
        return found

    def has(self, sha256: str) -> bool:
        """Whether the mesh is there."""
        if self._local:
            return Path(self.path(sha256)).exists()
        return bool(self._store().get_file_info(self._name(sha256)).type == pafs.FileType.File)

    def path(self, sha256: str) -> str:
        """Where a mesh lies."""
        return f"{self.folder}/{self._name(sha256)}"

    def _name(self, sha256: str) -> str:
        if not _HASH.fullmatch(sha256):
            raise CatalogError(f"mesh {sha256[:80]!r}", "is no hash", "64 hexadecimal digits")
        return f"{sha256}.parquet"

    def _write(self, sha256: str, content: bytes) -> None:
        if self._local:
            replace_file(Path(self.path(sha256)), content)
            return
        with self._store().open_output_stream(self._name(sha256)) as stream:  # appears whole when closed
            stream.write(content)

    def _read(self, sha256: str) -> bytes:
        if self._local:
            return Path(self.path(sha256)).read_bytes()
        with self._store().open_input_file(self._name(sha256)) as stream:
            return bytes(stream.read())

    def _store(self) -> pafs.FileSystem:
        """The object store; credentials and endpoint come from the environment."""
        if self._remote is None:
            store, root = pafs.FileSystem.from_uri(self.folder)
            self._remote = pafs.SubTreeFileSystem(root, store)
        return self._remote


def _bare(structure: Structure) -> Structure:
    return Structure("", "", structure.vertices, structure.triangles, structure.normals)
