"""What a file is by its first bytes, whatever its name says, and what to do with formats not read."""

from __future__ import annotations

import re

from upplied.inputs.files import table

_TABLES = table("kinds.toml")["mesh"]
#: Formats that are not read, and what to do with each.
REFUSED: dict[str, str] = _TABLES["refused"]
SAME: dict[str, str] = _TABLES["same"]
_MAGIC = {name: re.compile(pattern.encode("ascii")) for name, pattern in _TABLES["bytes"].items()}
_OBJ = re.compile(rb"^[ \t]*(v|f|vn|vt|o|g|mtllib|usemtl)[ \t]+\S", re.MULTILINE)


def content_of(data: bytes) -> str:
    """What the first bytes of a file say it is: a suffix without its dot; empty where nothing is known."""
    head = data[:8192]
    for name, pattern in _MAGIC.items():
        if pattern.match(head):
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
