"""STL: triangles and nothing else, in binary or in text, by trimesh; here, the checks that it lacks."""

from __future__ import annotations

import io
import re

import numpy as np

from upplied.inputs.raw import RawMesh, Source, counted

_HEAD, _FACET = 84, 50


def read_stl(source: Source) -> RawMesh:
    """The triangles of an STL file; its normals are left aside, the winding says the same."""
    from trimesh.exchange.stl import load_stl_binary

    if is_text_stl(source.data):
        return _text(source)
    count, body = int.from_bytes(source.data[80:_HEAD], "little"), source.data[_HEAD:]
    spare = body[count * _FACET :]
    if len(body) < count * _FACET or (len(spare) >= _FACET and any(spare)):
        held = len(body) // _FACET
        raise source.error(f"its header says {count} triangles, it holds {held}", "a complete file")
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
