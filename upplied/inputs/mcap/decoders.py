"""Messages of the wanted channels as columns: ROS by `rosbags`, protobuf by `mcap-protobuf-support`, JSON.

A missing value becomes NaN. In paths into one sequence (``transforms[].rotation.w``) a row is an element.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
import zstandard
from google.protobuf.message import Message
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from upplied.inputs.mcap.recording import MAX_MESSAGES, Recording, Sink
from upplied.inputs.mcap.rosmsg import DefinitionError, ros_decoder
from upplied.inputs.tables import Channel, Piece, Table, stacked
from upplied.records import Ints

Columns = dict[str, Any]

MAX_TEXT = 200  # characters of a name that are kept
# The same word in the three worlds: ROS 2, protobuf and JSON.
_ALIASES = {"sec": ("sec", "seconds", "secs"), "nanosec": ("nanosec", "nanos", "nsec", "nsecs")}
_MAX_WIDTH = 64  # numbers in one value; a calibration has 12


class Decoder:
    """Reads columns from the payloads of one channel; DefinitionError if its schema does not allow it.

    `paths` is every path that a column can have, where the schema tells.
    """

    def __init__(self, channel: Channel) -> None:
        name, text = channel.schema_name, channel.schema.decode("utf-8", "replace")
        self.paths: frozenset[str] | None = None
        self._decode: Callable[[bytes], Any] = json.loads
        match channel.encoding, channel.schema_encoding:
            case ("cdr", "ros2msg") | ("ros1", "ros1msg"):
                self._decode, self.paths = ros_decoder(name, text, channel.encoding == "cdr")
            case "protobuf", "protobuf":
                self._decode = _protobuf(name, channel.schema)
            case other if other[0] != "json":
                encoding, schema = (word or "no" for word in other)
                raise DefinitionError(f"messages in {encoding} encoding, schema in {schema} encoding")

    def columns(
        self, payloads: Sequence[bytes], names: Iterable[str], most: int = 10**9
    ) -> tuple[Columns, Ints, int]:
        """The wanted values of payloads, `most` rows, of each its payload (R,), and how many are damaged."""
        known = [path for path in names if self.paths is None or path in self.paths]
        many = next((path.split("[]")[0] for path in known if "[]" in path), "")
        plain = [path for path in known if "[]" not in path]
        inner = [path for path in known if many and path.startswith(f"{many}[].")]
        get, get_inner = self._getter(plain), self._getter([path[len(many) + 3 :] for path in inner])
        get_elements = self._getter([many])
        rows, values, unreadable = list[int](), list[tuple[Any, ...]](), 0
        for row, payload in enumerate(payloads):
            try:
                message = self._decode(payload)
                row_values = [get(message)]
                if many:
                    inner_values = (get_inner(element) for element in get_elements(message)[0] or ())
                    row_values = [row_values[0] + each for each in inner_values]
            except Exception:  # whatever the bytes of one message do to a library
                unreadable += 1
                continue
            rows += [row] * len(row_values)
            values += row_values
            if len(values) > most:
                break
        paths = plain + inner
        parts = zip(paths, zip(*values, strict=True) if values else [()] * len(paths), strict=True)
        columns = {path: column for path, part in parts if (column := _column(part)) is not None}
        return columns, np.array(rows, np.int64), unreadable

    def _getter(self, paths: Sequence[str]) -> Callable[[Any], tuple[Any, ...]]:
        if self.paths is not None and len(paths) > 1:
            return attrgetter(*paths)
        steps = [[_ALIASES.get(step, (step,)) for step in path.split(".")] for path in paths]
        return lambda message: tuple([_walk(message, way) for way in steps])


def _protobuf(name: str, schema: bytes) -> Callable[[bytes], Any]:
    try:
        record = Schema(id=1, name=name, encoding="protobuf", data=schema)
        decode = DecoderFactory().decoder_for("protobuf", record)
        if decode is None or decode(b"") is None:
            raise TypeError(name)
        return decode
    except Exception as error:  # the descriptor library raises many kinds on hostile bytes
        raise DefinitionError(f"its descriptors cannot be used ({type(error).__name__})") from None


def _walk(value: Any, steps: list[tuple[str, ...]]) -> Any:
    for names in steps:
        if isinstance(value, dict):
            value = next((value[name] for name in names if name in value), None)
        elif isinstance(value, Message):
            fields = value.DESCRIPTOR.fields_by_name
            field = next((fields[name] for name in names if name in fields), None)
            if field is None or (field.has_presence and not value.HasField(field.name)):
                return None
            value = getattr(value, field.name)
        else:
            value = getattr(value, names[0], None)
    return value


def _column(values: Sequence[Any]) -> Any:
    """A column of numbers, of lists of numbers, or of text; None where there is nothing."""
    if all(isinstance(value, float) for value in values):
        return np.array(values)
    if not (present := [value for value in values if value is not None]):
        return None
    if all(isinstance(value, int | float) for value in present):
        whole = len(present) == len(values) and all(type(value) is int for value in values)
        column = np.array(values) if whole else None
        fits = column is not None and column.dtype.kind in "iu"
        return column if fits else np.array([_float(value) for value in values])
    shapes = {value.shape if isinstance(value, np.ndarray) else None for value in values}
    if len(shapes) == 1 and None not in shapes:
        return np.stack(values)
    rows = [_row(value) for value in values]
    if None in rows:
        return np.array(["" if value is None else str(value)[:MAX_TEXT] for value in values], object)
    width = Counter(len(row) for row in rows if row).most_common(1)
    if not width or width[0][0] > _MAX_WIDTH:
        return None
    nothing = [np.nan] * width[0][0]
    return np.array([row if row and len(row) == len(nothing) else nothing for row in rows])


def _row(value: Any) -> list[float] | None:
    if value is None:
        return []
    if isinstance(value, str | bytes | dict) or not isinstance(value, Iterable):
        return None
    items = list(value)
    return [_float(item) for item in items] if all(isinstance(item, int | float) for item in items) else None


def _float(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, OverflowError):
        return float("nan")


_MAX_CHANNELS = 500
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no CDR begins so
_MAX_PAYLOAD_BYTES = 2**20  # a pose or a tree of transforms is far smaller


def read_tables(recording: Recording, fields: Callable[[Channel], Iterable[str]]) -> list[Table]:
    """The tables of every channel for which `fields` names paths, in one pass over the log."""
    builders: dict[int, _Builder] = {}

    def sink_of(channel: Channel) -> Sink | None:
        if not (paths := tuple(fields(channel))):
            return None
        recording.check(len(builders) + 1, (_MAX_CHANNELS, 0.0), "channels of poses")
        builder = builders[channel.channel_id] = _Builder(channel, paths)
        return builder.sink

    for _ in recording.read(sink_of):
        for builder in builders.values():
            if builder.sink:
                rows = sum(one.rows for one in builders.values())
                rows += builder.decode(recording.limit(MAX_MESSAGES) - rows)
                recording.check(rows, MAX_MESSAGES, "messages of poses")
    tables = []
    for _, builder in sorted(builders.items()):
        builder.table.columns, times = stacked(builder.pieces)
        builder.table.log_ns, builder.table.publish_ns = times[:, 0], times[:, 1]
        tables.append(builder.table)
    recording.compare({table.channel.channel_id: table.messages for table in tables})
    return tables


class _Builder:
    def __init__(self, channel: Channel, paths: tuple[str, ...]) -> None:
        self.sink: Sink = []
        self.pieces: list[Piece] = []
        self.rows, self.table, self._paths = 0, Table(channel), paths
        self._decoder: Decoder | None = None
        try:
            self._decoder = Decoder(channel)
        except DefinitionError as error:
            self.table.problem = str(error)

    def decode(self, most: int) -> int:
        """How many rows the messages that wait hold, once they are columns; about `most` are read."""
        self.table.messages += len(self.sink)
        messages = [message for message in self.sink if len(message[2]) <= _MAX_PAYLOAD_BYTES]
        if len(messages) < len(self.sink):
            self.table.dropped["too large a message"] += len(self.sink) - len(messages)
        self.sink.clear()
        if self._decoder is None or not messages:
            return 0
        log_ns, publish_ns, payloads = zip(*messages, strict=True)
        if self.table.channel.encoding == "cdr" and payloads[0].startswith(_ZSTD_MAGIC):
            payloads = tuple(map(_unwrapped, payloads))
        columns, row, unreadable = self._decoder.columns(payloads, self._paths, most)
        if unreadable:
            self.table.dropped["unreadable message"] += unreadable
        self.rows += len(row)
        if len(row):
            times = np.array([log_ns, publish_ns], np.uint64).T.astype(np.int64)
            self.pieces.append((columns, np.maximum(times, 0)[row]))
        return len(row)


def _unwrapped(payload: bytes) -> bytes:
    """A message that rosbag2 compressed by itself; empty, and so unreadable, where it is damaged."""
    try:
        if zstandard.get_frame_parameters(payload).content_size > _MAX_PAYLOAD_BYTES:
            return b""
        return zstandard.ZstdDecompressor().decompress(payload, max_output_size=_MAX_PAYLOAD_BYTES)
    except zstandard.ZstdError:
        return b""
