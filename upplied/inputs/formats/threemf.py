"""3MF: a zip archive with the model in XML, read as a stream so that a bomb stays small.

Not by trimesh, which adds every mesh of a part once for each reference to it, unpacks the whole archive
whatever its size, and follows every path through components, however many there are.
"""

import io
import zipfile
import zlib
from array import array
from dataclasses import dataclass, field
from typing import Any
from xml.sax.handler import ContentHandler

import numpy as np
from defusedxml import sax

from upplied.inputs.raw import Assembly, RawMesh, Source, flatten
from upplied.records import Floats

_UNITS = {
    "micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0
}  # fmt: skip
_HARMLESS = ("production/2015/06", "material/2015/02", "slice/2015/07", "trianglesets/2021/07")


@dataclass
class _Object:
    name: str
    vertices: array = field(default_factory=lambda: array("d"))
    triangles: array = field(default_factory=lambda: array("q"))
    components: list[tuple[tuple[str, str], Floats]] = field(default_factory=list)


def read_threemf(source: Source) -> RawMesh:
    """What a 3MF file builds, flattened; each placed mesh is a part. Z is up by specification."""
    objects: dict[tuple[str, str], _Object] = {}
    built: list[tuple[tuple[str, str], Floats]] = []
    units = set()
    for name, text in _models(source).items():
        handler = _Handler(source, name, objects, built)
        with source.as_xml():
            sax.parseString(text, handler, forbid_dtd=True)
        units.add(handler.unit)
    if len(units) > 1:
        raise source.error("its models differ in their units", "one unit", "export it as one model")

    def resolved(items: list[tuple[tuple[str, str], Floats]]) -> list[tuple[_Object, Floats]]:
        missing = [key for key, _ in items if key not in objects]
        if missing:
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
    left = max(32 << 20, 40 * len(source.data))
    models = {}
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
    """Collects the objects and the build items of one model part."""

    def __init__(self, source: Source, name: str, objects: dict, built: list) -> None:
        super().__init__()
        self._source, self._name, self._objects, self._built = source, name, objects, built
        self._object = _Object("")
        self.unit = "millimeter"

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
                uri = attrs.get(f"xmlns:{prefix}", "")
                if not uri.endswith(_HARMLESS):
                    raise self._source.error(
                        f"requires the extension {uri[:80]!r}", "meshes", "export meshes"
                    )
