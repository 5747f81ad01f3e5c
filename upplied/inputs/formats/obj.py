"""STL by trimesh, with the checks that it lacks; OBJ and OFF without it (docs/making/libraries.md)."""

import io
import re

import numpy as np

from upplied.inputs.raw import RawMesh, Source, counted, numbers, whole
from upplied.records import Floats, Ints

_REST = re.compile(rb"/[^\s]*")  # texture and normal indices
_LINE = rb"(?m)^%b(?![!-\xff])(.*)"
_SURFACES = (b"\ncurv", b"\nsurf", b"\ncstype")


def read_obj(source: Source) -> RawMesh:
    """The faces of an OBJ file, triangulated; its groups and objects become parts."""
    data = _plain(source)
    vertices = _first_three(source, _lines(data, b"v"), "v x y z")
    faces = [_REST.sub(b"", line) for line in _lines(data, b"f")]
    try:
        corners, sizes = whole(numbers(b" ".join(faces))), _widths(faces)
    except ValueError:
        raise source.error("holds a face that is no list of vertices", "f v1 v2 v3 ...") from None
    if len(corners) != sizes.sum() or (corners == 0).any():
        raise source.error("holds a face with a vertex 0", "vertices count from 1, or from -1 backwards")
    if (corners < 0).any():  # such an index counts back from the last vertex above its face
        of_vertices, of_faces = (
            [it.start() for it in re.finditer(_LINE % word, data)] for word in (b"v", b"f")
        )
        above = np.repeat(np.searchsorted(of_vertices, of_faces), sizes)
        corners = np.where(corners > 0, corners, 1 + above + corners)
    triangles = source.triangulated(vertices, corners - 1, sizes, 1)
    names = (line.decode("utf-8", "replace").strip()[:80] for line in _lines(data, b"[og]"))
    remarks = counted(
        (int((sizes > 3).sum()), "polygons triangulated"),
        (len(_lines(data, b"[lp]")), "lines and points left aside"),
        (int((sizes < 3).sum()), "faces of less than three corners left aside"),
    )
    return RawMesh(vertices, triangles, part_names=("", *names), remarks=remarks)


def _plain(source: Source) -> bytes:
    """The text of an OBJ, each statement on a line of its own that begins with its keyword."""
    data = source.data
    if b"\0" in data[:4096]:
        raise source.error("holds binary data", "OBJ is text")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = b"\n" + data.replace(b"\\\n", b" ")
    if data.count(b"#") > data.count(b"\n#"):  # comments behind something else
        data = re.sub(rb"#[^\n]*", b"", data)
    if b"\n " in data or b"\n\t" in data:
        data = re.sub(rb"\n[ \t]+", b"\n", data)
    if any(word in data for word in _SURFACES):
        raise source.error("holds free-form surfaces", "polygons", "tessellate it on export")
    return data


def _lines(data: bytes, keyword: bytes) -> list[bytes]:
    """What stands behind a keyword of one letter, of each line that begins with it."""
    return re.findall(_LINE % keyword, data)


def _widths(lines: list[bytes]) -> Ints:
    return np.array([len(line.split()) for line in lines], np.int64)


def _first_three(source: Source, lines: list[bytes], rule: str) -> Floats:
    try:
        counts, values = _widths(lines), numbers(b" ".join(lines))
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
            content = f"it holds {len(lines) - 1} lines"
            finding = f"its header says {n_vertices} vertices and {n_faces} faces, {content}"
            raise source.error(finding, "a complete file, one vertex or face a line")
        vertices = _first_three(source, lines[1 : 1 + n_vertices], "x y z")
        faces = [line.split() for line in lines[1 + n_vertices : 1 + n_vertices + n_faces]]
        sizes = np.array([int(words[0]) for words in faces], np.int64)
        listed = [words[1 : 1 + size] for words, size in zip(faces, sizes.tolist(), strict=True)]
        corners = whole(numbers(b" ".join(word for words in listed for word in words)))
        if len(corners) != sizes.sum() or (sizes < 0).any():
            raise ValueError("a face is shorter than it says")
    except (ValueError, IndexError):
        rule = "numbers as OFF wants them"
        raise source.error("a line holds something else than its numbers", rule) from None
    remarks = counted((int((sizes > 3).sum()), "polygons triangulated"))
    return RawMesh(vertices, source.triangulated(vertices, corners, sizes), remarks=remarks)


_HEAD, _FACET = 84, 50


def read_stl(source: Source) -> RawMesh:
    """The triangles of an STL file; its normals are left aside, the winding says the same."""
    from trimesh.exchange.stl import load_stl_binary

    if is_text_stl(source.data):
        return _text(source)
    count, body = int.from_bytes(source.data[80:_HEAD], "little"), source.data[_HEAD:]
    spare, facets = body[count * _FACET :], len(body) // _FACET
    if len(body) < count * _FACET or (len(spare) >= _FACET and any(spare)):
        raise source.error(f"its header says {count} triangles, it holds {facets}", "a complete file")
    loaded = load_stl_binary(io.BytesIO(source.data[: _HEAD + count * _FACET]))  # it takes no byte too many
    return _soup([loaded] if count else [], counted((len(spare), "bytes after the last triangle left aside")))


def _text(source: Source) -> RawMesh:
    """Of text. What trimesh leaves out in silence, after a damaged number, is missed by its count."""
    from trimesh.exchange.stl import load_stl_ascii

    text = source.data.lower().replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if b"endsolid" not in text[text.rfind(b"endfacet") :]:
        raise source.error("ends before its last 'endsolid'", "a complete file")
    facets, rows = len(re.findall(rb"\bendfacet\b", text)), len(re.findall(rb"\bvertex\b", text))
    loaded = load_stl_ascii(io.BytesIO(text))
    solids = list(loaded["geometry"].values()) if "geometry" in loaded else [loaded]
    good = sum(len(solid["vertices"]) for solid in solids)
    if not rows == good == 3 * facets:
        raise source.error(f"has {good} good vertices for {facets} facets", "three vertices per facet")
    return _soup(solids)


def _soup(solids: list[dict], remarks: tuple[str, ...] = ()) -> RawMesh:
    corners = np.concatenate([np.empty((0, 3)), *(solid["vertices"] for solid in solids)])
    return RawMesh(corners, np.arange(len(corners)).reshape(-1, 3), remarks=remarks)


def is_text_stl(data: bytes) -> bool:
    """Whether an STL is text: some binary ones start with `solid` as well."""
    return data[:80].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:512]
