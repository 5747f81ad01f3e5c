"""glTF 2.0: a scene of nodes and meshes in JSON, its numbers in binary buffers (GLB or beside it)."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.formats.raw import Assembly, RawMesh, Source
from upplied.inputs.formats.tree import flatten
from upplied.records import Floats, Ints

_COMPONENT = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
# Required extensions that do not touch the geometry, by prefix.
_HARMLESS = ("KHR_materials", "KHR_texture", "EXT_texture", "KHR_lights", "KHR_mesh_quantization", "KHR_xmp")


def read_gltf(source: Source) -> RawMesh:
    """The triangles of the default scene, each primitive a part; metres and Y up by specification."""
    document, binary = _chunks(source) if source.data[:4] == b"glTF" else (source.data, b"")
    try:
        scene = json.loads(document)
    except (ValueError, RecursionError):
        raise source.error("its JSON cannot be understood", "a complete glTF 2.0 file") from None
    _check_version(source, scene)
    return _Reader(source, scene, binary).read()


def _chunks(source: Source) -> tuple[bytes, bytes]:
    """The JSON and the binary chunk of a GLB."""
    data = source.data
    version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
    if version == 1:
        raise _too_old(source)
    if version != 2 or length > len(data) or length < 20:
        raise source.error(
            f"says it is version {version} and {length} bytes long, it has {len(data)}", "a complete GLB 2"
        )
    found: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
        if at + 8 + size > length:
            raise source.error("a chunk reaches beyond its end", "a complete GLB 2")
        found.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return found.get(b"JSON", b""), found.get(b"BIN\0", b"")


def _check_version(source: Source, scene: Any) -> None:
    if not isinstance(scene, dict) or not isinstance(scene.get("asset"), dict):
        raise source.error("has no 'asset'", "a glTF 2.0 file")
    if not str(scene["asset"].get("version", "")).startswith("2"):
        raise _too_old(source)
    for name in map(str, scene.get("extensionsRequired", [])):
        if not name.startswith(_HARMLESS):
            raise source.error(
                f"requires the extension {name[:60]}",
                "plain glTF 2.0",
                "export it without compression or extensions",
            )


def _too_old(source: Source) -> Exception:
    return source.error(
        "is glTF 1.0",
        "glTF 2.0",
        "convert it, e.g. `npx gltf-pipeline -i old.glb -o new.glb`, or export it again",
    )


class _Reader:
    def __init__(self, source: Source, scene: dict[str, Any], binary: bytes) -> None:
        self._source, self._scene, self._binary = source, scene, binary
        self._buffers: dict[int, bytes] = {}
        self._matrices: dict[int, Floats] = {}
        self._skipped = 0
        self._skinned = 0

    def read(self) -> RawMesh:
        assembly = Assembly(self._source)
        for node, matrix in flatten(self._source, self._roots(), self._children):
            if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                raise self._source.error(
                    "uses EXT_mesh_gpu_instancing", "plain glTF 2.0", "export it flattened"
                )
            if "mesh" not in node:
                continue
            self._skinned += "skin" in node
            mesh = self._item("meshes", node["mesh"])
            for primitive in mesh["primitives"]:
                piece = self._primitive(primitive)
                if piece is not None:
                    assembly.add(*piece, matrix, str(node.get("name", mesh.get("name", "")))[:80])
        remarks = [
            f"{count} {what}"
            for count, what in (
                (self._skipped, "primitives of lines and points left aside"),
                (self._skinned, "skinned meshes taken in their pose of rest"),
            )
            if count
        ]
        return assembly.mesh(unit_m=1.0, up="y", remarks=tuple(remarks))

    def _roots(self) -> list[tuple[dict, Floats]]:
        nodes = self._scene.get("nodes", [])
        if "scenes" in self._scene:
            roots = self._item("scenes", self._scene.get("scene", 0)).get("nodes", [])
        else:
            inner = {child for node in nodes for child in node.get("children", [])}
            roots = [index for index in range(len(nodes)) if index not in inner]
        if not nodes:
            return [({"mesh": index}, np.eye(4)) for index in range(len(self._scene.get("meshes", [])))]
        return [self._node(index) for index in roots]

    def _children(self, node: dict) -> list[tuple[dict, Floats]]:
        return [self._node(index) for index in node.get("children", [])]

    def _node(self, index: int) -> tuple[dict, Floats]:
        node = self._item("nodes", index)
        if index not in self._matrices:
            self._matrices[index] = _matrix(node)
        return node, self._matrices[index]

    def _primitive(self, primitive: dict) -> tuple[Floats, Ints] | None:
        mode = primitive.get("mode", _TRIANGLES)
        if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
            raise self._source.error(
                "is compressed with Draco", "plain glTF 2.0", "export it without compression"
            )
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._skipped += 1
            return None
        vertices = self._accessor(primitive["attributes"]["POSITION"]).astype(float)
        if vertices.shape[1] != 3:
            raise ValueError("positions are no triples")
        if "indices" in primitive:
            indices = self._accessor(primitive["indices"]).reshape(-1).astype(np.int64)
        else:
            indices = np.arange(len(vertices))
        return vertices, _triangles(indices, mode)

    def _accessor(self, index: int) -> np.ndarray:
        """The values (count, width) of an accessor, scaled where they are normalised integers."""
        accessor = self._item("accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self._source.error(
                "uses sparse accessors", "plain accessors", "export it again without sparse"
            )
        kind, width = np.dtype(_COMPONENT[accessor["componentType"]]), _WIDTH[accessor["type"]]
        count, offset = accessor["count"], accessor.get("byteOffset", 0)
        view = self._item("bufferViews", accessor["bufferView"])
        start, length = view.get("byteOffset", 0), view["byteLength"]
        buffer = self._buffer(view["buffer"])
        step = view.get("byteStride") or kind.itemsize * width
        needed = offset + (count - 1) * step + kind.itemsize * width
        if min(count, offset, start, length, step) < 0 or needed > length or start + length > len(buffer):
            raise self._source.error("an accessor reaches beyond its buffer", "a complete file")
        values = np.ndarray((count, width), kind, buffer, start + offset, (step, kind.itemsize))
        return values / np.iinfo(kind).max if accessor.get("normalized") and kind.kind != "f" else values

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self._item("buffers", index).get("uri")
            if uri is None:
                data = self._binary
            elif uri.startswith("data:"):
                data = base64.b64decode(uri.partition(",")[2], validate=True)
            else:
                data = self._source.sibling(uri)
            self._buffers[index] = data
        return self._buffers[index]

    def _item(self, kind: str, index: Any) -> dict:
        items = self._scene.get(kind, [])
        if not isinstance(index, int) or not 0 <= index < len(items):
            raise self._source.error(
                f"refers to {kind} {str(index)[:20]}, of {len(items)}", "a complete file"
            )
        return items[index]


def _matrix(node: dict) -> Floats:
    """The transform (4, 4) of a node to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    turn = Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), float).reshape(3)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _triangles(indices: Ints, mode: int) -> Ints:
    if mode == _TRIANGLES:
        if len(indices) % 3:
            raise ValueError("triangles of less than three corners")
        return indices.reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    step = np.arange(count)
    if mode == _FAN:
        return np.stack([np.broadcast_to(indices[:1], count), indices[step + 1], indices[step + 2]], axis=1)
    odd = step % 2
    return np.stack([indices[step], indices[step + 1 + odd], indices[step + 2 - odd]], axis=1)
