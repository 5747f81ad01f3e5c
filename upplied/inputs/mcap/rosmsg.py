"""ROS 1 and ROS 2 messages by the definition stored in the log: many payloads to columns at once.

Messages of one topic nearly always share one layout: only a string or a sequence of another length
moves the fields. So the definition is walked once per layout, and every payload whose lengths agree
is read by array operations. Nothing is assumed of a message but what its definition says.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from upplied.inputs.mcap.definitions import SIZES, DefinitionError, parse_definition, short_name
from upplied.inputs.mcap.layouts import MAX_DEPTH, Layout, PayloadError, Walk

Columns = dict[str, Any]

MAX_PATHS = 10_000  # fields of one message, with those of the messages in it
MAX_TEXT = 200  # characters of a name that are kept
MAX_WALKS = 20_000  # layouts of one channel; a log has a handful
_MAX_GROUPS = 32  # layouts of one payload length that are read by array operations


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

    Attributes
    ----------
    paths : frozenset of str
        Every path that a column can have; elements of a sequence of messages are ``name[].field``.

    Raises
    ------
    DefinitionError
        If the definition is empty, incomplete or endless.
    """

    def __init__(self, name: str, text: str, cdr: bool) -> None:
        self._messages = parse_definition(name, text)
        self._root = short_name(name)
        self._cdr = cdr
        self._walks = 0
        if not self._messages.get(self._root):
            raise DefinitionError(f"the definition of {name} is empty")
        found: list[str] = []
        self._collect(self._root, "", found, 0)
        self.paths = frozenset(path for path in found if not path.endswith("."))

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
        wanted = [path for path in wanted if path in self.paths]
        pieces: list[tuple[Columns, np.ndarray]] = []
        unreadable = 0
        for rows in _by_length(payloads):
            groups = 0
            while len(rows):
                groups, self._walks = groups + 1, self._walks + 1
                if self._walks > MAX_WALKS:
                    unreadable += len(rows)
                    break
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
                rows = rows[1:] if groups > _MAX_GROUPS else rows[~same]
        return (*_joined(pieces, wanted), unreadable)

    def _collect(self, message: str, prefix: str, found: list[str], depth: int) -> None:
        found.append(prefix or ".")  # an empty message counts too, or the walk could be endless
        if depth > MAX_DEPTH or len(found) > MAX_PATHS:
            raise DefinitionError("messages nest too deeply")
        for name, kind, size in self._messages[message]:
            if kind in SIZES or kind == "string":
                # A sequence of numbers or strings has no width that a column could have.
                if size is None or (size >= 0 and kind != "string"):
                    found.append(prefix + name)
            else:
                self._collect(kind, f"{prefix}{name}{'' if size is None else '[]'}.", found, depth + 1)

    def _layout(self, payload: bytes, wanted: set[str]) -> Layout:
        return Walk(self._messages, payload, self._cdr, wanted).run(self._root)


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
