"""Wavefront OBJ: vertices and faces in text. Its material library is never opened."""

from __future__ import annotations

import re

import numpy as np

from upplied.inputs.formats.polygons import triangulate
from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.formats.text import integers, numbers
from upplied.records import Floats, Ints

_REST = re.compile(rb"/[^\s]*")  # texture and normal indices
_SURFACES = (b"curv", b"curv2", b"surf", b"cstype")


def read_obj(source: Source) -> RawMesh:
    """The faces of an OBJ file, triangulated; its groups and objects become parts."""
    if b"\0" in source.data[:4096]:
        raise source.error("holds binary data", "OBJ is text")
    data = source.data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    lines = [line.strip() for line in data.splitlines()]
    kinds = [line.split(None, 1)[0] if line else b"" for line in lines]
    if any(kind in _SURFACES for kind in kinds):
        raise source.error("holds free-form surfaces", "polygons", "tessellate it on export")
    rows = {kind: [i for i, have in enumerate(kinds) if have == kind] for kind in (b"v", b"f", b"l", b"p")}
    vertices = _vertices(source, [lines[i][1:] for i in rows[b"v"]])
    corners, sizes = _faces(source, lines, rows[b"f"], rows[b"v"])
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise source.error("its faces refer to vertices that do not exist", f"1 to {len(vertices)}")
    triangles, polygon = triangulate(vertices, corners, sizes)
    starts = [i for i, kind in enumerate(kinds) if kind in (b"o", b"g")]
    names = ("", *(lines[i][1:].strip().decode("utf-8", "replace")[:80] for i in starts))
    return RawMesh(
        vertices,
        triangles,
        part=np.searchsorted(starts, np.array(rows[b"f"], np.int64)[polygon]),
        part_names=names,
        remarks=_remarks(sizes, len(rows[b"l"]) + len(rows[b"p"])),
    )


def _vertices(source: Source, rows: list[bytes]) -> Floats:
    """x y z of each row; weights and colours may follow."""
    try:
        values = numbers(b"\n".join(rows))
        if rows and len(values) % len(rows) == 0 and len(values) >= 3 * len(rows):
            width = len(values) // len(rows)
            if all(len(row.split()) == width for row in rows[:: max(1, len(rows) // 100)]):
                return values.reshape(len(rows), width)[:, :3]
        return np.array([[float(word) for word in row.split()[:3]] for row in rows], float).reshape(-1, 3)
    except ValueError:
        raise source.error("holds a vertex that is no three numbers", "v x y z") from None


def _faces(source: Source, lines: list[bytes], faces: list[int], vertices: list[int]) -> tuple[Ints, Ints]:
    """Vertex indices from 0 and the number of corners of each face."""
    try:
        words = [_REST.sub(b"", lines[i][1:]) for i in faces]
        sizes = np.array([len(row.split()) for row in words], np.int64)
        corners = integers(b"\n".join(words))
    except ValueError:
        raise source.error("holds a face that is no list of vertices", "f v1 v2 v3 ...") from None
    if len(corners) != sizes.sum() or (corners == 0).any():
        raise source.error("holds a face with a vertex 0", "vertices count from 1, or from -1 backwards")
    # A negative index counts back from the last vertex above its face.
    above = np.repeat(np.searchsorted(vertices, faces), sizes)
    return np.where(corners > 0, corners - 1, above + corners), sizes


def _remarks(sizes: Ints, lines: int) -> tuple[str, ...]:
    split, short = int((sizes > 3).sum()), int((sizes < 3).sum())
    found = [
        (split, "polygons triangulated"),
        (lines, "lines and points left aside"),
        (short, "faces of less than three corners left aside"),
    ]
    return tuple(f"{count} {what}" for count, what in found if count)
