"""Scenes in XML: COLLADA (.dae), and 3MF, a zip archive read as a stream so that a bomb stays small."""

import io
import zipfile
import zlib
from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import Any
from xml.sax.handler import ContentHandler

import numpy as np
from defusedxml import sax
from scipy.spatial.transform import Rotation

from upplied.inputs.files import plain_xml
from upplied.inputs.raw import NO_TRIANGLES, Assembly, RawMesh, Source, counted, flatten, numbers, whole
from upplied.records import Floats, Ints

_UP = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
_FACES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
_LINES = ("lines", "linestrips")


def read_collada(source: Source) -> RawMesh:
    """The scene of a COLLADA file, flattened; each instance of a geometry is a part."""
    return _Reader(source).read()


class _Reader:
    def __init__(self, source: Source) -> None:
        with source.as_xml():
            root = plain_xml(source.data)
        if root.tag != "COLLADA":
            raise source.error(f"is XML of {root.tag[:40]!r}", "COLLADA")
        self._source, self._root = source, root
        self._by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
        self._geometries: dict[int, tuple[Floats, Ints]] = {}
        self._counts = Counter[str]()

    def read(self) -> RawMesh:
        assembly = Assembly(self._source)
        instance = self._root.find("scene/instance_visual_scene")
        scene = self._root.find(".//visual_scene") if instance is None else self._target(instance)
        roots = self._root.findall(".//geometry") if scene is None else scene.findall("node")
        placed = [(element, self._placed(element)) for element in roots]
        for element, matrix in flatten(self._source, placed, self._children):
            if element.tag == "geometry":
                if (mesh := element.find("mesh")) is None:
                    raise self._source.error("holds a geometry that is no mesh", "polygons", "tessellate it")
                if id(mesh) not in self._geometries:
                    self._geometries[id(mesh)] = self._mesh(mesh)
                name = element.get("name") or element.get("id") or ""
                assembly.add(*self._geometries[id(mesh)], matrix, name)
        unit, up = self._root.find("asset/unit"), self._root.findtext("asset/up_axis", "").strip()
        unit_m = 1.0 if unit is None else float(unit.get("meter", "1"))
        remarks = counted(*((count, what) for what, count in self._counts.items()))
        return assembly.mesh(unit_m=unit_m, up=_UP.get(up, "y"), remarks=remarks)

    def _children(self, element: Any) -> list[tuple[Any, Floats]]:
        children = []
        for child in element:
            if child.tag == "node":
                children.append(child)
            elif child.tag in ("instance_geometry", "instance_node", "instance_controller"):
                children.append(self._target(child))
            elif child.tag in ("skin", "morph") and element.tag == "controller":
                self._counts["skinned meshes in their pose of rest"] += 1
                children.append(self._target(child, "source"))
        return [(child, self._placed(child)) for child in children]

    def _target(self, element: Any, attribute: str = "url") -> Any:
        url = element.get(attribute, "")
        if not url.startswith("#") or url[1:] not in self._by_id:
            raise self._source.error(f"refers to {url[:80]!r}, which is not in it", "a complete file")
        return self._by_id[url[1:]]

    def _placed(self, element: Any) -> Floats:
        matrix = np.eye(4)
        if element.tag == "node":
            for child in element:
                if child.tag in _TRANSFORMS:
                    matrix = matrix @ _TRANSFORMS[child.tag](numbers((child.text or "").encode()))
                elif child.tag == "skew":
                    raise self._source.error("a node is skewed", "matrix, translate, rotate, scale or lookat")
        return matrix

    def _mesh(self, mesh: Any) -> tuple[Floats, Ints]:
        vertices, triangles = list[Floats](), list[Ints]()
        known: dict[int, tuple[int, Floats]] = {}  # of each source: its first vertex, and its positions
        for group in mesh:
            if group.tag in _LINES:
                self._counts["groups of lines left aside"] += 1
            if group.tag not in _FACES:
                continue
            source = self._input(group)
            if id(source) not in known:
                accessor = source.find("technique_common/accessor")
                values = numbers((source.findtext("float_array") or "").encode())
                defaults = {"count": "0", "stride": "1", "offset": "0"}
                count, stride, offset = (int(accessor.get(*each)) for each in defaults.items())
                if stride < 3 or min(count, offset) < 0 or offset + count * stride > len(values):
                    raise self._source.error("its positions are fewer than it says", f"{count} triples")
                places = values[offset : offset + count * stride].reshape(count, stride)[:, :3]
                known[id(source)] = (sum(map(len, vertices)), places)
                vertices.append(places)
            first, positions = known[id(source)]
            corners, sizes = self._corners(group)
            if group.tag in ("trifans", "tristrips"):  # the assembly checks their indices
                triangles.append(_strips(corners, sizes, group.tag) + first)
                continue
            self._counts["polygons triangulated"] += int((sizes > 3).sum())
            triangles.append(self._source.triangulated(positions, corners, sizes) + first)
        return np.concatenate([np.empty((0, 3)), *vertices]), np.concatenate([NO_TRIANGLES, *triangles])

    def _input(self, group: Any) -> Any:
        for item in group.findall("input"):
            if item.get("semantic") == "VERTEX":
                for inner in self._target(item, "source").findall("input"):
                    if inner.get("semantic") == "POSITION":
                        return self._target(inner, "source")
        raise self._source.error("holds faces without positions", "an input VERTEX with an input POSITION")

    def _corners(self, group: Any) -> tuple[Ints, Ints]:
        offsets = [(item.get("semantic"), int(item.get("offset", "0"))) for item in group.findall("input")]
        stride = 1 + max(at for _, at in offsets)
        offset = next(at for what, at in offsets if what == "VERTEX")
        if stride > 64 or offset < 0:
            raise ValueError("offsets out of all proportion")
        rings = group.findall("p") + group.findall("ph/p")
        self._counts["holes in polygons closed"] += len(group.findall("ph/h"))
        lists = [whole(numbers((ring.text or "").encode())).reshape(-1, stride)[:, offset] for ring in rings]
        corners = np.concatenate([np.empty(0, np.int64), *lists])
        if group.tag == "triangles":
            sizes = np.full(len(corners) // 3, 3)
        elif group.tag == "polylist":
            sizes = whole(numbers((group.findtext("vcount") or "").encode()))
        else:
            sizes = np.array([len(ring) for ring in lists], np.int64)
        stated = int(group.get("count", len(sizes)))
        if (sizes < 0).any() or sizes.sum() != len(corners) or stated != len(sizes):
            raise self._source.error(f"a group says {stated} faces, it holds {len(sizes)}", "a complete file")
        return corners, sizes


def _strips(corners: Ints, sizes: Ints, tag: str) -> Ints:
    triangles = [NO_TRIANGLES]
    for ring in np.split(corners, np.cumsum(sizes)[:-1]):
        step = np.arange(max(len(ring) - 2, 0))
        odd = step % 2 if tag == "tristrips" else 0 * step
        first = ring[step] if tag == "tristrips" else np.broadcast_to(ring[:1], len(step))
        triangles.append(np.stack([first, ring[step + 1 + odd], ring[step + 2 - odd]], axis=1))
    return np.concatenate(triangles)


def _placing(axes: Floats, origin: Floats) -> Floats:
    return np.vstack([np.column_stack([axes, origin.reshape(3)]), [0.0, 0.0, 0.0, 1.0]])


def _lookat(values: Floats) -> Floats:
    eye, target, up = values.reshape(3, 3)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    return _placing(np.column_stack([right, np.cross(back, right), back]), eye)


_TRANSFORMS = {
    "matrix": lambda values: values.reshape(4, 4),
    "translate": lambda values: _placing(np.eye(3), values),
    "rotate": lambda values: _placing(
        Rotation.from_rotvec(values[:3] / np.linalg.norm(values[:3]) * np.radians(values[3])).as_matrix(),
        np.zeros(3),
    ),
    "scale": lambda values: np.diag([*values.reshape(3), 1.0]),
    "lookat": _lookat,
}


_UNITS = {
    "micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0
}  # fmt: skip
_HARMLESS = ("production/2015/06", "material/2015/02", "slice/2015/07", "trianglesets/2021/07")
Key = tuple[str, str]  # of an object: its part of the archive, and its number


@dataclass
class _Object:
    name: str
    vertices: array = field(default_factory=lambda: array("d"))
    triangles: array = field(default_factory=lambda: array("q"))
    components: list[tuple[Key, Floats]] = field(default_factory=list)


def read_threemf(source: Source) -> RawMesh:
    """What a 3MF file builds, flattened; each placed mesh is a part. Z is up by specification."""
    objects, built, units = dict[Key, _Object](), list[tuple[Key, Floats]](), set[str]()
    for name, text in _models(source).items():
        handler = _Handler(source, name, objects, built)
        with source.as_xml():
            sax.parseString(text, handler, forbid_dtd=True)
        units.add(handler.unit)
    if len(units) > 1:
        raise source.error("its models differ in their units", "one unit", "export it as one model")

    def resolved(items: list[tuple[Key, Floats]]) -> list[tuple[_Object, Floats]]:
        if missing := [key for key, _ in items if key not in objects]:
            raise source.error(f"refers to object {missing[0][1][:20]!r}, not in it", "a complete file")
        return [(objects[key], matrix) for key, matrix in items]

    assembly = Assembly(source)
    for item, matrix in flatten(source, resolved(built), lambda item: resolved(item.components)):
        if item.triangles:
            vertices = np.frombuffer(item.vertices, float).reshape(-1, 3)
            assembly.add(vertices, np.frombuffer(item.triangles, np.int64).reshape(-1, 3), matrix, item.name)
    return assembly.mesh(unit_m=_UNITS[units.pop()], up="z")


def _models(source: Source) -> dict[str, bytes]:
    """The model parts of the archive; together no larger than XML of that size can be in honesty."""
    left, models = max(32 << 20, 40 * len(source.data)), dict[str, bytes]()
    try:
        with zipfile.ZipFile(io.BytesIO(source.data)) as archive:
            for info in archive.infolist():
                if not info.filename.lower().endswith(".model"):
                    continue
                with archive.open(info) as file:
                    text = file.read(left + 1)
                left -= len(text)
                if left < 0:
                    raise source.error("unpacks to far more than its size", "40 times", "export it again")
                models["/" + info.filename.lstrip("/")] = text
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError, OSError) as error:
        raise source.error(f"its archive cannot be unpacked: {str(error)[:80]}", "a complete 3MF") from None
    if not models:
        raise source.error("its archive holds no model", "a .model part, as 3MF says")
    return models


class _Handler(ContentHandler):
    def __init__(self, source: Source, name: str, objects: dict, built: list) -> None:
        super().__init__()
        self._source, self._name, self._objects, self._built = source, name, objects, built
        self._object, self.unit = _Object(""), "millimeter"

    def startElement(self, name: str, attrs: Any) -> None:
        """Called by the parser for each element; ones of other namespaces carry a prefix."""
        if name == "vertex":
            self._object.vertices.extend((float(attrs["x"]), float(attrs["y"]), float(attrs["z"])))
        elif name == "triangle":
            self._object.triangles.extend((int(attrs["v1"]), int(attrs["v2"]), int(attrs["v3"])))
        elif name == "object":
            self._object = _Object(str(attrs.get("name", ""))[:80])
            self._objects[(self._name, attrs["id"])] = self._object
        elif name in ("component", "item"):
            path = next((value for key, value in attrs.items() if key.endswith(":path")), self._name)
            matrix = np.eye(4)
            if text := attrs.get("transform", ""):  # three columns of four numbers, for row vectors
                matrix[:3] = np.array([float(word) for word in text.split()]).reshape(4, 3).T
            placed = ((path, attrs["objectid"]), matrix)
            (self._object.components if name == "component" else self._built).append(placed)
        elif name == "model":
            self.unit = attrs.get("unit", "millimeter")
            if self.unit not in _UNITS:
                raise self._source.error(f"its unit is {self.unit[:40]!r}", f"one of {', '.join(_UNITS)}")
            for prefix in attrs.get("requiredextensions", "").split():
                if not (uri := attrs.get(f"xmlns:{prefix}", "")).endswith(_HARMLESS):
                    finding = f"requires the extension {uri[:80]!r}"
                    raise self._source.error(finding, "meshes", "export meshes")
