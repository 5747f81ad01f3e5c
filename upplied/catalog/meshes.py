"""Normalised meshes, kept once per content: ``meshes/<sha256>.parquet`` in the catalog."""

from __future__ import annotations

import re
from pathlib import Path

from upplied.catalog.codec import decode, encode, sha256_of
from upplied.catalog.files import replace_file
from upplied.errors import CatalogError
from upplied.records import Structure

_HASH = re.compile(r"[0-9a-f]{64}")


class MeshStore:
    """The meshes of one catalog, content-addressed, never changed."""

    def __init__(self, root: str) -> None:
        self.folder = Path(root) / "meshes"

    def put(self, structure: Structure) -> str:
        """Keep the mesh of a structure; returns its hash."""
        bare = _bare(structure)
        name = sha256_of(bare)
        path = self.path(name)
        if not path.exists():
            try:
                replace_file(path, encode(bare))
            except OSError as error:
                raise CatalogError(
                    str(path), f"cannot be written: {error}", "", "free space or rights"
                ) from None
        return name

    def get(self, sha256: str) -> Structure:
        """A structure of that mesh, without name."""
        path = self.path(sha256)
        try:
            found = decode(path.read_bytes(), Structure)
        except OSError as error:
            raise CatalogError(
                f"mesh {sha256}", f"cannot be read: {error}", "", "verify the catalog"
            ) from None
        if sha256_of(found) != sha256:
            raise CatalogError(f"mesh {sha256}", "has other content than its name says", "", "add it again")
        return found

    def path(self, sha256: str) -> Path:
        """Where a mesh lies."""
        if not _HASH.fullmatch(sha256):
            raise CatalogError(f"mesh {sha256[:80]!r}", "is no hash", "64 hexadecimal digits")
        return self.folder / f"{sha256}.parquet"


def _bare(structure: Structure) -> Structure:
    return Structure("", "", structure.vertices, structure.triangles, structure.normals)
