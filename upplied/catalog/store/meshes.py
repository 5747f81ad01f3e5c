"""Normalised meshes, kept once per content: ``meshes/<sha256>.parquet`` in the catalog."""

from __future__ import annotations

from upplied.catalog.store.contents import ContentStore
from upplied.records import Structure


class MeshStore(ContentStore[Structure]):
    """The meshes of one catalog, content-addressed, never changed.

    Parameters
    ----------
    root : str
        Folder or object-store URI of the catalog.
    """

    def __init__(self, root: str) -> None:
        super().__init__(root, "meshes", Structure, "delete it and add the structure again")

    def put(self, structure: Structure) -> str:
        """Keep the mesh of a structure, without its name; returns its hash."""
        return super().put(Structure("", "", structure.vertices, structure.triangles, structure.normals))
