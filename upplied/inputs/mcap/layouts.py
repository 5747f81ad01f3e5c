"""Where the values of one ROS message lie: a walk over its bytes by its definition."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from upplied.inputs.mcap.definitions import SIZES, Field

MAX_DEPTH = 16  # of messages in messages


class PayloadError(ValueError):
    """A payload does not fit its definition."""


@dataclass(frozen=True)
class Layout:
    """Where the wanted values of one payload lie, and which bytes must agree for that to hold."""

    guards: list[int]  # bytes that must equal those of the payload the layout was made from
    leaves: dict[str, list[tuple[int, str, int | None]]]  # path -> (offset, dtype or "S", count) per element
    elements: int


@dataclass
class Walk:
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
        """The layout of the payload, or a `PayloadError` where it does not fit the definition."""
        if self.cdr:
            if len(self.payload) < 4 or self.payload[0] != 0 or self.payload[1] > 3:
                raise PayloadError("no CDR encapsulation")
            self.order = "<" if self.payload[1] & 1 else ">"
            self.guards += [0, 1]
            self.at = 4
        self._message(root, "", 0)
        if self.at > len(self.payload):
            raise PayloadError("payload is short")
        counts = {len(self.leaves.get(path, ())) for path in self.wanted if "[]" in path} or {1}
        if len(counts) > 1:
            raise PayloadError("sequences of different length")
        return Layout(self.guards, self.leaves, counts.pop())

    def _message(self, name: str, prefix: str, depth: int) -> None:
        fields = self.messages[name]
        self._step(depth)
        if not fields:
            self.at += 1 if self.cdr else 0  # IDL has no empty structure, ROS 2 adds a byte
        for part in fields:
            if part.kind in SIZES or part.kind == "string":
                self._primitive(part, prefix + part.name)
            elif part.size is None:
                self._message(part.kind, f"{prefix}{part.name}.", depth + 1)
            else:
                for _ in range(self._length(part.size)):
                    self._message(part.kind, f"{prefix}{part.name}[].", depth + 1)

    def _primitive(self, part: Field, path: str) -> None:
        self._step(0)
        count = None if part.size is None else self._length(part.size)
        if part.kind == "string":
            for _ in range(1 if count is None else count):
                self._step(0)
                size = self._length(-1)
                if count is None:  # CDR counts the closing zero
                    self._leaf(path, "S", max(size - 1, 0) if self.cdr else size)
                self.at += size
            return
        dtype, size = SIZES[part.kind]
        if self.cdr and count != 0:
            self.at += -(self.at - 4) % size
        if part.size != -1:
            self._leaf(path, self.order + dtype, count)
        self.at += size * (1 if count is None else count)

    def _leaf(self, path: str, dtype: str, count: int | None) -> None:
        if path in self.wanted:
            self.leaves.setdefault(path, []).append((self.at, dtype, count))

    def _length(self, size: int) -> int:
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

    def _step(self, depth: int) -> None:
        # Empty messages take no bytes, so a hostile definition could make this walk endless.
        self.steps += 1
        if depth > MAX_DEPTH or self.at > len(self.payload) or self.steps > 10_000 + len(self.payload):
            raise PayloadError("payload and definition do not fit")
