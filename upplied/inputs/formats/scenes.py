"""Formats that trimesh reads; whatever it raises leaves as an InputError."""

from __future__ import annotations

import io

import numpy as np

from upplied.errors import InputError
from upplied.inputs.formats.raw import RawMesh


def read_scene(data: bytes, suffix: str, what: str) -> RawMesh:
    """A file read by trimesh, its scene flattened with the node transforms."""
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix, process=False)
        meshes = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
        counts = [len(mesh.vertices) for mesh in meshes]
        first = np.cumsum([0, *counts])
        triangles = [np.asarray(mesh.faces, np.int64) + at for mesh, at in zip(meshes, first, strict=False)]
        return RawMesh(
            vertices=np.concatenate(
                [np.asarray(mesh.vertices, float) for mesh in meshes] or [np.empty((0, 3))]
            ),
            triangles=np.concatenate(triangles or [np.empty((0, 3), np.int64)]),
            part=np.repeat(np.arange(len(meshes)), [len(faces) for faces in triangles]),
            part_names=tuple(str(mesh.metadata.get("name", "")) for mesh in meshes),
        )
    except Exception as error:
        detail = f"{type(error).__name__}: {str(error)[:160]}"
        raise InputError(
            what, f"cannot be read as {suffix}: {detail}", "a complete file", "export it again"
        ) from None
