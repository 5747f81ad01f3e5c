"""Normalised meshes, kept once per content: ``meshes/<sha256>.parquet`` in the catalog."""

from __future__ import annotations

import re

import pyarrow as pa

from upplied.catalog.schema.codec import decode, encode, sha256_of
from upplied.catalog.store.files import FileStore
from upplied.errors import CatalogError
from upplied.records import Structure

_HASH = re.compile(r"[0-9a-f]{64}")


class MeshStore:
    """The meshes of one catalog, content-addressed, never changed.

    Parameters
    ----------
    root : str
        Folder or object-store URI of the catalog.
    """

    def __init__(self, root: str) -> None:
        self.files = FileStore(f"{root.rstrip('/')}/meshes")

    def put(self, structure: Structure) -> str:
        """Keep the mesh of a structure; returns its hash."""
        bare = _bare(structure)
        sha256 = sha256_of(bare)
        try:
            if not self.files.has(file_name(sha256)):
                self.files.write(file_name(sha256), encode(bare))
        except (OSError, pa.ArrowException) as error:
            remedy = "free space, or ask for the right to write there; nothing was changed"
            raise CatalogError(self.path(sha256), f"cannot be written: {error}", "", remedy) from None
        return sha256

    def get(self, sha256: str) -> Structure:
        """A structure of that mesh, without name.

        Raises
        ------
        CatalogError
            If the mesh is not there, or is damaged.
        """
        try:
            return decode(self.files.read(file_name(sha256)), Structure, sha256)
        except (OSError, pa.ArrowException) as error:
            raise CatalogError(self.path(sha256), f"cannot be read: {error}") from None
        except CatalogError:
            remedy = "delete it and add the structure again"
            raise CatalogError(self.path(sha256), "is damaged", "", remedy) from None

    def path(self, sha256: str) -> str:
        """Where a mesh lies."""
        return self.files.path(file_name(sha256))


def file_name(sha256: str) -> str:
    """The name of the file of a mesh; what is no hash is refused."""
    if not _HASH.fullmatch(sha256):
        raise CatalogError(f"mesh {sha256[:80]!r}", "is no hash", "64 hexadecimal digits")
    return f"{sha256}.parquet"


def _bare(structure: Structure) -> Structure:
    return Structure("", "", structure.vertices, structure.triangles, structure.normals)
