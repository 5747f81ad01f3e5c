"""Readers of mesh files: round trips, independent readers as oracles, damage and malice."""

from __future__ import annotations

import struct
from pathlib import Path

import mesh_files
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.errors import InputError
from upplied.inputs.raw import triangulate

MESHES = ["ply", "ply_ascii", "stl", "stl_ascii", "obj", "off", "glb", "gltf", "dae", "3mf"]
CLOUDS = ["pcd", "pcd_ascii", "las", "laz", "e57"]


def soup(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The corners of all triangles, each turned to a first corner of its own, sorted."""
    corners = np.round(vertices[triangles], 4) + 0.0
    first = np.array([np.lexsort(ring.T[::-1])[0] for ring in corners])
    turned = np.take_along_axis(corners, ((first[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    flat = turned.reshape(-1, 9)
    return flat[np.lexsort(flat.T[::-1])]


@pytest.mark.parametrize("suffix", MESHES)
def test_round_trip_keeps_every_triangle_and_its_winding(tmp_path: Path, suffix: str) -> None:
    vertices, triangles = mesh_files.shape()
    raw = mesh_files.read(tmp_path, suffix, mesh_files.write(vertices, triangles, suffix))
    assert np.allclose(soup(raw.vertices, raw.triangles), soup(vertices, triangles), atol=1e-4)


@pytest.mark.parametrize("suffix", CLOUDS)
def test_clouds_keep_their_points_in_projected_coordinates(tmp_path: Path, suffix: str) -> None:
    points = np.random.default_rng(0).random((50, 3)) * 30 + [2_683_000.0, 1_247_000.0, 400.0]
    raw = mesh_files.read(tmp_path, suffix, mesh_files.write(points, np.empty((0, 3), int), suffix))
    assert len(raw.triangles) == 0
    if suffix == "e57":  # and three of them again, of its second scan
        points = np.concatenate([points, points[:3]])
    assert np.allclose(raw.vertices, points, rtol=0, atol=1e-4)


def test_compressed_pcd(tmp_path: Path) -> None:
    points = np.repeat(np.arange(60.0)[:, None], 3, axis=1)
    points[:, 1] = 7.0
    points[:, 2] = 0.0
    data = mesh_files.pcd_compressed(points)
    assert len(data) < points.nbytes
    assert np.array_equal(mesh_files.read(tmp_path, "pcd", data).vertices, points)
    damaged = bytearray(data)
    damaged[-3] = 255
    with pytest.raises(InputError, match=r"damaged|points"):
        mesh_files.read(tmp_path, "pcd", bytes(damaged[:-1]))


def test_declared_units_and_axes(tmp_path: Path) -> None:
    vertices, triangles = mesh_files.shape()
    declared = {}
    for suffix in ("glb", "gltf", "3mf", "dae", "stl", "obj"):
        raw = mesh_files.read(tmp_path, suffix, mesh_files.write(vertices, triangles, suffix))
        declared[suffix] = (raw.unit_m, raw.up)
    assert declared["glb"] == declared["gltf"] == (1.0, "y")
    assert declared["3mf"] == (0.001, "z")
    assert declared["stl"] == declared["obj"] == (None, "")


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_scenes_are_flattened_as_trimesh_does(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box((1, 2, 3))
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6])
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = -20
    scene.add_geometry(box, node_name="a")
    scene.add_geometry(box, node_name="b", parent_node_name="a", transform=turn)
    scene.add_geometry(box, node_name="c", parent_node_name="b", transform=mirror)
    data = mesh_files.embedded(scene) if suffix == "gltf" else scene.export(file_type="glb")
    raw = mesh_files.read(tmp_path, suffix, data)
    whole = scene.to_geometry()
    assert np.allclose(soup(raw.vertices, raw.triangles), soup(whole.vertices, whole.faces), atol=1e-3)
    assert len(raw.part_names) == 3
    volume = trimesh.Trimesh(raw.vertices, raw.triangles, process=True).volume
    assert volume == pytest.approx(18.0, rel=1e-4)  # the mirrored box is wound outwards as well


THREEMF = """<?xml version="1.0"?><model unit="inch"
 xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>
<object id="1" type="model" name="plate"><mesh><vertices>
<vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices>
<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object>
<object id="2" type="model"><components>
<component objectid="1"/><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/></components></object>
</resources><build><item objectid="2" transform="2 0 0 0 2 0 0 0 2 0 0 7"/></build></model>"""


def test_components_of_a_3mf_are_placed(tmp_path: Path) -> None:
    raw = mesh_files.read(tmp_path, "3mf", mesh_files.zipped(THREEMF.encode()))
    assert (raw.unit_m, raw.up, raw.part_names) == (0.0254, "z", ("plate", "plate"))
    # Row vectors: a quarter turn takes x to y, then 10 along x; then doubled, and 7 up.
    placed = [[[0, 0, 7], [2, 0, 7], [0, 2, 7]], [[20, 0, 7], [20, 2, 7], [18, 0, 7]]]
    assert np.allclose(raw.vertices[raw.triangles], placed)


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="plate"><mesh>
<source id="p"><float_array id="pa" count="15">0 0 0 2 0 0 2 1 0 0 1 0 1 2 0</float_array>
<technique_common><accessor source="#pa" count="5" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
{faces}
</mesh></geometry></library_geometries>
<library_nodes><node id="twice">
<node><translate>10 0 0</translate><instance_geometry url="#g"/></node>
<node><rotate>0 0 1 90</rotate><scale>2 2 2</scale><instance_geometry url="#g"/></node>
</node></library_nodes>
<library_visual_scenes><visual_scene id="s">
<node><matrix>1 0 0 0 0 1 0 0 0 0 1 5 0 0 0 1</matrix><instance_node url="#twice"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize(
    "faces",
    [
        '<polylist count="2"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4 3</vcount>'
        "<p>0 1 2 3 3 2 4</p></polylist>",
        '<polygons count="2"><input semantic="VERTEX" source="#v" offset="1"/>'
        '<input semantic="NORMAL" source="#n" offset="0"/>'
        "<p>0 0 0 1 0 2 0 3</p><p>0 3 0 2 0 4</p></polygons>",
        '<triangles count="3"><input semantic="VERTEX" source="#v" offset="0"/>'
        "<p>0 1 2 0 2 3 3 2 4</p></triangles>",
        '<trifans count="2"><input semantic="VERTEX" source="#v" offset="0"/>'
        "<p>0 1 2 3</p><p>3 2 4</p></trifans>",
        '<tristrips count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 3 2 4</p></tristrips>',
    ],
)
def test_collada_faces_of_every_kind_and_nodes_within_nodes(tmp_path: Path, faces: str) -> None:
    raw = mesh_files.read(tmp_path, "dae", DAE.format(faces=faces).encode())
    assert (raw.unit_m, raw.up, len(raw.triangles)) == (0.0254, "z", 6)
    corners = raw.vertices[raw.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 2] > 0).all() and normal[:, 2].sum() / 2 == pytest.approx(
        3.0 * 5
    )  # 2 + 1, once and 4-fold
    assert np.allclose(corners.min(axis=(0, 1)), [-4, 0, 5]) and np.allclose(
        corners.max(axis=(0, 1)), [12, 4, 5]
    )


def test_quads_concave_polygons_and_lines_of_an_obj(tmp_path: Path) -> None:
    text = """mtllib ../../../etc/passwd
v 0 0 0 1.0
v 4 0 0 1.0
v 4 4 0 1.0
v 2 1 0 1.0
v 0 4 0 1.0
o roof
f 1/1/1 2//2 3/3 4 5
l 1 2
v 9 0 0 1.0
v 9 0 4 1.0
v 9 4 4 1.0
v 9 4 0 1.0
g wall
f -4 -3 \\
 -2 -1
"""
    raw = mesh_files.read(tmp_path, "obj", text.encode())
    assert raw.part_names == ("", "roof", "wall")
    corners = raw.vertices[raw.triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert len(area) == 5
    assert (area[:3, 2] > 0).all() and area[:3, 2].sum() == pytest.approx(10.0)  # not 13 with overlaps
    assert np.abs(area[3:]).sum() == pytest.approx(16.0)
    assert raw.remarks == ("2 polygons triangulated", "1 lines and points left aside")


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 30), st.integers(0, 2**32 - 1))
def test_any_star_polygon_keeps_its_area(corners: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.random(corners)) * 2 * np.pi
    if np.diff(angle, append=angle[0] + 2 * np.pi).max() > 3:
        angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius = rng.uniform(0.2, 1, corners)
    flat = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(corners)])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = flat @ turn.T
    expected = np.cross(flat, np.roll(flat, -1, axis=0))[:, 2].sum() / 2
    triangles = triangulate(points, np.arange(corners), np.array([corners]))
    a, b, c = (points[triangles[:, k]] for k in range(3))
    signed = (np.cross(b - a, c - a) / 2) @ (turn[:, 2] * np.linalg.det(turn))
    assert len(triangles) == corners - 2
    assert (signed > -1e-9).all() and signed.sum() == pytest.approx(expected, rel=1e-9)


def test_ply_of_either_byte_order_with_other_elements_and_mixed_polygons(tmp_path: Path) -> None:
    for order, mark in (("big", ">"), ("little", "<")):
        head = (
            f"ply\r\nformat binary_{order}_endian 1.0\r\nelement material 1\r\nproperty uchar red\r\n"
            "element vertex 5\r\nproperty double x\r\nproperty float z\r\nproperty double y\r\n"
            "element face 2\r\nproperty list uchar float uv\r\nproperty list ushort int vertex_index\r\n"
            "property short flag\r\nend_header\r\n"
        ).encode()
        rows = [(0, 0, 0), (2, 0, 0), (2, 0, 1), (0, 0, 1), (1, 0, 2)]
        body = b"\x07" + b"".join(struct.pack(f"{mark}dfd", x, z, y) for x, z, y in rows)
        body += struct.pack(f"{mark}BffH4ih", 2, 0.5, 0.5, 4, 0, 1, 2, 3, -1)
        body += struct.pack(f"{mark}BH3ih", 0, 3, 3, 2, 4, 7)
        raw = mesh_files.read(tmp_path, "ply", head + body)
        corners = raw.vertices[raw.triangles]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
        assert np.allclose(np.sort(area), [1, 1, 1])


def test_gltf_strips_fans_strides_and_normalised_integers(tmp_path: Path) -> None:
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    packed = b"".join(struct.pack("<3HH", x * 65535, y * 65535, 0, 9) for x, y in corners)
    document = {
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_mesh_quantization"],
        "buffers": [{"byteLength": len(packed)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(packed), "byteStride": 8}],
        "accessors": [
            {"bufferView": 0, "componentType": 5123, "normalized": True, "count": 4, "type": "VEC3"}
        ],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "mode": 5},
                    {"attributes": {"POSITION": 0}, "mode": 1},
                ]
            }
        ],
    }
    raw = mesh_files.read(tmp_path, "glb", mesh_files.glb(document, packed))
    a, b, c = (raw.vertices[raw.triangles[:, k]] for k in range(3))
    assert np.allclose(np.cross(b - a, c - a)[:, 2] / 2, [0.5, 0.5])
    assert raw.remarks == ("1 primitives of lines and points left aside",)
