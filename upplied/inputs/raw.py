"""What a mesh file holds before it is converted or repaired, its bytes, and numbers in text."""

import hashlib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

import numpy as np

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.records import Floats, Ints, Record

MAX_BYTES = 2 << 30
_MAX_DEPTH = 256
NO_TRIANGLES = np.empty((0, 3), np.int64)

Node = TypeVar("Node")


@dataclass(frozen=True, eq=False, repr=False)
class RawMesh(Record):
    """Vertices and triangles as in the file: its units, its axes, scenes flattened."""

    vertices: Floats  # (V, 3) units of the file
    triangles: Ints = field(default_factory=lambda: NO_TRIANGLES)  # (T, 3); (0, 3) for a point cloud
    normals: Floats | None = None  # (V, 3) as given, for point clouds
    part_names: tuple[str, ...] = ()
    unit_m: float | None = None  # what the file declares; None where it does not
    up: str = ""  # axis that the file declares to be up; empty where it does not
    remarks: tuple[str, ...] = ()  # what was triangulated or skipped, in words


class Source:
    """The bytes of one file, and of those in its folder that it refers to."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.data = read_regular(path, MAX_BYTES, remedy="decimate the mesh")
        self.sha256 = hashlib.sha256(self.data)  # of all bytes that were read

    def sibling(self, uri: str) -> bytes:
        """The bytes of a file in the same folder; nothing else is opened."""
        folder, name = self.path.parent.resolve(), unquote(uri)
        if "://" in name or "\0" in name or not (folder / name).resolve().is_relative_to(folder):
            finding, remedy = f"refers to {name[:120]!r}, outside its folder", "export it as one file (.glb)"
            raise self.error(finding, "buffers in the file itself or in its folder", remedy)
        data = read_regular(folder / name, MAX_BYTES, f"{self.path}, its buffer {name[:120]!r}")
        self.sha256.update(data)
        return data

    def error(self, finding: str, rule: str = "", remedy: str = "export the file again") -> InputError:
        """An error about this file."""
        return InputError(str(self.path), finding, rule, remedy)

    @contextmanager
    def as_xml(self) -> Iterator[None]:
        """Whatever expat, entities, encodings and numbers raise, as an error about this file."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            finding, rule = f"its XML cannot be read: {type(error).__name__}", "XML without DTD and entities"
            raise self.error(finding, f"well-formed {rule}") from None

    def most(self, count: int, what: str, per_byte: float, least: int) -> None:
        """Refuse a count that no file of this size holds in honesty: packed formats count on trust."""
        if not 0 <= count <= max(least, per_byte * len(self.data)):
            raise self.error(f"says it has {count} {what}, in {len(self.data)} bytes", "a complete file")

    def triangulated(self, vertices: Floats, corners: Ints, sizes: Ints, first: int = 0) -> Ints:
        """Triangles of polygons, once it is known that all corners exist."""
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
            rule = f"{first} to {len(vertices) - 1 + first}"
            raise self.error("its faces refer to vertices that do not exist", rule)
        if sizes.max(initial=0) > MAX_CORNERS:
            finding, rule = f"has a polygon of {sizes.max()} corners", f"at most {MAX_CORNERS}"
            raise self.error(finding, rule, "triangulate it on export")
        return triangulate(vertices, corners, sizes)


class Assembly:
    """The pieces of a scene, placed by their nodes; no more than a file of that size has in honesty."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._left, self._count = max(1_000_000, len(source.data) // 4), 0
        self._pieces: list[tuple[Floats, Ints]] = []
        self._names: list[str] = []

    def add(self, vertices: Floats, triangles: Ints, matrix: Floats, name: str) -> None:
        """One piece, placed by a matrix (4, 4); a mirroring one turns the winding."""
        self._left -= 1 + max(len(triangles), len(vertices) // 3)
        if self._left < 0:
            problem = "places its parts so often that it grows out of all proportion"
            rule = "at most a million triangles, or one per four bytes of the file"
            raise self._source.error(problem, rule, "export it flattened")
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
            finding = f"part {name[:60]!r}: triangles refer to vertices that do not exist"
            raise self._source.error(finding, f"indices from 0 to {len(vertices) - 1}")
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles = triangles[:, ::-1]
        placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        self._pieces.append((placed, np.asarray(triangles, np.int64) + self._count))
        self._names.append(name[:80])
        self._count += len(vertices)

    def mesh(self, **declared: Any) -> RawMesh:
        """All pieces as one mesh, with their names."""
        vertices = np.concatenate([np.empty((0, 3)), *(vertices for vertices, _ in self._pieces)])
        triangles = np.concatenate([NO_TRIANGLES, *(triangles for _, triangles in self._pieces)])
        return RawMesh(vertices, triangles, part_names=tuple(self._names), **declared)


def flatten(
    source: Source, roots: list[tuple[Node, Floats]], children: Callable[[Node], list[tuple[Node, Floats]]]
) -> Iterator[tuple[Node, Floats]]:
    """Every node of a tree, placed (4, 4), depth first; `children` are placed in it. A cycle is refused."""
    most = max(10_000, len(source.data) // 10)  # nodes, each placed as often as it is named
    stack = [(node, matrix, 0) for node, matrix in reversed(roots)]
    for _ in range(most + 1):
        if not stack:
            return
        node, matrix, depth = stack.pop()
        if depth > _MAX_DEPTH:
            break
        if not np.isfinite(matrix).all():
            raise source.error("a node's transform is not finite", "finite numbers")
        yield node, matrix
        stack.extend((child, matrix @ local, depth + 1) for child, local in reversed(children(node)))
    rule = f"at most {most} nodes, {_MAX_DEPTH} deep"
    raise source.error("its scene refers to itself or has too many nodes", rule, "export it flattened")


def counted(*counts: tuple[int, str]) -> tuple[str, ...]:
    """Remarks in words of what occurred."""
    return tuple(f"{count} {what}" for count, what in counts if count)


MAX_CORNERS = 10_000  # of one polygon; cutting ears takes their square at worst: a second for this many


def triangulate(vertices: Floats, corners: Ints, sizes: Ints) -> Ints:
    """Triangles (T, 3) of planar polygons, winding kept, in their order; of less than three corners none.

    Polygons `sizes` (P,) of corners stand one after the other in `corners`, indices that exist.
    """
    first = np.cumsum(sizes) - sizes
    triangles, polygons = [NO_TRIANGLES], [np.empty(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]):
        which = np.flatnonzero(sizes == size)
        rings = corners[first[which, None] + np.arange(size)]
        points = vertices[rings]
        convex = np.ones(len(rings), bool)
        if size > 3:
            edge, normal = np.roll(points, -1, axis=1) - points, _newell(points)
            bend = np.einsum("pnk,pk->pn", np.cross(edge, np.roll(edge, -1, axis=1)), normal)
            convex = (bend >= -1e-9 * (normal**2).sum(axis=1)[:, None]).all(axis=1)
        step = np.arange(1, size - 1)
        fans = np.stack([np.zeros_like(step), step, step + 1], axis=1)
        triangles.append(rings[convex][:, fans].reshape(-1, 3))
        polygons.append(np.repeat(which[convex], size - 2))
        for index in np.flatnonzero(~convex):
            cut = rings[index][_ears(points[index])]
            triangles.append(cut)
            polygons.append(np.full(len(cut), which[index]))
    return np.concatenate(triangles)[np.argsort(np.concatenate(polygons), kind="stable")]


def _newell(points: Floats) -> Floats:
    centred = points - points[:, :1]
    return np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)


def _ears(points: Floats) -> Ints:
    """Triangles (n - 2, 3) of one polygon (n, 3), seen along its normal; fewer where corners coincide."""
    import mapbox_earcut

    normal = _newell(points[None])[0]
    drop = int(np.argmax(np.abs(normal)))
    flat = np.ascontiguousarray((points - points[0])[:, [(drop + 1) % 3, (drop + 2) % 3]])
    if normal[drop] < 0:
        flat[:, 0] *= -1  # counter-clockwise
    rings = np.array([len(flat)], np.uint32)
    cut = mapbox_earcut.triangulate_float64(flat, rings).reshape(-1, 3).astype(np.int64)
    side, other = flat[cut[:, 1]] - flat[cut[:, 0]], flat[cut[:, 2]] - flat[cut[:, 0]]
    turned = (side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0]).sum() < 0
    return cut[:, ::-1] if turned else cut


def numbers(text: bytes) -> Floats:
    """All numbers of a text that white space separates; ValueError where something else is among them."""
    if not (text := text.strip()):
        return np.empty(0)
    if b"\0" in text or b"," in text:
        raise ValueError("not a number")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older numpy warns where newer raises
        try:
            return np.fromstring(text, sep=" ")
        except DeprecationWarning as error:
            raise ValueError(str(error)) from None


def whole(values: Floats) -> Ints:
    """Numbers that must be whole as integers."""
    if not (np.abs(values) < 2**53).all() or (values != np.rint(values)).any():
        raise ValueError("not a whole number")
    return values.astype(np.int64)
