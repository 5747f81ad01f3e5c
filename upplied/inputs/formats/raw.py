"""What a mesh file holds, before anything is converted or repaired, and how scenes are flattened."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from upplied.errors import InputError
from upplied.records import Floats, Ints, Record

MAX_BYTES = 2 << 30
_NO_POINTS = np.empty((0, 3))
_NO_TRIANGLES = np.empty((0, 3), np.int64)


@dataclass(frozen=True, eq=False, repr=False)
class RawMesh(Record):
    """Vertices and triangles as in the file: its units, its axes, scenes flattened."""

    vertices: Floats  # (V, 3) units of the file
    triangles: Ints = field(default_factory=lambda: _NO_TRIANGLES)  # (T, 3); (0, 3) for a point cloud
    normals: Floats | None = None  # (V, 3) as given, for point clouds
    part: Ints | None = None  # (T,) index into part_names
    part_names: tuple[str, ...] = ()
    unit_m: float | None = None  # what the file declares; None where it does not
    up: str = ""  # axis that the file declares to be up; empty where it does not
    remarks: tuple[str, ...] = ()  # what was triangulated or skipped, in words


class Source:
    """The bytes of one file, and of those in its folder that it refers to."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.data = _bytes(self.path, str(path))
        self._hash = hashlib.sha256(self.data)

    @property
    def sha256(self) -> str:
        """Of all bytes that were read."""
        return self._hash.hexdigest()

    def sibling(self, uri: str) -> bytes:
        """The bytes of a file in the same folder; nothing else is opened."""
        folder = self.path.parent.resolve()
        name = unquote(uri)
        if "://" in name or "\0" in name or not (folder / name).resolve().is_relative_to(folder):
            raise self.error(
                f"refers to {name[:120]!r}, outside its folder",
                "buffers in the file itself or in its folder",
                "export it as one file (.glb)",
            )
        data = _bytes(folder / name, f"{self.path}, its buffer {name[:120]!r}")
        self._hash.update(data)
        return data

    def error(self, found: str, rule: str = "", remedy: str = "export the file again") -> InputError:
        """An error about this file."""
        return InputError(str(self.path), found, rule, remedy)


class Assembly:
    """The pieces of a scene, put together with the transforms of their nodes.

    A few bytes can place one piece a million times (nested instances), so the total is bounded by
    the size of the file.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._left = max(1_000_000, len(source.data) // 4)
        self._vertices: list[Floats] = []
        self._triangles: list[Ints] = []
        self._names: list[str] = []
        self._count = 0

    def add(self, vertices: Floats, triangles: Ints, matrix: Floats, name: str) -> None:
        """One piece, placed by a matrix (4, 4); a mirroring one turns the winding."""
        self._left -= 1 + max(len(triangles), len(vertices) // 3)
        if self._left < 0:
            raise self._source.error(
                "places its parts so often that it grows out of all proportion",
                "at most a million triangles, or one per four bytes of the file",
                "export it flattened",
            )
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise self._source.error(
                f"part {name[:60]!r}: triangles refer to vertices that do not exist",
                f"indices from 0 to {len(vertices) - 1}",
            )
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        self._vertices.append(vertices @ matrix[:3, :3].T + matrix[:3, 3])
        self._triangles.append(np.asarray(triangles, np.int64) + self._count)
        self._names.append(name)
        self._count += len(vertices)

    def mesh(self, **declared: Any) -> RawMesh:
        """All pieces as one mesh, each a part of its own."""
        sizes = [len(triangles) for triangles in self._triangles]
        return RawMesh(
            vertices=np.concatenate([_NO_POINTS, *self._vertices]),
            triangles=np.concatenate([_NO_TRIANGLES, *self._triangles]),
            part=np.repeat(np.arange(len(sizes)), sizes),
            part_names=tuple(self._names),
            **declared,
        )


def _bytes(path: Path, what: str) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(what, f"is larger than {MAX_BYTES >> 30} GB", "", "decimate the mesh")
        return path.read_bytes()
    except OSError as error:
        raise InputError(what, f"cannot be read: {error.strerror or error}", "", "check the path") from None
    except ValueError as error:
        raise InputError(what, f"is no path: {error}") from None
