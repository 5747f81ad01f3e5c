"""What the channels of a log say, as columns by path, whatever their encoding."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from upplied.records import Floats, Ints

_LARGEST = np.uint64(2**62)  # no stamp and no counter comes near

Piece = tuple[dict[str, Any], Ints]  # columns, and log and publish time (R, 2) of their rows


@dataclass(frozen=True)
class Channel:
    """One stream of messages of one schema."""

    channel_id: int
    topic: str
    encoding: str  # of the messages: cdr, ros1, protobuf, json; empty where they came as columns
    schema_name: str = ""
    schema_encoding: str = ""
    schema: bytes = b""

    @property
    def schema_short(self) -> str:
        """Name of the schema without what ROS 2, Foxglove and firmware versions put into it."""
        parts = self.schema_name.split("/")
        name = f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else self.schema_name
        if name.startswith("px4_msgs/"):
            name = re.sub(r"_?[vV]\d+$", "", name)
        return name.replace("foxglove_msgs/", "foxglove.", 1)


@dataclass
class Table:
    """What one channel says: columns by path, and when each row was recorded."""

    channel: Channel
    columns: dict[str, Any] = field(default_factory=dict)  # path -> (N,) or (N, k)
    log_ns: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    publish_ns: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    messages: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    problem: str = ""  # why no message of the channel can be read

    @property
    def schema(self) -> str:
        return self.channel.schema_short

    def __len__(self) -> int:
        return len(self.log_ns)

    def __contains__(self, path: str) -> bool:
        return path in self.columns

    def numbers(self, path: str) -> Floats:
        """A column (N,) of numbers; NaN where there is none."""
        column = self.columns.get(path)
        if column is None or column.dtype == object or column.ndim != 1:
            return np.full(len(self), np.nan)
        return np.asarray(column, float)

    def integers(self, path: str) -> Ints:
        """A column (N,) of whole numbers; 0 where there is none."""
        column = self.columns.get(path)
        if column is None or column.dtype.kind not in "biu" or column.ndim != 1:
            return np.nan_to_num(self.numbers(path)).clip(-(2.0**62), 2.0**62).astype(np.int64)
        if column.dtype == np.uint64:
            column = np.where(column > _LARGEST, np.uint64(0), column)
        return np.asarray(column).astype(np.int64)

    def vectors(self, path: str, width: int) -> Floats:
        """A column (N, width) of lists of numbers; NaN where there is none of this width."""
        column = self.columns.get(path)
        if column is None or column.dtype == object or column.shape != (len(self), width):
            return np.full((len(self), width), np.nan)
        return np.asarray(column, float)

    def texts(self, path: str) -> Any:
        """A column (N,) of str, as objects; empty where there is none."""
        column = self.columns.get(path)
        return column if column is not None and column.dtype == object else np.full(len(self), "", object)

    def stack(self, *paths: str) -> Floats:
        """Several columns of numbers side by side, (N, k)."""
        return np.stack([self.numbers(path) for path in paths], axis=-1)

    @property
    def rate_hz(self) -> float:
        span = float(np.ptp(self.log_ns)) * 1e-9 if len(self) > 1 else 0.0
        return (self.messages - 1) / span if span > 0 else 0.0


def joined(tables: list[Table]) -> Table:
    """Several channels of one topic and schema as one table, in the order of their log times."""
    if len(tables) == 1:
        return tables[0]
    columns, times = stacked([(it.columns, np.column_stack([it.log_ns, it.publish_ns])) for it in tables])
    order = np.argsort(times[:, 0], kind="stable")
    columns = {path: column[order] for path, column in columns.items()}
    messages, dropped = sum(it.messages for it in tables), sum((it.dropped for it in tables), Counter[str]())
    problem = next((it.problem for it in tables if it.problem), "")
    return Table(tables[0].channel, columns, times[order, 0], times[order, 1], messages, dropped, problem)


def stacked(pieces: Sequence[Piece]) -> Piece:
    """All pieces as one; NaN or "" where a piece does not have a column."""
    pieces = [piece for piece in pieces if len(piece[1])]
    if not pieces:
        return {}, np.empty((0, 2), np.int64)
    likes = {path: column for columns, _ in reversed(pieces) for path, column in columns.items()}
    whole = {}
    for path, like in sorted(likes.items()):
        whole[path] = np.concatenate([_like(like, piece.get(path), len(times)) for piece, times in pieces])
    return whole, np.concatenate([times for _, times in pieces])


def _like(like: Any, column: Any, rows: int) -> Any:
    is_text = like.dtype == object
    if column is not None and column.shape[1:] == like.shape[1:] and (column.dtype == object) == is_text:
        return column
    return np.full((rows, *like.shape[1:]), *(("", object) if is_text else (np.nan, float)))
