"""Wavefront OBJ and OFF: vertices and faces in text. A material library is never opened.

Not by trimesh, which counts negative indices from the end of the file, and cuts concave polygons as fans.
"""

import re

import numpy as np

from upplied.inputs.raw import RawMesh, Source, counted, integers, numbers, widths
from upplied.records import Floats, Ints

_REST = re.compile(rb"/[^\s]*")  # texture and normal indices
_SURFACES = (b"\ncurv", b"\nsurf", b"\ncstype")


def read_obj(source: Source) -> RawMesh:
    """The faces of an OBJ file, triangulated; its groups and objects become parts."""
    lines = _Lines(source)
    at_vertices, at_faces, at_names = (lines.of(kind) for kind in ("v", "f", "og"))
    vertices = first_three(source, lines.text(at_vertices), "v x y z")
    text = _REST.sub(b"", lines.text(at_faces))
    try:
        corners, sizes = integers(text), widths(text)
    except ValueError:
        raise source.error("holds a face that is no list of vertices", "f v1 v2 v3 ...") from None
    if len(corners) != sizes.sum() or (corners == 0).any():
        raise source.error("holds a face with a vertex 0", "vertices count from 1, or from -1 backwards")
    # A negative index counts back from the last vertex above its face.
    above = np.repeat(np.searchsorted(at_vertices, at_faces), sizes)
    corners = np.where(corners > 0, corners - 1, above + corners)
    triangles = source.triangulated(vertices, corners, sizes, 1)
    names = lines.text(at_names).decode("utf-8", "replace").split("\n")[: len(at_names)]
    remarks = counted(
        (int((sizes > 3).sum()), "polygons triangulated"),
        (len(lines.of("lp")), "lines and points left aside"),
        (int((sizes < 3).sum()), "faces of less than three corners left aside"),
    )
    return RawMesh(vertices, triangles, part_names=("", *(it.strip()[:80] for it in names)), remarks=remarks)


class _Lines:
    """The lines of a text by their keyword, all at once."""

    def __init__(self, source: Source) -> None:
        data = source.data
        if b"\0" in data[:4096]:
            raise source.error("holds binary data", "OBJ is text")
        if b"\r" in data:
            data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        data = b"\n" + data.replace(b"\\\n", b" ") + b"\n\n"
        if data.count(b"#") > data.count(b"\n#"):  # comments behind something else
            data = re.sub(rb"#[^\n]*", b"", data)
        if b"\n " in data or b"\n\t" in data:
            data = re.sub(rb"\n[ \t]+", b"\n", data)
        if any(word in data for word in _SURFACES):
            raise source.error("holds free-form surfaces", "polygons", "tessellate it on export")
        self._bytes = np.frombuffer(data, np.uint8).copy()
        ends = np.flatnonzero(self._bytes == ord("\n"))
        self._starts = np.concatenate([[0], ends[:-1] + 1])
        self._lengths = np.diff(self._starts, append=len(self._bytes))
        first, second = self._bytes[self._starts[:-1]], self._bytes[self._starts[:-1] + 1]
        self._keyword = np.where((first > ord(" ")) & (second <= ord(" ")), first, 0)  # of one letter, else 0
        self._bytes[self._starts[:-1][self._keyword > 0]] = ord(" ")

    def of(self, letters: str) -> Ints:
        """Indices of the lines whose keyword is one of these letters."""
        return np.flatnonzero(np.isin(self._keyword, np.frombuffer(letters.encode(), np.uint8)))

    def text(self, which: Ints) -> bytes:
        """These lines, one after the other, without their keywords."""
        wanted = np.zeros(len(self._starts), bool)
        wanted[which] = True
        return self._bytes[np.repeat(wanted, self._lengths)].tobytes()


def first_three(source: Source, text: bytes, rule: str) -> Floats:
    """x y z of each line; weights, colours and normals may follow."""
    try:
        values, counts = numbers(text), widths(text)
    except ValueError:
        raise source.error("holds a vertex that is no three numbers", rule) from None
    if len(values) != counts.sum() or (counts < 3).any():
        raise source.error("holds a vertex that is no three numbers", rule)
    return values[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]


_KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b[ \t]*(BINARY)?", re.ASCII)


def read_off(source: Source) -> RawMesh:
    """The faces of an OFF file (a count line, vertices, faces as lists, in text), triangulated."""
    keyword = _KEYWORD.match(source.data)
    if keyword is None or keyword[4] or keyword[5] or keyword[6]:
        raise source.error("is not OFF in text and three dimensions", "OFF, COFF, NOFF or STOFF in text")
    text = re.sub(rb"#[^\n]*", b"", source.data[keyword.end() :])
    lines = [line for line in text.splitlines() if line.strip()]
    try:
        n_vertices, n_faces = (int(word) for word in lines[0].split()[:2])
        if min(n_vertices, n_faces) < 0 or len(lines) != 1 + n_vertices + n_faces:
            held = f"it holds {len(lines) - 1} lines"
            finding = f"its header says {n_vertices} vertices and {n_faces} faces, {held}"
            raise source.error(finding, "a complete file, one vertex or face a line")
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
    triangles = source.triangulated(vertices, corners, sizes)
    remarks = counted((int((sizes > 3).sum()), "polygons triangulated"))
    return RawMesh(vertices, triangles, remarks=remarks)
