"""LAS: point clouds of surveyors, integers with a scale and an offset."""

from __future__ import annotations

import struct

import numpy as np

from upplied.inputs.formats.raw import RawMesh, Source


def read_las(source: Source) -> RawMesh:
    """The points of a LAS 1.0 to 1.4 file; in projected coordinates they are exact in double precision."""
    data = source.data
    if len(data) < 227:
        raise source.error(f"has {len(data)} bytes, less than its header", "a complete LAS")
    start, form, length, count = struct.unpack_from("<I4xBHI", data, 96)
    if form & 0xC0:
        raise source.error("is compressed (LAZ)", "LAS", "unpack it, e.g. `laszip -i in.laz -o out.las`")
    if (data[24], data[25]) >= (1, 4) and len(data) >= 255:
        count = struct.unpack_from("<Q", data, 247)[0] or count
    if length < 12 or start < 227 or start + count * length > len(data):
        raise source.error(f"ends before its {count} points", "a complete LAS")
    numbers = np.ndarray((count, 3), "<i4", data, start, (length, 4)) if count else np.empty((0, 3), "<i4")
    scale, offset = np.array(struct.unpack_from("<6d", data, 131)).reshape(2, 3)
    return RawMesh(numbers * scale + offset, unit_m=None, up="z")
