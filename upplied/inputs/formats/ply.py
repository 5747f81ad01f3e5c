"""PLY in text or binary of either byte order, without a library (docs/making/libraries.md)."""

from typing import Any

import numpy as np
from numba import njit

from upplied.inputs.raw import RawMesh, Source, counted, numbers, whole
from upplied.records import Ints

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDER = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")
_Property = tuple[str, np.dtype, np.dtype | None]  # name, type, and of lists that of the length


def read_ply(source: Source) -> RawMesh:
    """The faces of a PLY file, triangulated, or its points where it has no faces."""
    elements, body = _header(source)
    vertices = normals = None
    corners, sizes = np.empty((2, 0), np.int64)
    for element, count, properties in elements:
        least = sum((length or kind).itemsize for _, kind, length in properties)
        if count * max(least, 1) > len(body):
            raise source.error(f"ends before its {count} {element} rows", "a complete file")
        names = [name for name, _, _ in properties]
        if not any(length for *_, length in properties):
            layout = np.dtype([(name, kind) for name, kind, _ in properties])
            rows: Any = np.frombuffer(body, layout, count) if names else np.empty(0)
            body = body[count * layout.itemsize :]
            if element == "vertex" and {"x", "y", "z"} <= set(names):
                vertices = np.column_stack([rows[axis].astype(float) for axis in "xyz"])
                if {"nx", "ny", "nz"} <= set(names):
                    normals = np.column_stack([rows[f"n{axis}"].astype(float) for axis in "xyz"])
            continue
        if element in ("vertex", "tristrips"):
            raise source.error(f"holds {element} rows as lists", "plain vertices, faces as lists")
        index = next((i for i, name in enumerate(names) if name in _INDICES), -1)
        if element == "face" and (index < 0 or properties[index][2] is None):
            raise source.error("its faces have no list 'vertex_indices'", "faces as lists of vertices")
        indices, lengths, used = _lists(source, body, element, count, properties, index)
        body = body[used:]
        if element == "face":
            corners, sizes = indices, lengths
    if vertices is None:
        raise source.error("has no element 'vertex' with x, y and z", "vertices with x, y, z")
    if any(body.tobytes().strip(b"\0 \t\r\n")):
        raise source.error(f"goes on for {len(body)} bytes after what its header counts", "a complete file")
    triangles = source.triangulated(vertices, corners, sizes)
    remarks = counted((int((sizes > 3).sum()), "polygons triangulated"))
    return RawMesh(vertices, triangles, normals=None if len(sizes) else normals, remarks=remarks)


def _header(source: Source) -> tuple[list[tuple[str, int, list[_Property]]], memoryview]:
    """The elements, and the body; a body of text as the numbers it holds, in double precision."""
    end = source.data.find(b"end_header", 0, 1 << 16)
    if end < 0 or not (at := source.data.find(b"\n", end) + 1):
        raise source.error("its header has no end", "end_header within 64 kB")
    form, elements = "", list[tuple[str, int, list[_Property]]]()
    try:
        for words in (line.split() for line in source.data[:end].decode("latin-1").splitlines()[1:]):
            match words:
                case [] | ["comment" | "obj_info", *_]:
                    continue
                case ["format", form, *_]:
                    continue
                case ["element", name, count]:
                    elements.append((name, int(count), []))
                case ["property", "list", length, kind, name]:
                    elements[-1][2].append((name, _kind(kind, form), _kind(length, form)))
                case ["property", kind, name]:
                    elements[-1][2].append((name, _kind(kind, form), None))
                case _:
                    raise ValueError(words)
        if form not in _ORDER or any(count < 0 for _, count, _ in elements):
            raise ValueError(form)
    except (ValueError, IndexError, KeyError):
        rule = "a header as in the PLY specification"
        raise source.error("its header cannot be understood", rule) from None
    if form != "ascii":
        return elements, memoryview(source.data)[at:]
    try:
        return elements, memoryview(numbers(source.data[at:]).tobytes())
    except ValueError:
        raise source.error("holds something else than numbers after its header", "numbers") from None


def _kind(name: str, form: str) -> np.dtype:
    return np.dtype("f8" if form == "ascii" and name in _TYPES else _ORDER[form] + _TYPES[name])


def _lists(
    source: Source, body: memoryview, element: str, count: int, properties: list[_Property], index: int
) -> tuple[Ints, Ints, int]:
    """The lists of one property, row after row, their lengths, and how many bytes all rows take."""
    counts = [length for *_, length in properties if length is not None]
    if any(length.kind == "f" and length.itemsize < 8 for length in counts):
        raise source.error("gives the length of a list as a float", "whole numbers")
    forms = [(length or np.dtype("V0"), kind) for _, kind, length in properties]  # V0: it is no list
    widths = np.array([(form.itemsize, "iuf".find(form.kind), kind.itemsize) for form, kind in forms])
    data, big = np.frombuffer(body, np.uint8), any(length.str[0] == ">" for length in counts)
    sizes, starts = np.zeros((2, count), np.int64)
    if (used := _walk(data, widths, index, big, sizes, starts)) < 0:
        raise source.error(f"ends within its {element} rows", "a complete file")
    if index < 0:
        return sizes[:0], sizes[:0], used
    kind = properties[index][1]
    values = _gathered(data, starts, sizes * kind.itemsize).view(kind)
    return whole(values) if kind.kind == "f" else values.astype(np.int64), sizes, used


@njit(cache=True)
def _walk(  # pragma: no cover - compiled
    data: np.ndarray, widths: np.ndarray, index: int, big: bool, sizes: np.ndarray, starts: np.ndarray
) -> int:
    """Length and start of the wanted list of each row; the end of all rows, or -1 where it lies beyond."""
    at = 0
    for row in range(len(sizes)):
        for i in range(len(widths)):
            size, form, width = widths[i]
            count = 1
            if size:
                if at + size > len(data):
                    return -1
                if form == 2:
                    value = data[at : at + 8].copy().view(np.float64)[0]
                    if not 0 <= value <= len(data) or value != np.floor(value):
                        return -1
                    count = int(value)
                else:
                    count = 0
                    for k in range(size):
                        count = (count << 8) | int(data[at + k if big else at + size - 1 - k])
                    if form == 0 and count >> (8 * size - 1):
                        return -1
                at += size
            if i == index:
                sizes[row], starts[row] = count, at
            if count * width > len(data) - at:
                return -1
            at += count * width
    return at


@njit(cache=True)
def _gathered(data: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:  # pragma: no cover
    pieces, at = np.empty(lengths.sum(), np.uint8), 0
    for start, length in zip(starts, lengths):  # noqa: B905 - numba knows no strict
        pieces[at : at + length] = data[start : start + length]
        at += length
    return pieces
