"""What a file is by its first bytes, whatever its name says, and what to do with formats not read."""

from __future__ import annotations

import re

#: Formats that are not read, and what to do with each.
REFUSED = {
    "step": "tessellate it in a CAD program (e.g. FreeCAD: open, select, File > Export > STL or OBJ)",
    "iges": "tessellate it in a CAD program (e.g. FreeCAD: open, select, File > Export > STL or OBJ)",
    "ifc": "tessellate it (e.g. `IfcConvert model.ifc model.glb`)",
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
SAME = {
    "stp": "step", "igs": "iges", "wrl": "x3d", "usdz": "usd", "usda": "usd", "usdc": "usd", "htm": "html"
}  # fmt: skip
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


def content_of(data: bytes) -> str:
    """What the first bytes of a file say it is: a suffix without its dot; empty where nothing is known."""
    head = data[:8192]
    for pattern, name in _MAGIC:
        if re.match(pattern, head):
            if name == "las" and data[104:105] >= b"\x40":  # bits of its point format say that it is packed
                return "laz"
            return "3mf" if name == "zip" and re.search(rb"(?i)3D/[^\0]{1,200}\.model", data) else name
    if is_text_stl(data) or (
        len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    ):
        return "stl"
    return "obj" if b"\0" not in head and _OBJ.search(head) else ""


def is_text_stl(data: bytes) -> bool:
    """Whether an STL is text: some binary ones start with `solid` as well."""
    return data[:80].lstrip()[:5].lower() == b"solid" and b"\0" not in data[:512]
