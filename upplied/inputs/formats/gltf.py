"""glTF 2.0 by trimesh, which gets a document whose references were all checked, and its buffers.

Trimesh drops triangle fans, does not scale normalised integers, loses the place of a camera's child, and
places a node that is named twice once: all in silence, so these are refused or corrected here.
"""

import base64
import io
import json

import numpy as np

from upplied.inputs.raw import Assembly, RawMesh, Source, counted

_BITS = {5120: 7, 5121: 8, 5122: 15, 5123: 16, 5125: 32, 5126: 32}  # of each component; without its sign
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_TOO_OLD = "is glTF 1.0", "glTF 2.0", "convert it, e.g. `npx gltf-pipeline -i old.glb -o new.glb`"
# Required extensions that do not touch the geometry, by prefix.
_HARMLESS = ("KHR_materials", "KHR_texture", "EXT_texture", "KHR_lights", "KHR_mesh_quantization", "KHR_xmp")


def read_gltf(source: Source) -> RawMesh:
    """The triangles of the default scene, each primitive a part; metres and Y up by specification."""
    from trimesh.exchange.gltf import load_gltf

    text, binary = _chunks(source) if source.data[:4] == b"glTF" else (source.data, b"")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        raise source.error("its JSON cannot be understood", "a complete glTF 2.0 file") from None
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise source.error("has no 'asset'", "a glTF 2.0 file")
    if not str(document["asset"].get("version", "")).startswith("2"):
        raise source.error(*_TOO_OLD)
    for name in map(str, document.get("extensionsRequired", [])):
        if not name.startswith(_HARMLESS):
            remedy = "export it without compression or extensions"
            raise source.error(f"requires the extension {name[:60]}", "plain glTF 2.0", remedy)
    buffers = _buffers(source, document, binary)
    _check_accessors(source, document, buffers)
    skinned = _plain_tree(source, document)
    scales, skipped = _primitives(source, document)
    document["buffers"] = [{"uri": str(index)} for index in range(len(buffers))]
    resolver = {str(index): data for index, data in enumerate(buffers)}
    loaded = load_gltf(io.BytesIO(json.dumps(document).encode()), resolver, skip_materials=True)
    scale = dict(zip(loaded["geometry"], scales, strict=True))
    assembly, placed = Assembly(source), {"world": np.eye(4)}
    for edge in loaded["graph"]:
        matrix = placed[edge["frame_from"]] @ edge["matrix"]
        placed.setdefault(edge["frame_to"], matrix)
        if "geometry" in edge:
            piece = loaded["geometry"][name := edge["geometry"]]
            vertices = np.asarray(piece["vertices"], float) / scale[name]
            assembly.add(vertices, np.asarray(piece["faces"], np.int64), matrix, name)
    skins = skinned, "skinned meshes in their pose of rest"
    remarks = counted((skipped, "primitives of lines and points left aside"), skins)
    return assembly.mesh(unit_m=1.0, up="y", remarks=remarks)


def _chunks(source: Source) -> tuple[bytes, bytes]:
    data = source.data
    version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
    if version == 1:
        raise source.error(*_TOO_OLD)
    if version != 2 or length > len(data) or length < 20:
        stated = f"says it is version {version} and {length} bytes long, it has {len(data)}"
        raise source.error(stated, "a complete GLB 2")
    chunks, at = dict[bytes, bytes](), 12
    while at + 8 <= length:
        size, kind = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
        if at + 8 + size > length:
            raise source.error("a chunk reaches beyond its end", "a complete GLB 2")
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return chunks.get(b"JSON", b""), chunks.get(b"BIN\0", b"")


def _buffers(source: Source, document: dict, binary: bytes) -> list[bytes]:
    buffers = []
    for uri in (buffer.get("uri") for buffer in document.get("buffers", [])):
        if uri is None:
            buffers.append(binary)
        elif uri.startswith("data:"):
            buffers.append(base64.b64decode(uri.partition(",")[2], validate=True))
        else:
            buffers.append(source.sibling(uri))
    return buffers


def _check_accessors(source: Source, document: dict, buffers: list[bytes]) -> None:
    """That every accessor lies in its view and every view in its buffer, and that none counts too few."""
    views = document.get("bufferViews", [])
    used: dict[int, tuple[int, int]] = {}  # of each view: where its last accessor ends, and its step
    for view in views:
        start, length = view.get("byteOffset", 0), view["byteLength"]
        if min(start, length, view["buffer"]) < 0 or start + length > len(buffers[view["buffer"]]):
            raise source.error("a view reaches beyond its buffer", "a complete file")
    for accessor in document.get("accessors", []):
        if "bufferView" not in accessor:
            continue
        index, count, start = accessor["bufferView"], accessor["count"], accessor.get("byteOffset", 0)
        row = (_BITS[accessor["componentType"]] + 7) // 8 * _WIDTH[accessor["type"]]
        step = views[index].get("byteStride") or row
        end = start + (count - 1) * step + row
        if min(index, count, start, step) < 0 or end > views[index]["byteLength"]:
            raise source.error("an accessor reaches beyond its buffer", "a complete file")
        used[index] = max(used.get(index, (0, 0)), (end, step))
    for index, (end, step) in used.items():
        if (left := views[index]["byteLength"] - end) >= max(step, 16):
            finding = f"its accessors leave {left} of {left + end} bytes of a view unused"
            raise source.error(finding, "counts that cover all data")


def _plain_tree(source: Source, document: dict) -> int:
    """Make the scene a tree of plain nodes; how many meshes are skinned."""
    if not (nodes := document.setdefault("nodes", [])):
        nodes += [{"mesh": index} for index in range(len(document.get("meshes", [])))]
        document.pop("scenes", None)
    inner = [child for node in nodes for child in node.get("children", [])]
    if "scenes" not in document:
        named = set(inner)
        document["scenes"] = [{"nodes": [index for index in range(len(nodes)) if index not in named]}]
        document.pop("scene", None)
    roots = document["scenes"][document.get("scene", 0)].get("nodes", [])
    if len(set(inner)) < len(inner) or not set(inner).isdisjoint(roots) or len(set(roots)) < len(roots):
        finding = "its scene refers to itself, or to a node twice"
        raise source.error(finding, "a tree of nodes", "export it flattened")
    for index in (*inner, *roots):
        if not 0 <= index < len(nodes):
            raise source.error(f"refers to nodes {str(index)[:20]}, of {len(nodes)}", "a complete file")
    for number, node in enumerate(nodes):
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise source.error("uses EXT_mesh_gpu_instancing", "plain glTF 2.0", "export it flattened")
        node.pop("camera", None)
        node["name"] = f"{node.get('name', 'node')} {number}"
        if "mesh" in node and not 0 <= node["mesh"] < len(document.get("meshes", [])):
            raise source.error(f"refers to meshes {str(node['mesh'])[:20]}", "a complete file")
    return sum("skin" in node for node in nodes)


def _primitives(source: Source, document: dict) -> tuple[list[float], int]:
    """Leave triangles only; what the positions of each are divided by, and how many were left out."""
    scales, skipped, total, accessors = [], 0, 0, document.get("accessors", [])
    used, meshes = set[int](), document.get("meshes", [])
    placed = [node["mesh"] for node in document["nodes"] if "mesh" in node]
    for mesh, copies in zip(meshes, np.bincount(placed, None, len(meshes)).tolist(), strict=True):
        surfaces = [p for p in mesh["primitives"] if p.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP)]
        skipped += len(mesh["primitives"]) - len(surfaces)
        for primitive in mesh["primitives"]:
            if primitive.get("mode") == _FAN:
                raise source.error("holds triangle fans", "triangles or strips", "export it as triangles")
            if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
                raise source.error("is compressed with Draco", "plain glTF 2.0", "export it uncompressed")
        for primitive in surfaces:
            named = [primitive["attributes"]["POSITION"]]
            named += [primitive["indices"]] if "indices" in primitive else []
            known = all(0 <= number < len(accessors) for number in named)
            if not known or accessors[named[0]]["type"] != "VEC3":
                raise source.error("a primitive has no positions", "a complete file")
            if any("sparse" in accessors[n] or "bufferView" not in accessors[n] for n in named):
                raise source.error("uses sparse accessors", "plain accessors", "export it without sparse")
            used.update(named)
            total += max(copies, 1) * sum(accessors[number]["count"] for number in named)
            source.most(total, "corners", 1.0, 3_000_000)
            positions = accessors[named[0]]
            scaled = positions.get("normalized") and positions["componentType"] != 5126
            scales.append(2.0 ** _BITS[positions["componentType"]] - 1 if scaled else 1.0)
            primitive["attributes"] = {"POSITION": named[0]}
            primitive.pop("extensions", None)
        mesh["primitives"] = surfaces
    empty = {"componentType": 5121, "type": "SCALAR", "count": 0}
    document["accessors"] = [accessors[n] if n in used else empty for n in range(len(accessors))]
    return scales, skipped
