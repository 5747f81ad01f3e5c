"""OFF: a count line, vertices, faces as lists, in text.

Ours, not trimesh's: that one cuts every polygon as a fan, which covers a concave one wrongly.
"""

from __future__ import annotations

import re

import numpy as np

from upplied.inputs.formats.obj import first_three
from upplied.inputs.formats.text import integers
from upplied.inputs.raw import RawMesh, Source, counted

_KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b[ \t]*(BINARY)?", re.ASCII)


def read_off(source: Source) -> RawMesh:
    """The faces of an OFF file, triangulated."""
    keyword = _KEYWORD.match(source.data)
    if keyword is None or keyword[4] or keyword[5] or keyword[6]:
        raise source.error("is not OFF in text and three dimensions", "OFF, COFF, NOFF or STOFF in text")
    text = re.sub(rb"#[^\n]*", b"", source.data[keyword.end() :])
    lines = [line for line in text.splitlines() if line.strip()]
    try:
        n_vertices, n_faces = (int(word) for word in lines[0].split()[:2])
        if min(n_vertices, n_faces) < 0 or len(lines) != 1 + n_vertices + n_faces:
            held = f"it holds {len(lines) - 1} lines"
            found = f"its header says {n_vertices} vertices and {n_faces} faces, {held}"
            raise source.error(found, "a complete file, one vertex or face a line")
        vertices = first_three(source, b"\n".join([*lines[1 : 1 + n_vertices], b""]), "x y z")
        faces = [line.split() for line in lines[1 + n_vertices : 1 + n_vertices + n_faces]]
        sizes = np.array([int(words[0]) for words in faces], np.int64)
        listed = [words[1 : 1 + size] for words, size in zip(faces, sizes.tolist(), strict=True)]
        corners = integers(b" ".join(word for words in listed for word in words))
        if len(corners) != sizes.sum() or (sizes < 0).any():
            raise ValueError("a face is shorter than it says")
    except (ValueError, IndexError):
        rule = "numbers as OFF wants them"
        raise source.error("a line holds something else than its numbers", rule) from None
    triangles, _ = source.triangulated(vertices, corners, sizes)
    remarks = counted((int((sizes > 3).sum()), "polygons triangulated"))
    return RawMesh(vertices, triangles, remarks=remarks)
