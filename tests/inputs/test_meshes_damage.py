"""Damaged and malicious mesh files: a message each, no memory, no time, no file elsewhere."""

from __future__ import annotations

import itertools
import json
import struct
import tracemalloc
from pathlib import Path

import mesh_files
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.errors import InputError, UppliedError
from upplied.inputs.formats.reader import READERS, REFUSED, read_raw
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import normalise

MESHES = ["ply", "ply_ascii", "stl", "stl_ascii", "obj", "off", "glb", "gltf", "dae", "3mf"]
CLOUDS = ["pcd", "pcd_ascii", "las", "laz", "e57"]


@pytest.mark.parametrize("suffix", [*MESHES, *CLOUDS])
def test_empty_truncated_and_mislabelled_files_are_refused(tmp_path: Path, suffix: str) -> None:
    data = mesh_files.write(*mesh_files.shape(), suffix)
    cut = len(data) * 2 // 3
    for damaged in (b"", b"\0" * 200, b"<html><body>404</body></html>", data[:cut]):
        if suffix == "obj" and damaged == data[:cut]:
            continue  # a cut in a list of lines leaves no trace unless a face refers to what is gone
        with pytest.raises(InputError, match="file"):
            mesh_files.read(tmp_path, suffix, damaged)
    for other in READERS:
        if {other, suffix} <= {"glb", "gltf"} or other == suffix.removesuffix("_ascii"):
            continue
        with pytest.raises(InputError, match=f"file.{other}"):
            mesh_files.read(tmp_path, other, data)


def test_a_face_of_vertices_that_are_gone_is_no_partial_mesh(tmp_path: Path) -> None:
    for suffix in ("obj", "off", "ply_ascii"):
        text = mesh_files.write(*mesh_files.shape(), suffix).decode()
        broken = text.replace("15", "99")
        with pytest.raises(InputError):
            mesh_files.read(tmp_path, suffix, broken.encode())


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.step", b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));", "Tessellate"),
        ("a.stl", b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA (('IFC4'));\n", "IfcConvert"),
        ("a.ifc", b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC2X3'));", "IfcConvert"),
        ("a.fbx", b"Kaydara FBX Binary  \0", "GLB or OBJ"),
        ("a.ply", b"AC3Db\nMATERIAL", "AC"),
        ("a.e57", b"ASTM-E57\0\0", "PLY"),
        ("a.zip", b"PK\x03\x04rest", "Unpack"),
        ("a.xyz", b"1 2 3\n", "one of ply, stl"),
        ("a", b"ply\n", "one of ply, stl"),
        ("a.glb", struct.pack("<4sIIII", b"glTF", 1, 40, 20, 0) + b"{}" * 10, "gltf-pipeline"),
        ("a.gltf", b'{"asset": {"version": "1.0"}}', "gltf-pipeline"),
        (
            "a.gltf",
            b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}',
            "draco",
        ),
    ],
)
def test_other_formats_are_refused_with_what_to_do(
    tmp_path: Path, name: str, data: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_raw(tmp_path / name)
    assert all(REFUSED.values())


def test_missing_files_and_folders(tmp_path: Path) -> None:
    (tmp_path / "folder.ply").mkdir()
    for path in (tmp_path / "none.ply", tmp_path / "folder.ply"):
        with pytest.raises(InputError, match="cannot be read"):
            read_raw(path)


def peak_mb(function) -> float:
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            function()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


_HUGE = 2**31 - 1
_XYZ = "property float x\nproperty float y\nproperty float z\n"


def ply_bombs() -> dict[str, tuple[str, bytes]]:
    """Counts that no file of this size can hold."""
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {_HUGE}\n{_XYZ}end_header\n"
    lists = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint float x\nend_header\n"
    return {
        "ply vertices": ("ply", head.encode() + b"\0" * 1000),
        "ply list": ("ply", lists.encode() + b"\xff" * 50),
        "ply text": ("ply", head.replace("binary_little_endian", "ascii").encode() + b"1 2 3\n"),
    }


def header_bombs() -> dict[str, tuple[str, bytes]]:
    """The same in the other formats."""
    las = bytearray(mesh_files.las(np.zeros((4, 3))))
    las[107:111] = struct.pack("<I", _HUGE)
    packed = mesh_files.pcd_header(10**9, "binary_compressed") + struct.pack("<II", 10, 24 * 10**9 % 2**32)
    return {
        "stl": ("stl", b"\0" * 80 + struct.pack("<I", _HUGE) + b"\0" * 500),
        "off": ("off", f"OFF\n{_HUGE} {_HUGE} 0\n0 0 0\n".encode()),
        "las": ("las", bytes(las)),
        "pcd": ("pcd", mesh_files.pcd_header(10**12, "binary") + b"\0" * 99),
        "pcd compressed": ("pcd", packed + b"\0" * 10),
    }


def gltf_bombs() -> dict[str, tuple[str, bytes]]:
    """Nodes and accessors named again and again, a circle, deep nesting."""
    asset = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}]}
    twenty = [{"children": [i + 1] * 20} for i in range(20)]
    points = np.zeros((3000, 3), "<f4").tobytes()
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3000, "type": "VEC3"}
    copies = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(points)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "accessors": [accessor],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * 2000}],
    }
    nested = asset | {"nodes": [*twenty, {"mesh": 0}], "meshes": [{"primitives": []}]}
    counted = copies | {"accessors": [accessor | {"count": 2**40}]}
    return {
        "glb nodes": ("glb", mesh_files.glb(nested)),
        "glb circle": ("glb", mesh_files.glb(asset | {"nodes": [{"children": [0]}]})),
        "glb copies": ("glb", mesh_files.glb(copies, points)),
        "glb count": ("glb", mesh_files.glb(counted, points)),
        "json depth": ("gltf", b'{"asset":' * 30_000),
    }


def xml_bombs() -> dict[str, tuple[str, bytes]]:
    """Entities, external ones too, components within components, an archive of blanks."""
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in itertools.pairwise("abcdefghij"))
    laughs = f'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha">{entities}]>'
    outside = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    objects = '<object id="0"/>'
    for number in range(1, 20):
        twenty = f'<component objectid="{number - 1}"/>' * 20
        objects += f'<object id="{number}"><components>{twenty}</components></object>'
    nested = f'<model><resources>{objects}</resources><build><item objectid="19"/></build></model>'
    return {
        "3mf zip": ("3mf", mesh_files.zipped(b"<model>" + b" " * 100_000_000 + b"</model>")),
        "3mf components": ("3mf", mesh_files.zipped(nested.encode())),
        "3mf entities": ("3mf", mesh_files.zipped(f"{laughs}<model>&j;</model>".encode())),
        "dae entities": ("dae", f"{laughs}<COLLADA>&j;</COLLADA>".encode()),
        "dae external": ("dae", f"{outside}<COLLADA>&x;</COLLADA>".encode()),
    }


BOMBS = ply_bombs() | header_bombs() | gltf_bombs() | xml_bombs()


@pytest.mark.parametrize("name", BOMBS)
def test_small_files_cannot_make_the_reader_grow(tmp_path: Path, name: str) -> None:
    suffix, data = BOMBS[name]
    path = tmp_path / f"file.{suffix}"
    path.write_bytes(data)
    assert len(data) < 300_000
    assert peak_mb(lambda: read_raw(path)) < 400


@pytest.mark.parametrize(
    "uri", ["../secret.bin", "/etc/passwd", "file:///etc/passwd", "http://localhost/a", "..%2Fsecret.bin"]
)
def test_gltf_buffers_outside_the_folder_are_refused(tmp_path: Path, uri: str) -> None:
    (tmp_path / "secret.bin").write_bytes(b"\0" * 36)
    (tmp_path / "inside").mkdir()
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": uri}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    }
    path = tmp_path / "inside" / "a.gltf"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="outside its folder"):
        read_raw(path)
    document["buffers"][0]["uri"] = "b%20c.bin"
    path.write_text(json.dumps(document))
    (tmp_path / "inside" / "b c.bin").write_bytes(np.eye(3, dtype="<f4").tobytes())
    raw, before = read_raw(path)
    assert len(raw.triangles) == 1
    (tmp_path / "inside" / "b c.bin").write_bytes((2 * np.eye(3, dtype="<f4")).tobytes())
    assert read_raw(path)[1] != before  # the hash covers the buffer too


_SEEDS = {suffix: mesh_files.write(*mesh_files.shape(), suffix) for suffix in [*MESHES, *CLOUDS]}
_SEEDS["pcd_lzf"] = mesh_files.pcd_compressed(mesh_files.shape()[0])


@pytest.mark.parametrize("suffix", _SEEDS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damaged_files_raise_nothing_but_messages(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: st.DataObject
) -> None:
    content = bytearray(_SEEDS[suffix])
    for _ in range(data.draw(st.integers(0, 5))):
        at = data.draw(st.integers(0, len(content) - 1) | st.integers(0, min(400, len(content) - 1)))
        content[at : at + data.draw(st.integers(0, 8))] = data.draw(st.binary(max_size=8))
        if not content:
            break
    content = content[: data.draw(st.just(len(content)) | st.integers(0, len(content)))]
    path = tmp_path_factory.mktemp("f") / f"file.{suffix.partition('_')[0]}"
    path.write_bytes(bytes(content))
    entry = StructureEntry("a", "b", path, 1.0)
    try:
        structure, _ = normalise(entry, *read_raw(path))
    except UppliedError as error:
        assert "file" in str(error)
    else:
        assert np.isfinite(structure.vertices).all() and len(structure.vertices) >= 3
