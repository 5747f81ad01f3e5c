"""Messages of the wanted channels as columns: one table per channel, whatever the encoding."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from upplied.inputs.mcap.objects import JsonDecoder, ProtobufDecoder
from upplied.inputs.mcap.recording import MAX_MESSAGES, Channel, Recording
from upplied.inputs.mcap.records import Message
from upplied.inputs.mcap.rosmsg import DefinitionError, RosDecoder
from upplied.records import Ints

_BATCH_BYTES = 8 * 2**20  # payloads held before they are decoded
_BATCH = 20_000  # messages
_MAX_PAYLOAD_BYTES = 2**20  # a pose or a tree of transforms is far smaller


class Decoder(Protocol):
    """Turns payloads into columns."""

    def columns(self, payloads: list[bytes], wanted: Iterable[str]) -> tuple[dict[str, Any], Ints, int]:
        """Columns, the payload each row is from, and how many payloads could not be read."""
        ...


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
        """Short name of the schema, whatever the encoding."""
        return self.channel.schema_short

    def __len__(self) -> int:
        return len(self.log_ns)

    def __contains__(self, path: str) -> bool:
        return path in self.columns

    def __getitem__(self, path: str) -> Any:
        return self.columns[path]

    def stack(self, *paths: str) -> Any:
        """Several columns side by side, as floats (N, k)."""
        return np.stack([np.asarray(self.columns[path], float) for path in paths], axis=-1)

    @property
    def rate_hz(self) -> float:
        """Messages a second by the recorder's clock."""
        span = float(np.ptp(self.log_ns)) * 1e-9 if len(self) > 1 else 0.0
        return (self.messages - 1) / span if span > 0 else 0.0


def read_tables(recording: Recording, fields: Callable[[Channel], Iterable[str]]) -> list[Table]:
    """The tables of every channel for which `fields` names paths, in one pass over the log."""
    builders: dict[int, _Builder] = {}

    def wanted(channel: Channel) -> bool:
        paths = tuple(fields(channel))
        if paths and channel.channel_id not in builders:
            builders[channel.channel_id] = _Builder(channel, paths)
        return bool(paths)

    for message in recording.messages(wanted):
        builders[message.channel_id].add(message)
        if len(builders[message.channel_id]) > _BATCH:
            recording.check(sum(map(len, builders.values())), MAX_MESSAGES, "poses")
    return [builders[channel_id].table() for channel_id in sorted(builders)]


def joined(tables: list[Table]) -> Table:
    """Several channels of one topic and schema as one table, in the order of their log times."""
    if len(tables) == 1:
        return tables[0]
    filled = [table for table in tables if len(table)] or tables[:1]
    paths = set.intersection(*(set(table.columns) for table in filled))
    order = np.argsort(np.concatenate([table.log_ns for table in filled]), kind="stable")
    return Table(
        channel=tables[0].channel,
        columns={path: np.concatenate([table[path] for table in filled])[order] for path in paths},
        log_ns=np.concatenate([table.log_ns for table in filled])[order],
        publish_ns=np.concatenate([table.publish_ns for table in filled])[order],
        messages=sum(table.messages for table in tables),
        dropped=sum((table.dropped for table in tables), Counter()),
        problem=next((table.problem for table in tables if table.problem), ""),
    )


def decoder_for(channel: Channel) -> Decoder:
    """The decoder for a channel, from the schema in the log.

    Raises
    ------
    DefinitionError
        If encoding and schema do not allow to decode it.
    """
    kinds: Mapping[tuple[str, str], Callable[[Channel], Decoder]] = {
        ("cdr", "ros2msg"): lambda c: RosDecoder(
            c.schema_name, c.schema.decode("utf-8", "replace"), cdr=True
        ),
        ("ros1", "ros1msg"): lambda c: RosDecoder(
            c.schema_name, c.schema.decode("utf-8", "replace"), cdr=False
        ),
        ("protobuf", "protobuf"): lambda c: ProtobufDecoder(c.schema_name, c.schema),
    }
    if channel.encoding == "json":
        return JsonDecoder()
    kind = kinds.get((channel.encoding, channel.schema_encoding))
    if kind is None:
        raise DefinitionError(
            f"messages in {channel.encoding or 'no'} encoding, schema in {channel.schema_encoding or 'none'}"
        )
    return kind(channel)


class _Builder:
    def __init__(self, channel: Channel, paths: tuple[str, ...]) -> None:
        self._table = Table(channel)
        self._paths = paths
        self._held: list[Message] = []
        self._bytes = self._rows = 0
        self._pieces: list[tuple[dict[str, Any], Ints, Ints]] = []
        self._decoder: Decoder | None = None
        try:
            self._decoder = decoder_for(channel)
        except DefinitionError as error:
            self._table.problem = str(error)

    def __len__(self) -> int:
        return self._rows

    def add(self, message: Message) -> None:
        self._table.messages += 1
        if self._decoder is None:
            return
        if len(message.payload) > _MAX_PAYLOAD_BYTES:
            self._table.dropped["too large a message"] += 1
            return
        self._held.append(message)
        self._bytes += len(message.payload)
        if self._bytes > _BATCH_BYTES or len(self._held) >= _BATCH:
            self._decode()

    def table(self) -> Table:
        self._decode()
        table, pieces = self._table, self._pieces
        if pieces:
            names = set.intersection(*(set(columns) for columns, _, _ in pieces))
            table.columns = {name: np.concatenate([piece[0][name] for piece in pieces]) for name in names}
            table.log_ns = np.concatenate([piece[1] for piece in pieces])
            table.publish_ns = np.concatenate([piece[2] for piece in pieces])
        return table

    def _decode(self) -> None:
        if self._decoder is None or not self._held:
            return
        held, self._held, self._bytes = self._held, [], 0
        columns, row, unreadable = self._decoder.columns([message.payload for message in held], self._paths)
        if unreadable:
            self._table.dropped["unreadable message"] += unreadable
        times = np.array(
            [(_signed(message.log_ns), _signed(message.publish_ns)) for message in held], np.int64
        )
        self._rows += len(row)
        if len(row):
            self._pieces.append((columns, times[row, 0], times[row, 1]))


def _signed(stamp: int) -> int:
    return stamp if stamp < 2**63 else 0
