"""PCD: point clouds of the Point Cloud Library, in text, binary or compressed binary."""

from __future__ import annotations

import re

import numpy as np
from numba import njit

from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.formats.text import numbers
from upplied.records import Floats

_DATA = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
_NORMALS = ("normal_x", "normal_y", "normal_z")


def read_pcd(source: Source) -> RawMesh:
    """The points of a PCD file, double precision kept, and their normals where it has them."""
    found = _DATA.search(source.data, 0, 1 << 16)
    if found is None:
        raise source.error("its header has no DATA line", "a complete PCD")
    header = {
        words[0]: words[1:]
        for words in (line.split() for line in source.data[: found.start()].decode("latin-1").splitlines())
        if words
    }
    try:
        names = header["FIELDS"]
        counts = [int(word) for word in header.get("COUNT", ["1"] * len(names))]
        kinds = [f"<{kind.lower()}{size}" for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
        layout = np.dtype(
            [(f"{i}", kind, (n,)) for i, (kind, n) in enumerate(zip(kinds, counts, strict=True))]
        )
        number = (
            int(header["POINTS"][0])
            if "POINTS" in header
            else int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
        )
        if len(names) != len(counts) or min(*counts, number, layout.itemsize - 1) < 0:
            raise ValueError(names)
        body = source.data[found.end() :]
        columns = _columns(source, found[1].decode(), body, layout, number)
        where = {name: i for i, name in enumerate(names)}
        points = np.column_stack([columns[where[name]] for name in "xyz"])
    except (KeyError, ValueError, TypeError, IndexError, SyntaxError):
        raise source.error(
            "its header cannot be understood", "FIELDS with x y z, SIZE, TYPE, POINTS, DATA"
        ) from None
    normals = np.column_stack([columns[where[n]] for n in _NORMALS]) if set(_NORMALS) <= set(where) else None
    return RawMesh(points, normals=normals)


def _columns(source: Source, mode: str, body: bytes, layout: np.dtype, number: int) -> list[Floats]:
    """The first value of each field, all points."""
    widths = [layout[name].shape[0] for name in layout.names or ()]
    if mode == "ascii":
        values = numbers(body)
        if len(values) < number * sum(widths):
            raise _short(source, number)
        rows = values[: number * sum(widths)].reshape(number, sum(widths))
        return [rows[:, sum(widths[:i])] for i in range(len(widths))]
    if mode == "binary":
        if len(body) < number * layout.itemsize:
            raise _short(source, number)
        table = np.frombuffer(body, layout, number)
        return [table[name][:, 0].astype(float) for name in layout.names or ()]
    if mode != "binary_compressed":
        raise source.error(f"its DATA is {mode[:40]!r}", "ascii, binary or binary_compressed")
    packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    # LZF packs at most 264 bytes into three.
    if len(body) < 8 + packed or size != number * layout.itemsize or size > 88 * max(packed, 1):
        raise _short(source, number)
    plain = np.zeros(size, np.uint8)
    if _unpack(np.frombuffer(body, np.uint8, packed, 8), plain) != size:
        raise source.error("its compressed points are damaged", "a complete file")
    columns, at = [], 0
    for i, width in enumerate(widths):
        field = np.frombuffer(plain, layout[i].base, number * width, at)
        columns.append(field[::width].astype(float))  # field after field, the values of a point together
        at += field.nbytes
    return columns


def _short(source: Source, number: int) -> Exception:
    return source.error(f"ends before its {number} points", "a complete file")


@njit(cache=True)
def _unpack(packed: np.ndarray, plain: np.ndarray) -> int:  # pragma: no cover - compiled
    """LZF: literal runs and references back; the number of bytes unpacked, -1 where it is damaged."""
    i = o = 0
    while i < len(packed):
        control = int(packed[i])
        i += 1
        if control < 32:
            run = control + 1
            if i + run > len(packed) or o + run > len(plain):
                return -1
            plain[o : o + run] = packed[i : i + run]
            i += run
            o += run
            continue
        length = control >> 5
        if length == 7:
            if i >= len(packed):
                return -1
            length += int(packed[i])
            i += 1
        if i >= len(packed):
            return -1
        back = o - ((control & 31) << 8) - int(packed[i]) - 1
        i += 1
        if back < 0 or o + length + 2 > len(plain):
            return -1
        for step in range(length + 2):
            plain[o + step] = plain[back + step]
        o += length + 2
    return o
