"""Point clouds of surveyors: LAS and LAZ by laspy, E57 by pye57, PCD by Open3D; around them, counts."""

import io
import re
import struct
from typing import Any

import numpy as np

from upplied.extras import extra
from upplied.geometry.scene import open3d
from upplied.inputs.files import file_of, plain_xml
from upplied.inputs.raw import RawMesh, Source, numbers
from upplied.records import Floats

_CHUNK = 1_000_000  # points
_PACKED = (4.0, _CHUNK)  # points per byte, and at least, that a packed file may count: real ones stay below 1
_PCD = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)


def read_las(source: Source) -> RawMesh:
    """The points of a LAS 1.0 to 1.4 or LAZ file; in projected coordinates exact in double precision."""
    with extra("formats"):
        import laspy
        import lazrs  # noqa: F401 - laspy unpacks LAZ by it, and would say less well that it is missing

    data = source.data
    if len(data) < 227 or struct.unpack_from("<I", data, 100)[0] > len(data) // 54:
        raise source.error("ends before its header and its records do", "a complete LAS or LAZ")
    with laspy.open(io.BytesIO(data), read_evlrs=False) as reader:
        header, pieces = reader.header, []
        count, start, width = header.point_count, header.offset_to_point_data, header.point_format.size
        if header.are_points_compressed:
            source.most(count, "points", *_PACKED)
        else:
            end = header.start_of_first_evlr if header.number_of_evlrs else len(data)
            stored = max(end - start, 0) // width
            if stored != count and not (stored > count and not any(data[start + count * width : end])):
                raise source.error(f"says it has {count} points, it holds {stored}", "a complete LAS")
        for points in reader.chunk_iterator(_CHUNK):
            pieces.append(np.column_stack([points.X, points.Y, points.Z]) * header.scales + header.offsets)
    return _counted(source, np.concatenate([np.empty((0, 3)), *pieces]), count, up="z")


def read_e57(source: Source) -> RawMesh:
    """The points of all scans of an E57 file, each in the pose that the file says."""
    with extra("formats"):
        import pye57

    start, length, page = struct.unpack_from("<QQQ", source.data.ljust(48, b"\0"), 24)
    if not 64 <= page <= 1 << 20 or start >= len(source.data) or length > len(source.data):
        remedy = "export it again, or save it as PLY in double precision (e.g. with CloudCompare)"
        raise source.error("its header points beyond its end", "a complete E57", remedy)
    first, last = start // page, (start + length) // page + length // page + 2
    pages = [source.data[at * page : (at + 1) * page - 4] for at in range(first, last)]  # then a CRC
    root = plain_xml(b"".join(pages)[start % page :][:length])
    counts = [int(points.get("recordCount", "0")) for points in root.iter("points")]
    for count in (*counts, sum(counts)):
        source.most(count, "points", *_PACKED)
    pieces = [np.empty((0, 3))]
    with file_of(source.data, "e57") as path, pye57.E57(path) as file:
        if file.scan_count != len(counts):
            raise source.error(f"lists {len(counts)} scans, it holds {file.scan_count}", "a complete E57")
        for scan in range(len(counts)):
            read = file.read_scan(scan, ignore_missing_fields=True)
            pieces.append(np.column_stack([read[f"cartesian{axis}"] for axis in "XYZ"]))
    return RawMesh(np.concatenate(pieces), unit_m=1.0, up="z")  # metres by specification


def read_pcd(source: Source) -> RawMesh:
    """The points of a PCD file, double precision kept, and their normals where it has them."""
    if (data_line := _PCD.search(source.data, 0, 1 << 16)) is None:
        raise source.error("its header has no DATA line", "a complete PCD")
    lines = [line.split() for line in source.data[: data_line.start()].decode("latin-1").splitlines()]
    header = {words[0]: words[1:] for words in lines if words}
    try:
        names, kinds = header["FIELDS"], [kind.upper() for kind in header["TYPE"]]
        sizes = [int(word) for word in header["SIZE"]]
        counts = [int(word) for word in header.get("COUNT", ["1"] * len(names))]
        shape = header["POINTS"][:1] if "POINTS" in header else [header["WIDTH"][0], header["HEIGHT"][0]]
        number = int(np.prod([int(word) for word in shape], dtype=object))
        fits = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
        if not len(names) == len(kinds) == len(sizes) == len(counts) or min(*counts, number + 1) < 1:
            raise ValueError(names)
        if not {"x", "y", "z"} <= set(names) or not set(zip(kinds, sizes, strict=True)) <= fits:
            raise ValueError(kinds)
    except (KeyError, ValueError, IndexError):
        rule = "FIELDS with x y z, SIZE, TYPE, POINTS, DATA"
        raise source.error("its header cannot be understood", rule) from None
    body, mode, width = source.data[data_line.end() :], data_line[1].decode(), int(np.dot(sizes, counts))
    if mode == "ascii":
        stored = len(numbers(body)) / sum(counts)
    elif mode == "binary":
        stored = len(body) / width if any(body[number * width :]) else number
    elif mode == "binary_compressed":
        packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
        # LZF packs at most 264 bytes into three.
        stored = size / width if 8 + packed <= len(body) and size <= 88 * max(packed, 1) else 0
    else:
        raise source.error(f"its DATA is {mode[:40]!r}", "ascii, binary or binary_compressed")
    if stored < number or stored >= number + 1:
        raise source.error(f"says it has {number} points, it holds {int(stored)}", "a complete file")
    # Open3D is given the header that was understood here.
    columns: dict[str, list[Any]] = {"FIELDS": names, "SIZE": sizes, "TYPE": kinds, "COUNT": counts}
    lists = "".join(f"{key} {' '.join(map(str, words))}\n" for key, words in columns.items())
    text = f"VERSION 0.7\n{lists}WIDTH {number}\nHEIGHT 1\nPOINTS {number}\nDATA {mode}\n"
    with file_of(text.encode() + body, "pcd") as path:
        cloud = open3d().t.io.read_point_cloud(path).point  # its older call takes doubles for 0
    normals = cloud["normals"].numpy().astype(float) if "normals" in cloud else None
    points = cloud["positions"].numpy().astype(float) if "positions" in cloud else np.empty((0, 3))
    return _counted(source, points, number, normals=normals)


def _counted(source: Source, points: Floats, count: int, **more: Any) -> RawMesh:
    if len(points) != count:
        raise source.error(f"its {count} points are damaged: {len(points)} could be read", "a complete file")
    return RawMesh(points, **more)
