"""The container of a log: an MCAP file's channels, metadata and messages, within bounds.

The file is walked once and only the places of chunks and messages are noted; damage costs the chunks it hit.
"""

import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema, Statistics

from upplied.errors import InputError
from upplied.inputs.mcap.stream import DAMAGE, MESSAGE, OPCODES, READ, DamagedError, records_in, unpacked
from upplied.inputs.tables import Channel

# Bounds on the content of a log: so much, plus so much for each byte of the file.
MAX_UNPACKED = (2**30, 200)  # bytes after decompression
MAX_RECORDS = (5_000_000, 0.5)  # of all channels
MAX_MESSAGES = (500_000, 0.125)  # of the wanted channels, and rows in their tables
MAX_NAME = 500  # characters of a topic or schema
MAX_RECORD_BYTES = 16 * 2**20  # of a schema, channel, metadata or statistics record
MAGIC = b"\x89MCAP0\r\n"
_CHUNK, _INDEX = 6, 7
_ANCHORS = re.compile(rb"\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4")  # the compression's name in a chunk
_ANCHOR_AT = 9 + 28  # from the start of the chunk's record
_WINDOW = 2**20

Sink = list[tuple[int, int, bytes]]  # log time, publish time (ns) and payload of each message


class Ref(NamedTuple):
    """Place of a chunk's record, or of a message outside of chunks."""

    start: int
    stop: int
    channel_ids: Set[int] = frozenset()  # of its messages, where known


@dataclass
class Recording:
    """The content of an MCAP file; `losses` name in words what could not be read."""

    path: Path
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    chunks: list[Ref] = field(default_factory=list)
    loose: list[Ref] = field(default_factory=list)  # messages outside of chunks
    counts: Mapping[int, int] = field(default_factory=dict)  # messages by channel, by the statistics
    losses: list[str] = field(default_factory=list)
    read_to: int = 0  # byte at which a salvaged log ends
    lost_bytes: int = 0  # of damaged chunks

    def channel(self, channel_id: int) -> Channel | None:
        """The channel of this id with its schema, or None where the log does not define it."""
        if (record := self.channels.get(channel_id)) is None:
            return None
        kind = self.schemas.get(record.schema_id) or Schema(id=0, name="", encoding="", data=b"")
        return Channel(channel_id, record.topic, record.message_encoding, kind.name, kind.encoding, kind.data)

    @property
    def read_pct(self) -> float:
        total = sum(ref.stop - ref.start for ref in self.chunks) or self.size
        missing = max(self.size - self.read_to, 0) if self.losses else 0
        return float(100 * max(1 - self.lost_bytes / total - missing / max(self.size, 1), 0))

    def listed(self, most: int = 12) -> str:
        """Topics and schemas in words."""
        channels = [self.channel(channel_id) for channel_id in sorted(self.channels)]
        shown = [f"{c.topic} ({c.schema_short or 'no schema'})" for c in channels if c]
        return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")

    def add(self, record: McapRecord | None) -> None:
        """Note a record of the file, or of a chunk."""
        if isinstance(record, Schema | ChannelRecord):
            names = (record.name, record.encoding) if isinstance(record, Schema) else (record.topic,)
            if max(map(len, names)) > MAX_NAME:
                raise DamagedError("a name of more than 500 characters")
            known: dict = self.schemas if isinstance(record, Schema) else self.channels
            known.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata.append((record.name, record.metadata))
        elif isinstance(record, Statistics):
            self.counts = record.channel_message_counts

    def read(self, sink_of: Callable[[Channel], Sink | None]) -> Iterator[None]:
        """Fill the sinks that channels get, pausing after each chunk; damaged ones are named in `losses`."""
        most, lost, size, number = self.limit(MAX_MESSAGES), Counter[str](), 0, 0
        sinks: dict[int, Sink | None] = {}

        def sink_at(channel_id: int) -> Sink | None:
            if channel_id not in sinks:
                channel = self.channel(channel_id)
                sinks[channel_id] = None if channel is None else sink_of(channel)
            return sinks[channel_id]

        with self.path.open("rb") as stream:
            for ref in [*self.chunks, *self.loose]:
                if ref.channel_ids and all(sink_at(number) is None for number in ref.channel_ids):
                    continue
                try:
                    stream.seek(ref.start)
                    inside = records_in(stream.read(ref.stop - ref.start))
                    if isinstance(record := next(inside), Chunk):
                        content = unpacked(record)
                        size += len(content)
                        self.check(size, MAX_UNPACKED, "bytes after decompression")
                        record, inside = None, records_in(content)
                    for inner in chain([record], inside):
                        number += 1
                        if not isinstance(inner, Message):
                            self.add(inner)
                        elif (sink := sink_at(inner.channel_id)) is not None:
                            sink.append((inner.log_time, inner.publish_time, inner.data))
                            if len(sink) > most:
                                break
                except (*DAMAGE, StopIteration) as error:
                    lost[str(error) or type(error).__name__] += 1
                    self.lost_bytes += ref.stop - ref.start
                self.check(number, MAX_RECORDS, "records")
                yield
        for reason, number in lost.items():
            self.losses.append(f"{number} of {len(self.chunks)} chunks lost: {reason}")

    def compare(self, messages: Mapping[int, int]) -> None:
        """Note it where fewer messages of these channels were found than the log's statistics count."""
        missing = sum(max(self.counts.get(number, 0) - read, 0) for number, read in messages.items())
        if missing and not self.losses:
            self.losses.append(f"{missing} messages that the log counts are not in it")

    def limit(self, bound: tuple[float, float]) -> int:
        """What a log of this size may hold."""
        return int(bound[0] + bound[1] * self.size)

    def check(self, number: int, bound: tuple[float, float], what: str) -> None:
        """Raise InputError of a log that holds more than a log of its size can."""
        if number > self.limit(bound):
            finding = f"holds more than {self.limit(bound)} {what}"
            raise InputError(str(self.path), finding, "what a log of its size can hold", "check its origin")


def open_recording(path: Path) -> Recording:
    """The content of an MCAP file, of a damaged one what is left; InputError if there is none."""
    try:
        with path.open("rb") as stream:
            start = stream.read(len(MAGIC))
            if start != MAGIC:
                finding = "does not start as an MCAP file" if start else "is empty"
                raise InputError(str(path), finding, "an MCAP log", "copy it again from the recorder")
            recording = Recording(path, size := path.stat().st_size, read_to=size)
            _walk(stream, recording)
            return recording
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "a readable file") from None


def _walk(stream: BinaryIO, recording: Recording) -> None:
    """Note every record from front to back; what stands in the summary, only where that is whole."""
    at, size = len(MAGIC), recording.size
    summary: list[McapRecord | None] = []
    ids: set[int] = set()  # of the channels in the last chunk
    end: DataEnd | None = None
    while at < size:
        stream.seek(at)
        head = stream.read(11)  # kind, length, and the channel that messages and indexes begin with
        opcode, stop, channel_id = head[0], at + 9 + int.from_bytes(head[1:9], "little"), head[9:]
        try:
            if opcode not in OPCODES or len(head) < 9 or stop > size:
                raise DamagedError("a record reaches beyond the end of the log")
            if opcode == _CHUNK:
                recording.chunks.append(Ref(at, stop, ids := set()))
            elif opcode == _INDEX:
                ids.add(int.from_bytes(channel_id, "little"))
            elif opcode == MESSAGE:
                recording.loose.append(Ref(at, stop, {int.from_bytes(channel_id, "little")}))
            elif opcode in READ:
                if stop - at > MAX_RECORD_BYTES:
                    raise DamagedError("a record is larger than any of its kind")
                stream.seek(at)
                record = next(records_in(stream.read(stop - at)))
                if isinstance(record, Footer):
                    return _close(stream, recording, record, at, summary)
                if end is not None:
                    summary.append(record)
                elif isinstance(record, DataEnd):
                    end = record
                    if recording.loose and end.data_section_crc not in (0, _crc(stream, 0, at)):
                        recording.losses.append("the data fails its CRC")
                else:
                    recording.add(record)
            recording.check(len(recording.chunks) + len(recording.loose), MAX_RECORDS, "records")
            at = stop
        except (*DAMAGE, StopIteration):
            following = None if end is not None else _next_chunk(stream, at + 1, size)
            if following is None:
                break
            recording.losses.append(f"{following - at} bytes lost at byte {at}")
            recording.lost_bytes += following - at
            at = following
    recording.chunks = [Ref(ref.start, ref.stop) for ref in recording.chunks]  # any may define a channel
    if end is None:
        recording.read_to = at
        recording.losses.append(f"the log was not closed; read up to byte {at} of {size}")
    else:
        recording.losses.append("the log was not closed, though its data is whole")


def _close(
    stream: BinaryIO, recording: Recording, footer: Footer, at: int, summary: Sequence[McapRecord | None]
) -> None:
    """Take the summary where the footer, which begins at a byte, and its checksum are whole."""
    start, crc = footer.summary_start, footer.summary_crc
    stream.seek(at + 29)
    if stream.read(len(MAGIC) + 1) != MAGIC:
        recording.losses.append("the log was not closed, though its data is whole")
    elif start and (not len(MAGIC) <= start <= at or (crc and crc != _crc(stream, start, at + 25))):
        recording.losses.append("the summary fails its CRC, though the data is whole")
    else:
        for record in summary:
            recording.add(record)
        if recording.channels and summary:
            return
    recording.chunks = [Ref(ref.start, ref.stop) for ref in recording.chunks]


def _crc(stream: BinaryIO, start: int, stop: int) -> int:
    stream.seek(start)
    crc = 0
    for at in range(start, stop, _WINDOW):
        crc = zlib.crc32(stream.read(min(_WINDOW, stop - at)), crc)
    return crc


def _next_chunk(stream: BinaryIO, start: int, size: int) -> int | None:
    for first in range(start, size, _WINDOW):
        stream.seek(first)
        window = stream.read(_WINDOW + _ANCHOR_AT + 16)
        for hit in _ANCHORS.finditer(window):
            begin = hit.start() - _ANCHOR_AT
            length = int.from_bytes(window[begin + 1 : begin + 9], "little")
            if begin >= 0 and window[begin] == _CHUNK and first + begin + 9 + length <= size:
                return first + begin
    return None
