"""The reader of each format, by suffix, held against the content; what to do with those not read."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from upplied.errors import UppliedError
from upplied.inputs.files import table
from upplied.inputs.formats import clouds, gltf, obj, ply, scenes
from upplied.inputs.raw import RawMesh, Source
from upplied.inputs.repair import used_vertices

READERS: dict[str, Callable[[Source], RawMesh]] = {
    "ply": ply.read_ply, "stl": obj.read_stl, "obj": obj.read_obj, "off": obj.read_off,
    "glb": gltf.read_gltf, "gltf": gltf.read_gltf, "dae": scenes.read_collada, "3mf": scenes.read_threemf,
    "pcd": clouds.read_pcd, "las": clouds.read_las, "laz": clouds.read_las, "e57": clouds.read_e57,
}  # fmt: skip

_KNOWN = f"one of {', '.join(READERS)}"
_TABLES = table("kinds.toml")["mesh"]
#: Formats that are not read, and what to do with each.
REFUSED: dict[str, str] = _TABLES["refused"]
SAME: dict[str, str] = _TABLES["same"]
_MAGIC = {name: re.compile(pattern.encode("ascii")) for name, pattern in _TABLES["bytes"].items()}
_OBJ = re.compile(rb"^[ \t]*(v|f|vn|vt|o|g|mtllib|usemtl)[ \t]+\S", re.MULTILINE)


def read_raw(path: Path | str) -> tuple[RawMesh, str]:
    """What a mesh or point cloud file holds, and the SHA-256 of all bytes read.

    Raises InputError where it is missing, damaged, not what its suffix says, or of a format that is not read.
    """
    source = Source(path)
    suffix = source.path.suffix.lower().removeprefix(".")
    _check_content(source, SAME.get(suffix, suffix))
    try:
        with np.errstate(all="ignore"):  # garbage among the numbers is found by the checks below
            raw = READERS[suffix](source)
    except UppliedError:
        raise
    except Exception as error:  # whatever a damaged file provokes leaves as one kind of error
        finding = f"cannot be understood as {suffix.upper()} ({type(error).__name__}: {str(error)[:120]})"
        raise source.error(finding, "a complete file of its format") from None
    if not len(raw.vertices):
        raise source.error("holds no triangles and no points", "a mesh or a point cloud")
    used = used_vertices(raw.triangles, len(raw.vertices))  # points of clouds without a position are dropped
    if not np.isfinite(raw.vertices[used]).all():
        raise source.error("has vertices that are not finite", "finite coordinates")
    return raw, source.sha256.hexdigest()


def _check_content(source: Source, suffix: str) -> None:
    if not source.data:
        raise source.error("is empty (0 bytes)", "a mesh or point cloud", "export or copy the file again")
    content = content_of(source.data)
    if suffix in READERS and content in ("", suffix):
        return
    if {suffix, content} <= {"glb", "gltf"} or {suffix, content} <= {"las", "laz"}:
        raise source.error(f"is {content.upper()} by its content", "the suffix of it", f"name it .{content}")
    refused = content if content in REFUSED else suffix
    if refused in REFUSED:
        raise source.error(f"is {refused.upper()}, which is not read", _KNOWN, REFUSED[refused])
    if suffix not in READERS:
        raise source.error(f"has the suffix .{suffix[:20]}", _KNOWN, "export it in one of these formats")
    remedy = f"name it .{content}, or export it again" if content in READERS else "export it again"
    raise source.error(f"is named .{suffix} but holds {content.upper()}", "suffix and content agree", remedy)


def content_of(data: bytes) -> str:
    """What the first bytes of a file say it is: a suffix without its dot; empty where nothing is known."""
    head = data[:8192]
    for name, pattern in _MAGIC.items():
        if pattern.match(head):
            if name == "las" and data[104:105] >= b"\x40":  # bits of its point format say that it is packed
                return "laz"
            return "3mf" if name == "zip" and re.search(rb"(?i)3D/[^\0]{1,200}\.model", data) else name
    binary_stl = len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    if binary_stl or obj.is_text_stl(data):
        return "stl"
    return "obj" if b"\0" not in head and _OBJ.search(head) else ""
