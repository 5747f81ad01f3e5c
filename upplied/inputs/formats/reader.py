"""The reader of each format, chosen by suffix and held against the content."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from upplied.errors import UppliedError
from upplied.inputs.formats import collada, gltf, las, obj, off, pcd, ply, stl, threemf
from upplied.inputs.formats.raw import RawMesh, Source
from upplied.inputs.repair import used_vertices

READERS: dict[str, Callable[[Source], RawMesh]] = {
    "ply": ply.read_ply,
    "stl": stl.read_stl,
    "obj": obj.read_obj,
    "off": off.read_off,
    "glb": gltf.read_gltf,
    "gltf": gltf.read_gltf,
    "dae": collada.read_collada,
    "3mf": threemf.read_threemf,
    "pcd": pcd.read_pcd,
    "las": las.read_las,
}
#: Formats that are not read, and what to do with each.
REFUSED = {
    "step": "tessellate it in a CAD program (e.g. FreeCAD: open, select, File > Export > STL or OBJ)",
    "iges": "tessellate it in a CAD program (e.g. FreeCAD: open, select, File > Export > STL or OBJ)",
    "ifc": "tessellate it (e.g. `IfcConvert model.ifc model.glb`)",
    "laz": "unpack it (e.g. `laszip -i in.laz -o out.las`)",
    "e57": "save it as PLY in double precision (e.g. with CloudCompare)",
    "fbx": "export it as GLB or OBJ (e.g. from Blender)",
    "blend": "export it as GLB or OBJ from Blender",
    "ac": "export it as GLB or OBJ (e.g. from Blender, with its AC3D import)",
    "3ds": "export it as GLB or OBJ (e.g. from Blender)",
    "dwg": "export the surfaces as STL or OBJ from CAD",
    "dxf": "export the surfaces as STL or OBJ from CAD",
    "usd": "export it as GLB (e.g. from Blender)",
    "vtk": "export the surface as PLY or STL (e.g. with ParaView)",
    "x3d": "export it as GLB or OBJ (e.g. from Blender)",
    "skp": "export it as DAE or OBJ from SketchUp",
    "mcap": "it is a log: add it as a demonstration",
    "html": "it is a web page: download the file itself",
    "zip": "unpack it and name the mesh in it",
}
_SAME = {
    "stp": "step",
    "igs": "iges",
    "wrl": "x3d",
    "usdz": "usd",
    "usda": "usd",
    "usdc": "usd",
    "htm": "html",
}
# First bytes of each content; the order matters where one holds another.
_MAGIC: tuple[tuple[bytes, str], ...] = (
    (rb"ply\r?\n", "ply"),
    (rb"glTF", "glb"),
    (rb"LASF", "las"),
    (rb"PK\x03\x04", "zip"),
    (rb"\x89MCAP", "mcap"),
    (rb"ASTM-E57", "e57"),
    (rb"Kaydara FBX", "fbx"),
    (rb"BLENDER", "blend"),
    (rb"AC3D", "ac"),
    (rb"PXR-USDC|#usda", "usd"),
    (rb"#VRML|# vtk", "vtk"),
    (rb"\s*ISO-10303-21[\s\S]{0,4000}FILE_SCHEMA\s*\(\s*\(\s*'IFC", "ifc"),
    (rb"\s*ISO-10303-21", "step"),
    (rb"\s*(#[^\n]*\n\s*)*VERSION[ \t]+\.?[0-9.]+\s+FIELDS", "pcd"),
    (rb"\s*(ST)?C?N?4?n?OFF\b", "off"),
    (rb"\s*\{", "gltf"),
    (rb"(?i)\s*<(!doctype\s+)?html", "html"),
    (rb"(?i)(\xef\xbb\xbf)?\s*<[\s\S]{0,4000}?<COLLADA", "dae"),
    (rb"(?i)(\xef\xbb\xbf)?\s*<COLLADA", "dae"),
    (rb"(?i)(\xef\xbb\xbf)?\s*<", "xml"),
)
_OBJ = re.compile(rb"^[ \t]*(v|f|vn|vt|o|g|mtllib|usemtl)[ \t]+\S", re.MULTILINE)


def read_raw(path: Path | str) -> tuple[RawMesh, str]:
    """What a mesh or point cloud file holds, and the SHA-256 of all bytes read.

    Raises
    ------
    InputError
        Where the file is missing, empty, truncated, of another content than its suffix says, of a
        format that is not read (with what to do), or where anything in it is not as its format wants.
    """
    source = Source(path)
    suffix = source.path.suffix.lower().removeprefix(".")
    _check_content(source, _SAME.get(suffix, suffix))
    try:
        with np.errstate(all="ignore"):  # garbage among the numbers is found by the checks below
            raw = READERS[suffix](source)
    except UppliedError:
        raise
    except Exception as error:  # whatever a damaged file provokes leaves as one kind of error
        found = f"cannot be understood as {suffix.upper()} ({type(error).__name__}: {str(error)[:120]})"
        raise source.error(found, "a complete file of its format") from None
    return _checked(source, raw), source.sha256


def content_of(data: bytes) -> str:
    """What the first bytes of a file say it is: a suffix without its dot; empty where nothing is known."""
    head = data[:8192]
    for pattern, name in _MAGIC:
        if re.match(pattern, head):
            return "3mf" if name == "zip" and re.search(rb"(?i)3D/[^\0]{1,200}\.model", data) else name
    if stl.is_text(data) or (
        len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    ):
        return "stl"
    return "obj" if b"\0" not in head and _OBJ.search(head) else ""


def _check_content(source: Source, suffix: str) -> None:
    if not source.data:
        raise source.error("is empty (0 bytes)", "a mesh or point cloud", "export or copy the file again")
    content = content_of(source.data)
    if suffix in READERS and content in ("", suffix):
        return
    if {suffix, content} == {"glb", "gltf"}:
        raise source.error(
            f"is {content.upper()} by its content", "a suffix that says so", f"name it .{content}"
        )
    refused = content if content in REFUSED else suffix
    if refused in REFUSED:
        raise source.error(f"is {refused.upper()}, which is not read", _known(), REFUSED[refused])
    if suffix not in READERS:
        raise source.error(f"has the suffix .{suffix[:20]}", _known(), "export it in one of these formats")
    raise source.error(
        f"is named .{suffix} but holds {content.upper()}",
        "suffix and content agree",
        f"name it .{content}, or export it again" if content in READERS else "export it again",
    )


def _checked(source: Source, raw: RawMesh) -> RawMesh:
    """The same, or an error where nothing is there; points without a position are dropped from clouds."""
    if len(raw.triangles):
        if not np.isfinite(raw.vertices[used_vertices(raw.triangles, len(raw.vertices))]).all():
            raise source.error("has vertices that are not finite", "finite coordinates")
        return raw
    if len(raw.vertices) == 0:
        raise source.error("holds no triangles and no points", "a mesh or a point cloud")
    return raw


def _known() -> str:
    return f"one of {', '.join(READERS)}"
