"""OFF: a count line, vertices, faces as lists, in text."""

from __future__ import annotations

import re

import numpy as np

from upplied.inputs.formats.polygons import triangulate
from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.formats.text import integers, numbers

_KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b[ \t]*(BINARY)?", re.ASCII)


def read_off(source: Source) -> RawMesh:
    """The faces of an OFF file, triangulated."""
    keyword = _KEYWORD.match(source.data)
    if keyword is None or keyword[4] or keyword[5] or keyword[6]:
        raise source.error("is not OFF in text and three dimensions", "OFF, COFF, NOFF or STOFF in text")
    text = re.sub(rb"#[^\n]*", b"", source.data[keyword.end() :])
    lines = [line for line in text.splitlines() if line.strip()]
    try:
        return _mesh(source, lines)
    except (ValueError, IndexError):
        raise source.error(
            "a line holds something else than its numbers", "numbers as OFF wants them"
        ) from None


def _mesh(source: Source, lines: list[bytes]) -> RawMesh:
    n_vertices, n_faces = (int(word) for word in lines[0].split()[:2])
    if min(n_vertices, n_faces) < 0 or len(lines) < 1 + n_vertices + n_faces:
        raise source.error(
            f"its header says {n_vertices} vertices and {n_faces} faces, it holds {len(lines) - 1} lines",
            "a complete file, one vertex or face a line",
        )
    rows = numbers(b"\n".join(lines[1 : 1 + n_vertices]))
    vertices = rows.reshape(n_vertices, -1)[:, :3] if n_vertices else np.empty((0, 3))
    faces = [line.split() for line in lines[1 + n_vertices : 1 + n_vertices + n_faces]]
    sizes = np.array([int(words[0]) for words in faces], np.int64)
    listed = [words[1 : 1 + size] for words, size in zip(faces, sizes.tolist(), strict=True)]
    corners = integers(b" ".join(word for words in listed for word in words))
    if len(corners) != sizes.sum() or (sizes < 0).any() or vertices.shape[1] != 3:
        raise ValueError("a face is shorter than it says")
    if len(corners) and not 0 <= corners.min() <= corners.max() < n_vertices:
        raise source.error("its faces refer to vertices that do not exist", f"0 to {n_vertices - 1}")
    triangles, _ = triangulate(vertices, corners, sizes)
    split = int((sizes > 3).sum())
    return RawMesh(vertices, triangles, remarks=(f"{split} polygons triangulated",) if split else ())
