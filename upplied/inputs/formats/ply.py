"""PLY: elements of declared properties, in text or binary of either byte order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.inputs.formats.polygons import triangulate
from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.formats.text import numbers, whole
from upplied.records import Floats, Ints

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_INDICES = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    length_type: str = ""  # of lists


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def has_lists(self) -> bool:
        return any(item.length_type for item in self.properties)

    @property
    def least_bytes(self) -> int:
        """Of one row, its lists empty."""
        return sum(int((item.length_type or item.type)[1]) for item in self.properties)


def read_ply(source: Source) -> RawMesh:
    """The faces of a PLY file, triangulated, or its points where it has no faces."""
    order, elements, at = _header(source)
    rows = _Text(source, at) if order == "ascii" else _Binary(source, at, _ORDER[order])
    vertices = normals = None
    corners, sizes = np.empty(0, np.int64), np.empty(0, np.int64)
    for element in elements:
        columns, lists = rows.read(element)
        if element.name == "vertex":
            vertices, normals = _xyz(source, columns, "xyz"), _normals(columns)
        elif element.name == "face":
            if not any(item.name in _INDICES and item.length_type for item in element.properties):
                raise source.error("its faces have no list 'vertex_indices'", "faces as lists of vertices")
            corners, sizes = lists
        elif element.name == "tristrips":
            raise source.error(
                "holds triangle strips", "faces as lists of vertices", "export it without strips"
            )
    if vertices is None:
        raise source.error("has no element 'vertex'", "vertices with x, y, z")
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise source.error("its faces refer to vertices that do not exist", f"0 to {len(vertices) - 1}")
    triangles, _ = triangulate(vertices, corners, sizes)
    split = int((sizes > 3).sum())
    remarks = (f"{split} polygons triangulated",) if split else ()
    return RawMesh(vertices, triangles, normals=None if len(sizes) else normals, remarks=remarks)


def _header(source: Source) -> tuple[str, list[_Element], int]:
    end = source.data.find(b"end_header", 0, 1 << 16)
    at = source.data.find(b"\n", end) + 1
    if end < 0 or not at:
        raise source.error("its header has no end", "end_header within 64 kB")
    order, elements = "", []
    try:
        for line in source.data[:end].decode("latin-1").splitlines()[1:]:
            words = line.split()
            if not words or words[0] in ("comment", "obj_info"):
                continue
            if words[0] == "format":
                order = words[1]
            elif words[0] == "element":
                elements.append(_Element(words[1], int(words[2]), []))
            elif words[0] == "property" and words[1] == "list":
                item = _Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
                elements[-1].properties.append(item)
            elif words[0] == "property":
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
            else:
                raise ValueError(line)
        if order not in _ORDER or any(element.count < 0 for element in elements):
            raise ValueError(order)
    except (ValueError, IndexError, KeyError):
        raise source.error(
            "its header cannot be understood", "a header as in the PLY specification"
        ) from None
    return order, elements, at


class _Binary:
    """Rows of a binary body, element after element."""

    def __init__(self, source: Source, at: int, order: str) -> None:
        self._source, self._at, self._order = source, at, order

    def read(self, element: _Element) -> tuple[dict[str, Floats], tuple[Ints, Ints]]:
        if element.count * element.least_bytes > len(self._source.data) - self._at:
            raise self._source.error(
                f"ends before its {element.count} {element.name} rows", "a complete file"
            )
        if not element.count or not element.properties:
            return {item.name: np.empty(0) for item in element.properties}, _no_lists()
        lengths = self._first_lengths(element)
        rows = self._uniform(element, lengths)
        if rows is None:
            return {}, self._walk(element)
        columns = {
            item.name: rows[f"p{i}"].astype(float)
            for i, item in enumerate(element.properties)
            if not item.length_type
        }
        for i, item in enumerate(element.properties):
            if item.name in _INDICES and item.length_type:
                lists = _indices(rows[f"p{i}"])
                return columns, (lists.reshape(-1), np.full(element.count, lists.shape[1]))
        return columns, _no_lists()

    def _first_lengths(self, element: _Element) -> list[int]:
        """Length of each list in the first row; those of most files are all alike."""
        at, lengths = self._at, []
        for item in element.properties:
            length = 0
            if item.length_type:
                length = self._number(at, item.length_type)
                at += int(item.length_type[1])
            lengths.append(length)
            at += int(item.type[1]) * (length if item.length_type else 1)
        return lengths

    def _uniform(self, element: _Element, lengths: list[int]) -> np.ndarray | None:
        """All rows at once where every list is as long as in the first row."""
        layout: list[tuple] = []
        size = 0
        for i, (item, length) in enumerate(zip(element.properties, lengths, strict=True)):
            kind = self._order + item.type
            if item.length_type:
                layout.append((f"n{i}", self._order + item.length_type))
                layout.append((f"p{i}", kind, (length,)))
                size += int(item.length_type[1]) + length * int(item.type[1])
            else:
                layout.append((f"p{i}", kind))
                size += int(item.type[1])
        if size * element.count > len(self._source.data) - self._at:
            return None
        rows = np.frombuffer(self._source.data, np.dtype(layout), element.count, self._at)
        for i, (item, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if item.length_type and (rows[f"n{i}"] != length).any():
                return None
        self._at += size * element.count
        return rows

    def _walk(self, element: _Element) -> tuple[Ints, Ints]:
        """Row after row, where lists differ in length."""
        wanted = next((i for i, item in enumerate(element.properties) if item.name in _INDICES), -1)
        chunks, sizes, at, end = [], [], self._at, len(self._source.data)
        for _ in range(element.count):
            for i, item in enumerate(element.properties):
                length = 1
                if item.length_type:
                    length = self._number(at, item.length_type)
                    at += int(item.length_type[1])
                stop = at + length * int(item.type[1])
                if length < 0 or stop > end:
                    raise self._source.error(f"ends within its {element.name} rows", "a complete file")
                if i == wanted:
                    chunks.append(self._source.data[at:stop])
                    sizes.append(length)
                at = stop
        self._at = at
        if wanted < 0:
            return _no_lists()
        kind = self._order + element.properties[wanted].type
        return _indices(np.frombuffer(b"".join(chunks), kind)), np.array(sizes, np.int64)

    def _number(self, at: int, kind: str) -> int:
        piece = self._source.data[at : at + int(kind[1])]
        if len(piece) < int(kind[1]):
            raise self._source.error("ends within a row", "a complete file")
        if kind[0] == "f":
            raise self._source.error("gives the length of a list as a float", "whole numbers")
        order = "big" if self._order == ">" else "little"
        return int.from_bytes(piece, order, signed=kind[0] == "i")  # type: ignore[arg-type]


class _Text:
    """Rows of a text body, element after element."""

    def __init__(self, source: Source, at: int) -> None:
        self._source, self._at = source, 0
        try:
            self._values = numbers(source.data[at:])
        except ValueError:
            raise source.error("holds something else than numbers after its header", "numbers") from None

    def read(self, element: _Element) -> tuple[dict[str, Floats], tuple[Ints, Ints]]:
        width = len(element.properties)
        left = self._values[self._at :]
        if element.count * width > len(left):
            raise self._source.error(
                f"ends before its {element.count} {element.name} rows", "a complete file"
            )
        if not element.has_lists:
            self._at += element.count * width
            rows = left[: element.count * width].reshape(element.count, width)
            return {item.name: rows[:, i] for i, item in enumerate(element.properties)}, _no_lists()
        return {}, self._lists(element, left)

    def _lists(self, element: _Element, left: Floats) -> tuple[Ints, Ints]:
        if len(element.properties) == 1 and element.count and (left[: element.count * 4 : 4] == 3).all():
            rows = left[: element.count * 4].reshape(-1, 4)  # triangles and nothing else, the usual case
            if len(rows) == element.count:
                self._at += rows.size
                return whole(rows[:, 1:]).reshape(-1), np.full(element.count, 3)
        wanted = next((i for i, item in enumerate(element.properties) if item.name in _INDICES), -1)
        chunks, sizes, at = [np.empty(0)], [], 0
        for _ in range(element.count):
            for i, item in enumerate(element.properties):
                length = 1
                if item.length_type:
                    length = int(left[at]) if at < len(left) and 0 <= left[at] < len(left) else -1
                    at += 1
                if length < 0 or at + length > len(left):
                    raise self._source.error(f"ends within its {element.name} rows", "a complete file")
                if i == wanted:
                    chunks.append(left[at : at + length])
                    sizes.append(length)
                at += length
        self._at += at
        return whole(np.concatenate(chunks)), np.array(sizes, np.int64)


def _indices(values: np.ndarray) -> Ints:
    return whole(values) if values.dtype.kind == "f" else values.astype(np.int64)


def _no_lists() -> tuple[Ints, Ints]:
    return np.empty(0, np.int64), np.empty(0, np.int64)


def _xyz(source: Source, columns: dict[str, Floats], names: str) -> Floats:
    try:
        return np.column_stack([columns[name] for name in names])
    except KeyError as missing:
        raise source.error(f"its vertices have no {missing}", "vertices with x, y, z") from None


def _normals(columns: dict[str, Floats]) -> Floats | None:
    names = ("nx", "ny", "nz")
    return np.column_stack([columns[name] for name in names]) if set(names) <= set(columns) else None
