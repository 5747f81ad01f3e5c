"""Message definitions of ROS 1 and ROS 2, as text in the schema of a log."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

SIZES = {
    "bool": ("u1", 1), "byte": ("u1", 1), "char": ("u1", 1), "int8": ("i1", 1), "uint8": ("u1", 1),
    "int16": ("i2", 2), "uint16": ("u2", 2), "int32": ("i4", 4), "uint32": ("u4", 4), "float32": ("f4", 4),
    "int64": ("i8", 8), "uint64": ("u8", 8), "float64": ("f8", 8),
}  # fmt: skip
_LINE = re.compile(
    r"(?P<kind>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?(?P<size>\d*)\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<const>=)?"
)


class DefinitionError(ValueError):
    """The definition in the log cannot be used."""


class Field(NamedTuple):
    """One field: `size` is None for a single value, -1 for a sequence, else the fixed length."""

    name: str
    kind: str
    size: int | None


def parse_definition(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """The fields of a message and of those it contains, by short name (``package/Message``)."""
    messages: dict[str, tuple[Field, ...]] = {
        "builtin_interfaces/Time": (Field("sec", "int32", None), Field("nanosec", "uint32", None)),
        "builtin_interfaces/Duration": (Field("sec", "int32", None), Field("nanosec", "uint32", None)),
        "time": (Field("sec", "uint32", None), Field("nanosec", "uint32", None)),
        "duration": (Field("sec", "int32", None), Field("nanosec", "int32", None)),
    }
    current = short_name(name)
    for block in re.split(r"^={3,}\s*$", text, flags=re.MULTILINE):
        header = re.search(r"^\s*MSG:\s*(\S+)\s*$", block, flags=re.MULTILINE)
        if header:
            current = short_name(header.group(1))
            block = block.replace(header.group(0), "", 1)
        messages[current] = tuple(_fields(current.split("/")[0], block))
    for owner, parts in messages.items():
        for part in parts:
            if part.kind not in SIZES and part.kind != "string" and part.kind not in messages:
                raise DefinitionError(f"{owner} holds a {part.kind}, which is not defined")
    return messages


def _fields(package: str, block: str) -> Iterable[Field]:
    for line in block.splitlines():
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        match = _LINE.match(line)
        if match is None:
            raise DefinitionError(f"cannot read the line {line[:60]!r}")
        if match["const"]:
            continue
        size = None if match["array"] is None else -1
        if match["size"] and "<=" not in match["array"]:
            size = int(match["size"])
        yield Field(match["name"], _resolved(match["kind"], package), size)


def _resolved(kind: str, package: str) -> str:
    if kind in SIZES or kind in ("string", "time", "duration"):
        return kind
    if kind == "Header":
        return "std_msgs/Header"
    return short_name(kind) if "/" in kind else f"{package}/{kind}"


def short_name(name: str) -> str:
    """``package/Message`` of a message's full name."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"
