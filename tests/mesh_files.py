"""Mesh files of every format, written by trimesh or by hand, for the tests of their readers."""

from __future__ import annotations

import io
import json
import struct
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import trimesh

from upplied.inputs.formats.reader import read_raw
from upplied.inputs.raw import RawMesh
from upplied.records import Floats, Ints


def shape() -> tuple[Floats, Ints]:
    """An L of two boxes of different size: no symmetry hides a swapped or mirrored axis."""
    parts = [trimesh.creation.box((4.0, 2.0, 1.0)), trimesh.creation.box((1.0, 1.0, 3.0))]
    parts[1].apply_translation((1.5, 0.25, 2.0))
    both = trimesh.util.concatenate(parts)
    return np.asarray(both.vertices, float), np.asarray(both.faces, np.int64)


def write(vertices: Floats, triangles: Ints, suffix: str) -> bytes:
    """The bytes of a file: a suffix, or `stl_ascii`, `ply_ascii`, `pcd_ascii`, `gltf` for a variant."""
    clouds = {"pcd": pcd, "pcd_ascii": pcd_ascii, "las": las, "laz": laz, "e57": e57}
    if suffix in clouds:
        return clouds[suffix](vertices)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if suffix == "dae":
        return trimesh.exchange.dae.export_collada(mesh)
    if suffix == "gltf":
        return embedded(trimesh.Scene(mesh))
    if suffix == "ply_ascii":
        content = mesh.export(file_type="ply", encoding="ascii")
    elif suffix in ("glb", "3mf"):
        content = trimesh.Scene(mesh).export(file_type=suffix)
    else:
        content = mesh.export(file_type=suffix)
    return content if isinstance(content, bytes) else content.encode()


def embedded(scene: trimesh.Scene) -> bytes:
    """A .gltf with its buffers as data URIs."""
    import base64

    files = scene.export(file_type="gltf")
    document = json.loads(files["model.gltf"])
    for buffer in document["buffers"]:
        data = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = f"data:application/octet-stream;base64,{data}"
    return json.dumps(document).encode()


def pcd(points: Floats) -> bytes:
    """Binary, double precision."""
    return pcd_header(len(points), "binary") + np.asarray(points, "<f8").tobytes()


def pcd_ascii(points: Floats) -> bytes:
    """Text, double precision."""
    rows = "\n".join(" ".join(repr(float(x)) for x in row) for row in points)
    return pcd_header(len(points), "ascii") + rows.encode() + b"\n"


def pcd_compressed(points: Floats) -> bytes:
    """LZF of literal runs and references of one repeated byte."""
    plain = np.asarray(points, "<f8").T.tobytes()
    packed = bytearray()
    at = 0
    while at < len(plain):
        run = 1
        while at + run < len(plain) and plain[at + run] == plain[at] and run < 200:
            run += 1
        if run > 12:
            packed += bytes([0, plain[at]])  # one literal, then a reference to the byte just written
            packed += bytes([7 << 5, run - 1 - 9, 0])
            at += run
            continue
        literal = plain[at : at + min(32, len(plain) - at)]
        packed += bytes([len(literal) - 1]) + literal
        at += len(literal)
    sizes = struct.pack("<II", len(packed), len(plain))
    return pcd_header(len(points), "binary_compressed") + sizes + bytes(packed)


def pcd_header(count: int, mode: str) -> bytes:
    """The header of a PCD of x y z in double precision."""
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {mode}\n"
    ).encode()


def e57(points: Floats) -> bytes:
    """Two scans by pye57: all points about the first, which its pose puts back, and the first three again."""
    import pye57

    near = np.asarray(points, float) - points[0]
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/a.e57"
        with pye57.E57(path, mode="w") as file:
            for count in (len(near), 3):
                columns = {f"cartesian{axis}": near[:count, i].copy() for i, axis in enumerate("XYZ")}
                file.write_scan_raw(columns, rotation=np.array([1.0, 0, 0, 0]), translation=points[0])
        return Path(path).read_bytes()


def laz(points: Floats) -> bytes:
    """LAS 1.2 packed by lazrs."""
    return las(points, packed=True)


def las(points: Floats, scale: float = 1e-4, packed: bool = False) -> bytes:
    """LAS 1.2 by laspy, with an offset at the first point."""
    import laspy

    header = laspy.LasHeader(version="1.2", point_format=0)
    header.offsets, header.scales = np.floor(points[0]), np.full(3, scale)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = np.asarray(points).T
    file = io.BytesIO()
    cloud.write(file, do_compress=packed)
    return file.getvalue()


def glb(document: dict, binary: bytes = b"") -> bytes:
    """A GLB of a JSON document and one binary chunk."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def read(folder: Path, suffix: str, data: bytes) -> RawMesh:
    """What the reader makes of these bytes in a file of that suffix."""
    path = folder / f"file.{suffix.removesuffix('_ascii')}"
    path.write_bytes(data)
    return read_raw(path)[0]


def zipped(model: bytes) -> bytes:
    """A 3MF of one model part."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return file.getvalue()
