"""ROS 1 and ROS 2 messages by the definition stored in the log: many payloads to columns at once.

Messages of one topic nearly always share one layout: only a string or a sequence of another length
moves the fields. So the definition is walked once per layout, and every payload whose lengths agree
is read by array operations. Nothing is assumed of a message but what its definition says.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

Columns = dict[str, Any]

_SIZES = {
    "bool": ("u1", 1), "byte": ("u1", 1), "char": ("u1", 1), "int8": ("i1", 1), "uint8": ("u1", 1),
    "int16": ("i2", 2), "uint16": ("u2", 2), "int32": ("i4", 4), "uint32": ("u4", 4), "float32": ("f4", 4),
    "int64": ("i8", 8), "uint64": ("u8", 8), "float64": ("f8", 8),
}  # fmt: skip
_LINE = re.compile(
    r"(?P<kind>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?(?P<size>\d*)\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<const>=)?"
)
MAX_TEXT = 200  # characters of a name that are kept
_MAX_DEPTH = 16  # of messages in messages
_MAX_GROUPS = 32  # layouts of one payload length that are read by array operations


class DefinitionError(ValueError):
    """The definition in the log cannot be used."""


class PayloadError(ValueError):
    """A payload does not fit its definition."""


class Field(NamedTuple):
    """One field: `size` is None for a single value, -1 for a sequence, else the fixed length."""

    name: str
    kind: str
    size: int | None


@dataclass(frozen=True)
class Layout:
    """Where the wanted values of one payload lie, and which bytes must agree for that to hold."""

    guards: list[int]  # bytes that must equal those of the payload the layout was made from
    leaves: dict[str, list[tuple[int, str, int | None]]]  # path -> (offset, dtype or "S", count) per element
    elements: int


class RosDecoder:
    """Reads columns from the payloads of one schema.

    Parameters
    ----------
    name : str
        Of the message, e.g. ``geometry_msgs/msg/PoseStamped``.
    text : str
        The definition with those of the messages it contains, as stored in the log.
    cdr : bool
        ROS 2 (aligned, four bytes of encapsulation) or ROS 1 (packed, little endian).
    """

    def __init__(self, name: str, text: str, cdr: bool) -> None:
        self._messages = parse_definition(name, text)
        self._root = _short(name)
        self._cdr = cdr
        if not self._messages.get(self._root):
            raise DefinitionError(f"the definition of {name} is empty")

    def paths(self) -> set[str]:
        """Every path that a column can have; elements of a sequence of messages are ``name[].field``."""
        found: set[str] = set()
        self._collect(self._root, "", found, 0)
        return found

    def columns(self, payloads: Sequence[bytes], wanted: Iterable[str]) -> tuple[Columns, np.ndarray, int]:
        """The wanted values of many payloads.

        Parameters
        ----------
        payloads : sequence of bytes
        wanted : iterable of str
            Paths such as ``header.stamp.sec`` or ``transforms[].transform.rotation.w``.

        Returns
        -------
        columns : dict of str to array, shape (R,) or (R, k)
        row : array, shape (R,)
            Which payload each value is from, increasing.
        unreadable : int
            Payloads that do not fit the definition.
        """
        wanted = [path for path in wanted if path in self.paths()]
        pieces: list[tuple[Columns, np.ndarray]] = []
        unreadable = 0
        for rows in _by_length(payloads):
            groups = 0
            while len(rows):
                groups += 1
                try:
                    layout = self._layout(payloads[rows[0]], set(wanted))
                except PayloadError:
                    unreadable, rows = unreadable + 1, rows[1:]
                    continue
                taken = rows if groups <= _MAX_GROUPS else rows[:1]
                block = np.frombuffer(b"".join([payloads[row] for row in taken]), np.uint8)
                block = block.reshape(len(taken), -1)
                same = (block[:, layout.guards] == block[0, layout.guards]).all(axis=1)
                pieces.append((_gather(block[same], layout, wanted), np.repeat(taken[same], layout.elements)))
                rows = np.setdiff1d(rows, taken[same], assume_unique=True)
        return (*_joined(pieces, wanted), unreadable)

    def _collect(self, message: str, prefix: str, found: set[str], depth: int) -> None:
        if depth > _MAX_DEPTH or len(found) > 10_000:
            raise DefinitionError("messages nest too deeply")
        for name, kind, size in self._messages[message]:
            if kind in _SIZES or kind == "string":
                # A sequence of numbers or strings has no width that a column could have.
                if size is None or (size >= 0 and kind != "string"):
                    found.add(prefix + name)
            else:
                self._collect(kind, f"{prefix}{name}{'' if size is None else '[]'}.", found, depth + 1)

    def _layout(self, payload: bytes, wanted: set[str]) -> Layout:
        return _Walk(self._messages, payload, self._cdr, wanted).run(self._root)


@dataclass
class _Walk:
    """One walk over one payload."""

    messages: Mapping[str, tuple[Field, ...]]
    payload: bytes
    cdr: bool
    wanted: set[str]
    at: int = 0
    steps: int = 0
    order: str = "<"
    guards: list[int] = field(default_factory=list)
    leaves: dict[str, list[tuple[int, str, int | None]]] = field(default_factory=dict)

    def run(self, root: str) -> Layout:
        if self.cdr:
            if len(self.payload) < 4 or self.payload[0] != 0 or self.payload[1] > 3:
                raise PayloadError("no CDR encapsulation")
            self.order = "<" if self.payload[1] & 1 else ">"
            self.guards += [0, 1]
            self.at = 4
        self.message(root, "", 0)
        if self.at > len(self.payload):
            raise PayloadError("payload is short")
        counts = {len(self.leaves.get(path, ())) for path in self.wanted if "[]" in path} or {1}
        if len(counts) > 1:
            raise PayloadError("sequences of different length")
        return Layout(self.guards, self.leaves, counts.pop())

    def message(self, name: str, prefix: str, depth: int) -> None:
        fields = self.messages[name]
        self.step(depth)
        if not fields:
            self.at += 1 if self.cdr else 0  # IDL has no empty structure, ROS 2 adds a byte
        for part in fields:
            if part.kind in _SIZES or part.kind == "string":
                self.primitive(part, prefix + part.name)
            elif part.size is None:
                self.message(part.kind, f"{prefix}{part.name}.", depth + 1)
            else:
                for _ in range(self.length(part.size)):
                    self.message(part.kind, f"{prefix}{part.name}[].", depth + 1)

    def primitive(self, part: Field, path: str) -> None:
        self.step(0)
        count = None if part.size is None else self.length(part.size)
        if part.kind == "string":
            for _ in range(1 if count is None else count):
                self.step(0)
                size = self.length(-1)
                if count is None:
                    self.leaf(
                        path, "S", max(size - 1, 0) if self.cdr else size
                    )  # CDR counts the closing zero
                self.at += size
            return
        dtype, size = _SIZES[part.kind]
        if self.cdr and count != 0:
            self.at += -(self.at - 4) % size
        if part.size != -1:
            self.leaf(path, self.order + dtype, count)
        self.at += size * (1 if count is None else count)

    def leaf(self, path: str, dtype: str, count: int | None) -> None:
        if path in self.wanted:
            self.leaves.setdefault(path, []).append((self.at, dtype, count))

    def length(self, size: int) -> int:
        if size >= 0:
            return size
        if self.cdr:
            self.at += -(self.at - 4) % 4
        if self.at + 4 > len(self.payload):
            raise PayloadError("payload is short")
        self.guards += range(self.at, self.at + 4)
        (count,) = struct.unpack_from(self.order + "I", self.payload, self.at)
        self.at += 4
        if count > len(self.payload):
            raise PayloadError("a length exceeds the payload")
        return int(count)

    def step(self, depth: int) -> None:
        # Empty messages take no bytes, so a hostile definition could make this walk endless.
        self.steps += 1
        if depth > _MAX_DEPTH or self.at > len(self.payload) or self.steps > 10_000 + len(self.payload):
            raise PayloadError("payload and definition do not fit")


def parse_definition(name: str, text: str) -> dict[str, tuple[Field, ...]]:
    """The fields of a message and of those it contains, by short name (``package/Message``)."""
    messages: dict[str, tuple[Field, ...]] = {
        "builtin_interfaces/Time": (Field("sec", "int32", None), Field("nanosec", "uint32", None)),
        "builtin_interfaces/Duration": (Field("sec", "int32", None), Field("nanosec", "uint32", None)),
        "time": (Field("sec", "uint32", None), Field("nanosec", "uint32", None)),
        "duration": (Field("sec", "int32", None), Field("nanosec", "int32", None)),
    }
    current = _short(name)
    for block in re.split(r"^={3,}\s*$", text, flags=re.MULTILINE):
        header = re.search(r"^\s*MSG:\s*(\S+)\s*$", block, flags=re.MULTILINE)
        if header:
            current = _short(header.group(1))
            block = block.replace(header.group(0), "", 1)
        messages[current] = tuple(_fields(current.split("/")[0], block))
    for owner, parts in messages.items():
        for part in parts:
            if part.kind not in _SIZES and part.kind != "string" and part.kind not in messages:
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
    if kind in _SIZES or kind in ("string", "time", "duration"):
        return kind
    if kind == "Header":
        return "std_msgs/Header"
    return _short(kind) if "/" in kind else f"{package}/{kind}"


def _short(name: str) -> str:
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def _by_length(payloads: Sequence[bytes]) -> list[np.ndarray]:
    sizes = np.fromiter(map(len, payloads), np.int64, len(payloads))
    return [np.flatnonzero(sizes == size) for size in np.unique(sizes)]


def _gather(block: np.ndarray, layout: Layout, wanted: Sequence[str]) -> Columns:
    columns = {}
    for path in wanted:
        found = layout.leaves.get(path, [])
        parts = [_leaf(block, *leaf) for leaf in found]
        if len(parts) == 1 and layout.elements != 1:
            parts *= layout.elements
        # message by message, within a message element by element
        columns[path] = np.stack(parts, axis=1).reshape(-1, *parts[0].shape[1:]) if parts else np.empty(0)
    return columns


def _leaf(block: np.ndarray, at: int, dtype: str, count: int | None) -> np.ndarray:
    if dtype == "S":
        return _texts(block[:, at : at + min(count or 0, MAX_TEXT)])
    width = np.dtype(dtype).itemsize * (1 if count is None else count)
    values = np.ascontiguousarray(block[:, at : at + width]).view(dtype)
    values = values.astype(np.dtype(dtype).newbyteorder("="), copy=False)
    return values[:, 0] if count is None else values


def _texts(block: np.ndarray) -> np.ndarray:
    """Strings of one length as objects: most often all are the same."""
    if not block.shape[1] or (block == block[0]).all():
        return np.full(len(block), block[0].tobytes().decode("utf-8", "replace"), object)
    raw = np.ascontiguousarray(block).view(f"V{block.shape[1]}")[:, 0].tolist()
    known = {piece: piece.decode("utf-8", "replace") for piece in set(raw)}
    return np.array([known[piece] for piece in raw], object)


def _joined(pieces: list[tuple[Columns, np.ndarray]], wanted: Sequence[str]) -> tuple[Columns, np.ndarray]:
    pieces = [piece for piece in pieces if len(piece[1])]
    if not pieces:
        return {path: np.empty(0) for path in wanted}, np.empty(0, np.int64)
    row = np.concatenate([row for _, row in pieces])
    order = np.argsort(row, kind="stable")
    columns = {path: np.concatenate([columns[path] for columns, _ in pieces])[order] for path in wanted}
    return columns, row[order]
