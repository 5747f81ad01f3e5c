"""Messages of the wanted channels as columns: one table per channel, whatever the encoding."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import zstandard

from upplied.errors import InputError
from upplied.inputs.mcap.definitions import DefinitionError
from upplied.inputs.mcap.objects import JsonDecoder, ProtobufDecoder
from upplied.inputs.mcap.recording import MAX_MESSAGES, Channel, Recording
from upplied.inputs.mcap.records import Sink
from upplied.inputs.mcap.rosmsg import RosDecoder
from upplied.records import Floats, Ints

_LARGEST = np.uint64(2**62)  # no stamp and no counter comes near
_BATCH_BYTES = 8 * 2**20  # payloads held before they are decoded
_MAX_CHANNELS = 500
_BATCH = 20_000  # messages
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no CDR begins so
_MAX_PAYLOAD_BYTES = 2**20  # a pose or a tree of transforms is far smaller


class Decoder(Protocol):
    """Turns payloads into columns."""

    def columns(self, payloads: Sequence[bytes], wanted: Iterable[str]) -> tuple[dict[str, Any], Ints, int]:
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
        """Messages a second by the recorder's clock."""
        span = float(np.ptp(self.log_ns)) * 1e-9 if len(self) > 1 else 0.0
        return (self.messages - 1) / span if span > 0 else 0.0


def read_tables(recording: Recording, fields: Callable[[Channel], Iterable[str]]) -> list[Table]:
    """The tables of every channel for which `fields` names paths, in one pass over the log."""
    builders: dict[int, _Builder] = {}

    def sink_of(channel: Channel) -> Sink | None:
        paths = tuple(fields(channel))
        if not paths:
            return None
        if len(builders) >= _MAX_CHANNELS:
            raise InputError(
                str(recording.path), f"holds more than {_MAX_CHANNELS} channels of poses", "fewer"
            )
        builder = builders[channel.channel_id] = _Builder(channel, paths)
        return builder.sink

    for _ in recording.read(sink_of):
        for builder in builders.values():
            if builder.is_full():
                held = sum(len(one) for one in builders.values())
                recording.check(held + len(builder.sink), MAX_MESSAGES, "messages of poses")
                builder.decode()
    tables = [builders[channel_id].table() for channel_id in sorted(builders)]
    recording.compare({table.channel.channel_id: table.messages for table in tables})
    return tables


def joined(tables: list[Table]) -> Table:
    """Several channels of one topic and schema as one table, in the order of their log times."""
    if len(tables) == 1:
        return tables[0]
    times = [np.column_stack([table.log_ns, table.publish_ns]) for table in tables]
    pieces = [(table.columns, stamps) for table, stamps in zip(tables, times, strict=True) if len(table)]
    together = np.concatenate(times)
    order = np.argsort(together[:, 0], kind="stable")
    paths = sorted({path for columns, _ in pieces for path in columns})
    return Table(
        channel=tables[0].channel,
        columns={path: _stacked(pieces, path)[order] for path in paths},
        log_ns=together[order, 0],
        publish_ns=together[order, 1],
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
    text = channel.schema.decode("utf-8", "replace")
    match channel.encoding, channel.schema_encoding:
        case "cdr", "ros2msg":
            return RosDecoder(channel.schema_name, text, cdr=True)
        case "ros1", "ros1msg":
            return RosDecoder(channel.schema_name, text, cdr=False)
        case "protobuf", "protobuf":
            return ProtobufDecoder(channel.schema_name, channel.schema)
        case "json", _:
            return JsonDecoder()
    raise DefinitionError(
        f"messages in {channel.encoding or 'no'} encoding, schema in {channel.schema_encoding or 'none'}"
    )


class _Builder:
    """Collects the messages of a channel and decodes them batch by batch."""

    def __init__(self, channel: Channel, paths: tuple[str, ...]) -> None:
        self.sink: Sink = []
        self._table = Table(channel)
        self._paths = paths
        self._rows = self._bytes = self._weighed = 0
        self._pieces: list[tuple[dict[str, Any], Ints]] = []  # columns, (R, 2) log and publish time
        self._decoder: Decoder | None = None
        try:
            self._decoder = decoder_for(channel)
        except DefinitionError as error:
            self._table.problem = str(error)

    def __len__(self) -> int:
        return self._rows

    def is_full(self) -> bool:
        """Whether enough messages wait to be decoded."""
        self._bytes += sum([len(message[2]) for message in self.sink[self._weighed :]])
        self._weighed = len(self.sink)
        return self._weighed >= _BATCH or self._bytes > _BATCH_BYTES

    def table(self) -> Table:
        """What was collected, decoded."""
        self.decode()
        names = sorted({name for columns, _ in self._pieces for name in columns})
        self._table.columns = {name: _stacked(self._pieces, name) for name in names}
        if self._pieces:
            times = np.concatenate([times for _, times in self._pieces])
            self._table.log_ns, self._table.publish_ns = times[:, 0], times[:, 1]
        return self._table

    def decode(self) -> None:
        """Turn the messages that wait into columns."""
        self._table.messages += len(self.sink)
        held = [message for message in self.sink if len(message[2]) <= _MAX_PAYLOAD_BYTES]
        if len(held) < len(self.sink):
            self._table.dropped["too large a message"] += len(self.sink) - len(held)
        self.sink.clear()
        self._bytes = self._weighed = 0
        if self._decoder is None or not held:
            return
        log_ns, publish_ns, payloads = zip(*held, strict=True)
        if self._table.channel.encoding == "cdr" and payloads[0].startswith(_ZSTD_MAGIC):
            payloads = tuple(map(_unwrapped, payloads))
        columns, row, unreadable = self._decoder.columns(payloads, self._paths)
        if unreadable:
            self._table.dropped["unreadable message"] += unreadable
        self._rows += len(row)
        if len(row):
            times = np.array([log_ns, publish_ns], np.uint64).T.astype(np.int64)
            self._pieces.append((columns, np.maximum(times, 0)[row]))


def _unwrapped(payload: bytes) -> bytes:
    """A message that rosbag2 compressed by itself; empty, and so unreadable, where it is damaged."""
    try:
        if zstandard.get_frame_parameters(payload).content_size > _MAX_PAYLOAD_BYTES:
            return b""
        return zstandard.ZstdDecompressor().decompress(payload, max_output_size=_MAX_PAYLOAD_BYTES)
    except zstandard.ZstdError:
        return b""


def _stacked(pieces: list[tuple[dict[str, Any], Ints]], name: str) -> Any:
    """A column over all batches; NaN or "" where a batch does not have it."""
    like = next(columns[name] for columns, _ in pieces if name in columns)
    is_text, parts = like.dtype == object, []
    for columns, times in pieces:
        part = columns.get(name)
        if part is None or part.shape[1:] != like.shape[1:] or (part.dtype == object) != is_text:
            shape = (len(times), *like.shape[1:])
            part = np.full(shape, "", object) if is_text else np.full(shape, np.nan)
        parts.append(part)
    return np.concatenate(parts)
