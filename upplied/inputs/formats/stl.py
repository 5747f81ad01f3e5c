"""STL: triangles and nothing else, in binary or in text."""

from __future__ import annotations

import re

import numpy as np

from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.formats.text import numbers

_HEAD = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"vertex[ \t]+([^\r\n]*)")


def read_stl(source: Source) -> RawMesh:
    """The triangles of an STL file; its normals are left aside, the winding says the same."""
    return _text(source) if is_text(source.data) else _binary(source)


def is_text(data: bytes) -> bool:
    """Whether an STL is text: some binary ones start with `solid` as well."""
    return data[:80].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:512]


def _binary(source: Source) -> RawMesh:
    data = source.data
    count = int.from_bytes(data[80:_HEAD], "little")
    if len(data) < _HEAD + count * _FACET.itemsize:
        held = max(len(data) - _HEAD, 0) // _FACET.itemsize
        raise source.error(f"its header says {count} triangles, it holds {held}", "a complete file")
    facets = np.frombuffer(data, _FACET, count, _HEAD)
    spare = len(data) - _HEAD - count * _FACET.itemsize
    remarks = (f"{spare} bytes after the last triangle left aside",) if spare else ()
    return _soup(facets["corners"].astype(float).reshape(-1, 3), remarks)


def _text(source: Source) -> RawMesh:
    text = source.data.lower()
    if b"endsolid" not in text[text.rfind(b"endfacet") :]:
        raise source.error("ends before its last 'endsolid'", "a complete file")
    rows = _VERTEX.findall(text)
    facets = len(re.findall(rb"\bendfacet\b", text))
    try:
        corners = numbers(b"\n".join(rows))
    except ValueError:
        raise source.error("holds a vertex that is no three numbers", "vertex x y z") from None
    if len(rows) != 3 * facets or len(corners) != 3 * len(rows):
        raise source.error(f"has {len(rows)} vertices for {facets} facets", "three vertices per facet")
    return _soup(corners.reshape(-1, 3))


def _soup(corners: np.ndarray, remarks: tuple[str, ...] = ()) -> RawMesh:
    return RawMesh(corners, np.arange(len(corners)).reshape(-1, 3), remarks=remarks)
