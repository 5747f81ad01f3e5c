"""ROS 1 and ROS 2 messages by the definition stored in the log: decoded by `rosbags`.

It takes a third of the time of `mcap-ros2-support`. It makes Python code of a definition: so it sees only
lines of a type and a name, and nothing that is large.
"""

import re
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

MAX_DEPTH = 16  # of messages in messages
MAX_PATHS = 10_000  # fields of one message, with those of the messages in it
_LISTS = ("d", "D")  # of a calibration: how its lens distorts
MAX_DEFINITION = 2**18  # characters
_LINE = re.compile(r"\s*([\w/]+(?:<=\d+)?(?:\[(?:<=)?\d*\])?)\s+([A-Za-z]\w*)\s*(=?)", re.ASCII)
_HEADER = re.compile(r"\s*MSG:\s*([\w/]+)\s*", re.ASCII)
_STAMP = "\n{0}\nMSG: builtin_interfaces/{1}\n{2} sec\nuint32 nanosec"  # where a definition leaves it out


class DefinitionError(ValueError):
    """The definition in the log cannot be used."""


@lru_cache(maxsize=64)  # recorders write the same definitions into every log, and code takes long to make
def ros_decoder(name: str, text: str, cdr: bool) -> tuple[Callable[[bytes], Any], frozenset[str]]:
    """What decodes the payloads of one schema, and every path that a column can have.

    The text is as stored in the log, with the messages that it contains; `cdr` is ROS 2 (aligned, four bytes
    of encapsulation), else ROS 1 (packed, little endian). Raises DefinitionError if it is empty, incomplete,
    endless, or lets few bytes tell of many messages.
    """
    if len(text) > MAX_DEFINITION or not re.fullmatch(r"[\w/]+", name, re.ASCII):
        raise DefinitionError(f"the definition of {name[:60]} has {len(text)} characters")
    lines = "\n".join(_lines(text))
    for kind, sec in {"Time": "int32" if cdr else "uint32", "Duration": "int32"}.items():
        if not re.search(rf"^MSG: builtin_interfaces/(msg/)?{kind}$", lines, re.MULTILINE):
            lines += _STAMP.format("=" * 80, kind, sec)
    store = Typestore()
    try:
        types = get_types_from_msg(lines.lstrip("\n") + "\n", name)
        root = next(iter(types))
        if not types[root][1]:
            raise DefinitionError(f"the definition of {name} is empty")
        paths = _Shape(types).measured(root)
        store.register(types)
        store.get_msgdef(root)
    except DefinitionError:
        raise
    except Exception as error:  # the library raises many kinds
        raise DefinitionError(f"the definition of {name} cannot be used ({type(error).__name__})") from None
    read = store.deserialize_cdr if cdr else store.deserialize_ros1
    return (lambda payload: read(payload, root)), paths


def _lines(text: str) -> Iterator[str]:
    """A definition line by line: types and names; no comment, constant or default value."""
    for line in text.splitlines():
        if re.fullmatch(r"={3,}\s*", line):
            yield "=" * 80
        elif header := _HEADER.fullmatch(line):
            yield f"MSG: {header[1]}"
        elif line.strip() and not line.strip().startswith("#"):
            if (match := _LINE.match(line)) is None:
                raise DefinitionError(f"cannot read the line {line.strip()[:60]!r}")
            if not match[3]:
                yield f"{match[1]} {match[2]}"


class _Shape:
    """What the messages of a definition hold at least: a bound on what bytes can make of them."""

    def __init__(self, types: Any) -> None:
        self._types, self._paths, self._seen = types, set[str](), 0

    def measured(self, root: str) -> frozenset[str]:
        """Every path that a column can have; elements of a sequence of messages are ``name[].field``."""
        self._measure(root, "", 0)
        return frozenset(self._paths)

    def _measure(self, message: str, prefix: str, depth: int) -> tuple[int, int]:
        """How many values a message holds at least, and how many bytes."""
        if message not in self._types:
            raise DefinitionError(f"it holds a {message}, which is not defined")
        number = size = 0 if self._types[message][1] else 1  # IDL has no empty structure: ROS 2 adds a byte
        for name, (node, detail) in self._types[message][1]:
            self._seen += 1
            if depth > MAX_DEPTH or self._seen > MAX_PATHS:
                raise DefinitionError("messages nest too deeply")
            many, fixed = node in (Nodetype.ARRAY, Nodetype.SEQUENCE), node == Nodetype.ARRAY
            (inner, kind), length = detail if many else ((node, detail), 1)
            if length < fixed or length > 2**20:
                raise DefinitionError(f"{name} is an array of {length}")
            if inner == Nodetype.NAME:
                parts, width = self._measure(kind, f"{prefix}{name}{'[]' if many else ''}.", depth + 1)
                if many and width < parts:
                    raise DefinitionError(f"{name} repeats messages without content")
            else:
                numeric = kind[0] != "string"
                parts, width = 1, SIZEMAP[kind[0]] if numeric else 4
                # A sequence has no width that a column could have, but for that of coefficients.
                listed = prefix + name in _LISTS and kind[0] == "float64"
                if prefix.count("[]") < 2 and (not many or (fixed and numeric) or listed):
                    self._paths.add(prefix + name)
            number += parts * (length if fixed and (inner == Nodetype.NAME or not numeric) else 1)
            size += 4 if node == Nodetype.SEQUENCE else length * width
            if number > MAX_PATHS:
                raise DefinitionError("messages hold too many values")
        return number, size
