"""The guard around every reader: special files, counts that do not agree, polygons out of proportion."""

from __future__ import annotations

import io
import os
import re
import struct
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import mesh_files
import numpy as np
import pytest

from upplied.errors import InputError
from upplied.inputs.formats.reader import read_raw
from upplied.inputs.manifests import StructureEntry, read_manifest
from upplied.inputs.meshes import fingerprint, read_structure


def ends_in(seconds: float, call: Callable[[], object]) -> BaseException | None:
    """What a call raised; fails where it still runs after so long."""
    raised: list[BaseException | None] = [None]

    def run() -> None:
        try:
            call()
        except BaseException as error:
            raised[0] = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    assert not thread.is_alive(), "it hangs"
    return raised[0]


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "gltf", "laz", "e57", "pcd"])
@pytest.mark.parametrize("kind", ["fifo", "device", "folder", "link to a device"])
def test_pipes_devices_and_folders_are_refused_and_not_waited_for(
    tmp_path: Path, suffix: str, kind: str
) -> None:
    path = tmp_path / f"file.{suffix}"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero" if kind == "device" else "/dev/stdin")
    raised = ends_in(20, lambda: read_raw(path))
    assert isinstance(raised, InputError) and "cannot be read" in str(raised)
    entry = StructureEntry("a", "b", path, 1.0)
    assert isinstance(ends_in(20, lambda: read_structure(entry)), InputError)
    assert isinstance(ends_in(20, lambda: fingerprint(entry)), OSError)


def test_a_pipe_for_a_buffer_or_a_manifest_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "b.bin")
    os.mkfifo(tmp_path / "structures.toml")
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}, "buffers": [{"uri": "b.bin"}]}')
    for call in (
        lambda: read_raw(tmp_path / "a.gltf"),
        lambda: read_manifest(tmp_path / "structures.toml"),
    ):
        raised = ends_in(20, call)
        assert isinstance(raised, InputError) and "regular file" in str(raised)


def fewer(suffix: str) -> bytes:
    """A file of 24 triangles (16 vertices) whose counts say 6."""
    data = mesh_files.write(*mesh_files.shape(), suffix)
    if suffix == "ply":
        return data.replace(b"element face 24", b"element face 6")
    if suffix == "ply_ascii":
        return data.replace(b"element face 24", b"element face 6")
    if suffix == "stl":
        return data[:80] + struct.pack("<I", 6) + data[84:]
    if suffix == "off":
        return data.replace(b"16 24 0", b"16 6 0")
    if suffix == "dae":
        return re.sub(rb'(<triangles[^>]*count=)"24"', rb'\1"6"', data)
    if suffix == "gltf":
        return data.replace(b'"count": 72', b'"count": 18')
    if suffix == "las":
        return data[:107] + struct.pack("<I", 6) + data[111:]
    return data.replace(b"POINTS 16", b"POINTS 6").replace(b"WIDTH 16", b"WIDTH 6")


@pytest.mark.parametrize(
    "suffix", ["ply", "ply_ascii", "stl", "off", "dae", "gltf", "las", "pcd", "pcd_ascii"]
)
def test_a_header_that_counts_fewer_than_there_are_is_refused(tmp_path: Path, suffix: str) -> None:
    data = fewer(suffix)
    assert data != mesh_files.write(*mesh_files.shape(), suffix)
    with pytest.raises(InputError, match="file"):
        mesh_files.read(tmp_path, suffix, data)


def test_padding_after_the_last_triangle_is_no_damage(tmp_path: Path) -> None:
    for suffix, padding in (("stl", b"\0" * 512), ("stl", b"\n"), ("ply", b"\n"), ("pcd", b"\0" * 100)):
        data = mesh_files.write(*mesh_files.shape(), suffix)
        whole, padded = (mesh_files.read(tmp_path, suffix, data + more) for more in (b"", padding))
        assert np.array_equal(whole.vertices, padded.vertices)
        assert np.array_equal(whole.triangles, padded.triangles)


def ring(corners: int, wave: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius = 5 + wave * np.cos(np.arange(corners) * np.pi)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(corners)])


def polygon(suffix: str, points: np.ndarray) -> bytes:
    rows = "\n".join(f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist())
    index = " ".join(map(str, range(len(points))))
    if suffix == "obj":
        faces = " ".join(map(str, range(1, len(points) + 1)))
        return ("v " + rows.replace("\n", "\nv ") + f"\nf {faces}\n").encode()
    if suffix == "off":
        return f"OFF\n{len(points)} 1 0\n{rows}\n{len(points)} {index}\n".encode()
    vertex = "property double x\nproperty double y\nproperty double z\n"
    head = f"ply\nformat {{}} 1.0\nelement vertex {len(points)}\n{vertex}element face 1\n"
    head += "property list int int vertex_indices\nend_header\n"
    if suffix == "ply_ascii":
        return head.format("ascii").encode() + f"{rows}\n{len(points)} {index}\n".encode()
    body = points.astype("<f8").tobytes() + struct.pack("<i", len(points))
    body += np.arange(len(points), dtype="<i4").tobytes()
    return head.format("binary_little_endian").encode() + body


@pytest.mark.parametrize("suffix", ["ply", "ply_ascii", "obj", "off"])
def test_a_polygon_of_too_many_corners_is_refused_before_anybody_cuts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    """Cutting costs the square of the corners."""
    monkeypatch.setattr("upplied.inputs.raw.triangulate", None)
    path = tmp_path / f"file.{suffix.removesuffix('_ascii')}"
    path.write_bytes(polygon(suffix, ring(10_001, 0.5)))
    with pytest.raises(InputError, match="10001 corners"):
        read_raw(path)


@pytest.mark.parametrize("suffix", ["ply", "ply_ascii", "obj", "off"])
def test_a_concave_polygon_of_many_corners_keeps_its_area(tmp_path: Path, suffix: str) -> None:
    points = ring(4000, 0.5)
    raw = mesh_files.read(tmp_path, suffix, polygon(suffix, points))
    a, b, c = (raw.vertices[raw.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    expected = np.cross(points, np.roll(points, -1, axis=0))[:, 2].sum() / 2
    assert (area > -1e-9).all() and area.sum() == pytest.approx(expected, rel=1e-9)


def test_packed_points_cannot_count_more_than_their_bytes_may_hold(tmp_path: Path) -> None:
    data = bytearray(mesh_files.laz(np.random.default_rng(0).random((50, 3))))
    data[107:111] = struct.pack("<I", 2**31)
    with pytest.raises(InputError, match="2147483648 points"):
        mesh_files.read(tmp_path, "laz", bytes(data))
    text = mesh_files.e57(np.random.default_rng(0).random((50, 3)))
    counted = text.replace(b'recordCount="50"', b'recordCount="9999999999"', 1)
    with pytest.raises(InputError):
        mesh_files.read(tmp_path, "e57", counted)


def test_doctype_in_an_e57_is_refused(tmp_path: Path) -> None:
    data = mesh_files.e57(np.random.default_rng(0).random((50, 3)))
    start = data.index(b"<?xml")
    end = data.index(b"<e57Root")
    evil = b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
    head = data[start:end].strip()[: end - start]
    mixed = data[:start] + (evil + head)[: end - start].ljust(end - start) + data[end:]
    with pytest.raises(InputError, match="E57"):
        mesh_files.read(tmp_path, "e57", mixed)


def test_a_packed_las_and_a_plain_laz_are_told_apart(tmp_path: Path) -> None:
    points = np.random.default_rng(0).random((50, 3))
    for suffix, data in (("las", mesh_files.laz(points)), ("laz", mesh_files.las(points))):
        with pytest.raises(InputError, match=r"Name it \.la"):
            mesh_files.read(tmp_path, suffix, data)


def test_dae_positions_and_places_keep_double_precision(tmp_path: Path) -> None:
    text = mesh_files.write(*mesh_files.shape(), "dae").decode()
    place = np.array([2683000.123, 1247000.456, 400.789])
    moved = re.sub(r"<node ([^>]*)>", rf"<node \1><translate>{' '.join(map(str, place))}</translate>", text)
    raw = mesh_files.read(tmp_path, "dae", moved.encode())
    low = mesh_files.shape()[0].min(axis=0) + place
    assert np.abs(raw.vertices[np.unique(raw.triangles)].min(axis=0) - low).max() < 1e-6


PART = """<model unit="meter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
 xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06">{}</model>"""
OBJECT = """<object id="{}"><mesh><vertices><vertex x="0" y="0" z="{z}"/><vertex x="1" y="0" z="{z}"/>
<vertex x="0" y="1" z="{z}"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles>
</mesh></object>"""


def test_objects_in_another_part_of_a_3mf_are_placed_once_each(tmp_path: Path) -> None:
    objects = OBJECT.format(1, z=0) + OBJECT.format(2, z=5)
    path = "/3D/Objects/object_1.model"
    parts = "".join(f'<component p:path="{path}" objectid="{number}"/>' for number in (1, 2))
    inner = f'<resources><object id="9"><components>{parts}</components></object></resources>'
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("3D/Objects/object_1.model", PART.format(f"<resources>{objects}</resources>"))
        archive.writestr("3D/3dmodel.model", PART.format(inner + '<build><item objectid="9"/></build>'))
    raw = mesh_files.read(tmp_path, "3mf", file.getvalue())
    assert sorted(raw.vertices[raw.triangles][:, 0, 2].tolist()) == [0.0, 5.0]


def test_a_gltf_child_of_a_camera_keeps_its_place(tmp_path: Path) -> None:
    points = np.eye(3, dtype="<f4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1, "aspectRatio": 1.0}}],
        "buffers": [{"byteLength": len(points)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"camera": 0, "translation": [0, 0, 7], "children": [1]}, {"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    raw = mesh_files.read(tmp_path, "glb", mesh_files.glb(document, points))
    assert np.allclose(raw.vertices, np.eye(3) + np.array([0, 0, 7]))
    document["meshes"][0]["primitives"][0]["mode"] = 6
    with pytest.raises(InputError, match="fans"):
        mesh_files.read(tmp_path, "glb", mesh_files.glb(document, points))


RAW = ["bigben_ascii.stl", "empire_state_cm.obj", "house_1_inch_sdf1.5.dae", "truss_bridge_inch.dae"]


@pytest.mark.parametrize("name", RAW)
def test_gltf_laz_and_e57_of_three_other_writers_are_read(real_data: Path, tmp_path: Path, name: str) -> None:
    raw, _ = read_raw(real_data / "meshes" / "_raw" / name)
    for writer in (by_trimesh, by_open3d, by_hand):
        (tmp_path / "a.glb").write_bytes(writer(raw.vertices, raw.triangles, tmp_path))
        again, _ = read_raw(tmp_path / "a.glb")
        expected, actual = raw.vertices[raw.triangles], again.vertices[again.triangles]
        assert actual.shape == expected.shape
        size = np.abs(expected).max()
        assert (
            np.abs(np.sort(actual.reshape(-1, 3), axis=0) - np.sort(expected.reshape(-1, 3), axis=0)).max()
            < 1e-5 * size
        )
    points = raw.vertices[np.unique(raw.triangles)]
    for suffix in ("laz", "e57"):
        cloud = mesh_files.read(tmp_path, suffix, mesh_files.write(points, raw.triangles, suffix))
        assert np.abs(cloud.vertices[: len(points)] - points).max() < 1e-3


def by_trimesh(vertices: np.ndarray, triangles: np.ndarray, folder: Path) -> bytes:
    return mesh_files.write(vertices, triangles, "glb")


def by_open3d(vertices: np.ndarray, triangles: np.ndarray, folder: Path) -> bytes:
    from upplied.geometry.scene import open3d

    mesh = open3d().geometry.TriangleMesh(
        open3d().utility.Vector3dVector(vertices), open3d().utility.Vector3iVector(triangles.astype(np.int32))
    )
    path = folder / "open3d.glb"
    assert open3d().io.write_triangle_mesh(str(path), mesh)
    return path.read_bytes()


def by_hand(vertices: np.ndarray, triangles: np.ndarray, folder: Path) -> bytes:
    """Interleaved with normals, 32 bit indices, two nodes deep, as Blender writes it."""
    rows = np.zeros((len(vertices), 6), "<f4")
    rows[:, :3], rows[:, 5] = vertices, 1
    index = triangles.astype("<u4").tobytes()
    view = {"buffer": 0, "byteLength": rows.nbytes, "byteStride": 24}
    vectors = {"bufferView": 0, "componentType": 5126, "count": len(rows), "type": "VEC3"}
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": rows.nbytes + len(index)}],
        "bufferViews": [view, {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": len(index)}],
        "accessors": [
            vectors,
            vectors | {"byteOffset": 12},
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "nodes": [{"children": [1]}, {"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return mesh_files.glb(document, rows.tobytes() + index)
