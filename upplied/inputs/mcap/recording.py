"""The container of a log: an MCAP file's channels, metadata and messages, within bounds.

A sound log is read through its chunk index, so that chunks without a wanted channel are never
touched. One whose index cannot be used is read from front to back (`upplied.inputs.mcap.salvage`).
Records are read by `mcap`; its `SeekingReader` is not used, since the first damaged chunk ends it, it
unpacks a chunk that stands in the summary, and it sorts by time what is wanted as recorded.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, ChunkIndex, McapRecord, Message, Metadata, MetadataIndex, Schema, Statistics

from upplied.errors import InputError
from upplied.inputs.mcap.salvage import scan
from upplied.inputs.mcap.stream import DAMAGE, Budget, DamagedError, Guard, records_in
from upplied.inputs.tables import Channel

# Bounds on what a log may hold: so much, plus so much for each byte of the file.
MAX_UNPACKED = (2**30, 200)  # bytes after decompression
MAX_RECORDS = (5_000_000, 0.5)  # of all channels
MAX_MESSAGES = (500_000, 0.125)  # of the wanted channels, and rows in their tables
MAX_NAME = 500  # characters of a topic or schema
MAX_RECORD_BYTES = 16 * 2**20  # of a schema, channel, metadata or index record
MAGIC = b"\x89MCAP0\r\n"
_FOOTER_BYTES = 9 + 20 + len(MAGIC)

Sink = list[tuple[int, int, bytes]]  # log time, publish time (ns) and payload of each message


class _NoIndexError(DamagedError):
    """The log was written without an index, as recorders may."""


class Ref(NamedTuple):
    """Where the record of a chunk, or of a message of this channel outside of chunks, lies."""

    start: int
    stop: int
    channel_ids: frozenset[int] = frozenset()  # that it holds, where known


@dataclass
class Recording:
    """What an MCAP file holds; `losses` say in words what could not be read."""

    path: Path
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    chunks: list[Ref] = field(default_factory=list)
    loose: list[Ref] = field(default_factory=list)  # messages outside of chunks
    counts: Mapping[int, int] = field(default_factory=dict)  # messages by channel, as the statistics say
    losses: list[str] = field(default_factory=list)
    read_to: int = 0  # byte at which a salvaged log ends
    lost_bytes: int = 0  # of damaged chunks

    def budget(self) -> Budget:
        """How often a reader of all its records may read."""
        return Budget(8 * self.limit(MAX_RECORDS))

    def channel(self, channel_id: int) -> Channel | None:
        """The channel of this id with its schema, or None where the log does not define it."""
        record = self.channels.get(channel_id)
        if record is None:
            return None
        schema = self.schemas.get(record.schema_id) or Schema(id=0, name="", encoding="", data=b"")
        return Channel(
            channel_id, record.topic, record.message_encoding, schema.name, schema.encoding, schema.data
        )

    @property
    def read_pct(self) -> float:
        """Share of the log that could be read, %."""
        total = sum(ref.stop - ref.start for ref in self.chunks) or self.size
        missing = max(self.size - self.read_to, 0) if self.losses else 0
        return float(100 * max(1 - self.lost_bytes / total - missing / max(self.size, 1), 0))

    def listed(self, most: int = 12) -> str:
        """Topics and schemas in words."""
        channels = [self.channel(channel_id) for channel_id in sorted(self.channels)]
        shown = [f"{c.topic} ({c.schema_short or 'no schema'})" for c in channels if c]
        return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")

    def add(self, record: McapRecord, start: int = 0, stop: int = 0) -> None:
        """Keep a record of the file, or of a chunk; messages and chunks by where they lie."""
        if isinstance(record, Schema | ChannelRecord):
            names = (record.name, record.encoding) if isinstance(record, Schema) else (record.topic,)
            if max(map(len, names)) > MAX_NAME:
                raise DamagedError("a name of more than 500 characters")
            kept: dict = self.schemas if isinstance(record, Schema) else self.channels
            kept.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata.append((record.name, record.metadata))
        elif isinstance(record, Chunk):
            self.chunks.append(Ref(start, stop))
        elif isinstance(record, Message):
            self.loose.append(Ref(start, stop, frozenset([record.channel_id])))

    def read(self, sink_of: Callable[[Channel], Sink | None]) -> Iterator[None]:
        """Collect the messages of the channels that get a sink; yields after each chunk.

        Damaged chunks are skipped and named in `losses`.
        """
        sinks, most, budget = _Sinks(self, sink_of), self.limit(MAX_MESSAGES), self.budget()
        lost, unpacked = Counter[str](), 0
        with self.path.open("rb") as stream:
            for ref in [*self.chunks, *self.loose]:
                if ref.channel_ids and all(sinks[channel_id] is None for channel_id in ref.channel_ids):
                    continue
                try:
                    record = _record_at(stream, ref, self.size, budget)
                    inside: Iterable[McapRecord] = (record,)
                    if isinstance(record, Chunk):
                        inside = records_in(record, budget)
                        unpacked += record.uncompressed_size
                        self.check(unpacked, MAX_UNPACKED, "bytes after decompression")
                    for inner in inside:
                        if not isinstance(inner, Message):
                            self.add(inner)
                        elif (sink := sinks[inner.channel_id]) is not None:
                            sink.append((inner.log_time, inner.publish_time, inner.data))
                            if len(sink) > most:
                                break
                except DAMAGE as error:
                    lost[str(error) or type(error).__name__] += 1
                    self.lost_bytes += min(ref.stop - ref.start, self.size)
                self.check(self.limit(MAX_RECORDS) - budget.reads // 8, MAX_RECORDS, "records")
                yield
        for reason, number in lost.items():
            self.losses.append(f"{number} of {len(self.chunks)} chunks lost: {reason}")

    def compare(self, found: Mapping[int, int]) -> None:
        """Note it where fewer messages of these channels were found than the log's statistics count."""
        missing = sum(max(self.counts.get(channel_id, 0) - number, 0) for channel_id, number in found.items())
        if missing and not self.losses:
            self.losses.append(f"{missing} messages that the log counts are not in it")

    def limit(self, bound: tuple[float, float]) -> int:
        """What a log of this size may hold."""
        return int(bound[0] + bound[1] * self.size)

    def check(self, number: int, bound: tuple[float, float], what: str) -> None:
        """Refuse a log that holds more than a log of its size can.

        Raises
        ------
        InputError
        """
        if number > self.limit(bound):
            found = f"holds more than {self.limit(bound)} {what}"
            raise InputError(
                str(self.path), found, "what an honest log of its size can hold", "check where it is from"
            )


class _Sinks(dict[int, "Sink | None"]):
    """The sink of each channel id, asked for once."""

    def __init__(self, recording: Recording, sink_of: Callable[[Channel], Sink | None]) -> None:
        super().__init__()
        self._recording, self._sink_of = recording, sink_of

    def __missing__(self, channel_id: int) -> Sink | None:
        channel = self._recording.channel(channel_id)
        self[channel_id] = sink = None if channel is None else self._sink_of(channel)
        return sink


def open_recording(path: Path) -> Recording:
    """What an MCAP file holds, through its index or else by reading it from front to back.

    Raises
    ------
    InputError
        If it is missing, empty or no MCAP file.
    """
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise InputError(str(path), "is no file", "an MCAP log")
        with path.open("rb") as stream:
            start = stream.read(10)
            if not start.startswith(MAGIC):
                found = "does not start as an MCAP file" if start else "is empty"
                raise InputError(str(path), found, "an MCAP log", "copy it again from the recorder")
            recording = Recording(path, size, read_to=size)
            try:
                _read_summary(stream, recording)
            except _NoIndexError:
                recording.metadata.clear()  # the scan meets them again
                scan(stream, recording, "")
            except DAMAGE as error:
                recording = Recording(path, size, read_to=size)
                why = str(error) if isinstance(error, DamagedError) else "the summary cannot be read"
                scan(stream, recording, why)
            return recording
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "a readable file") from None


def _read_summary(stream: BinaryIO, recording: Recording) -> None:
    footer_at = recording.size - _FOOTER_BYTES
    stream.seek(max(footer_at, 0))
    tail = stream.read(_FOOTER_BYTES)
    if footer_at < len(MAGIC) or tail[-8:] != MAGIC or tail[0] != 2:
        raise DamagedError("the log was not closed")
    start, crc = int.from_bytes(tail[9:17], "little"), int.from_bytes(tail[25:29], "little")
    if start == 0:
        raise _NoIndexError
    if not len(MAGIC) <= start < footer_at or footer_at - start > 16 * MAX_RECORD_BYTES:
        raise DamagedError("the summary is not where the log says")
    stream.seek(start)
    if crc and zlib.crc32(tail[:25], zlib.crc32(stream.read(footer_at - start))) != crc:
        raise DamagedError("the summary fails its CRC")
    refs, metadata, budget = {}, list[Ref](), recording.budget()
    for record in Guard(stream, start, footer_at, budget).records():
        if isinstance(record, ChunkIndex):
            first = record.chunk_start_offset
            refs[first] = Ref(first, first + record.chunk_length, frozenset(record.message_index_offsets))
        elif isinstance(record, Statistics):
            recording.counts = record.channel_message_counts
        elif isinstance(record, MetadataIndex):
            metadata.append(Ref(record.offset, record.offset + record.length))
        elif isinstance(record, Schema | ChannelRecord):
            recording.add(record)
    if not refs or not recording.channels:
        raise _NoIndexError
    for ref in metadata:
        recording.add(_record_at(stream, ref, recording.size, budget))
    recording.chunks = [refs[start] for start in sorted(refs)]


def _record_at(stream: BinaryIO, ref: Ref, size: int, budget: Budget) -> McapRecord:
    if not 0 <= ref.start < ref.stop <= size:
        raise DamagedError("a record reaches beyond the end of the log")
    for record in Guard(stream, ref.start, ref.stop, budget).records():
        return record
    raise DamagedError("no record is where the index says")
