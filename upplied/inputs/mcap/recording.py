"""The container of a log: an MCAP file's channels, metadata and messages, within bounds.

A sound log is read through its chunk index, so that chunks without a wanted channel are never
touched. One whose index cannot be used is read from front to back (`upplied.inputs.mcap.salvage`).
Whatever the file says of its own sizes is checked before memory is taken for it.
"""

from __future__ import annotations

import os
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from upplied.errors import InputError
from upplied.inputs.mcap import records as mcap
from upplied.inputs.mcap.salvage import scan

# Bounds on what a log may hold: so much, plus so much for each byte of the file.
MAX_UNPACKED = (2**30, 200)  # bytes after decompression
MAX_RECORDS = (5_000_000, 0.5)  # of all channels
MAX_MESSAGES = (500_000, 0.125)  # of the wanted channels, and rows in their tables

_OTHER_FORMATS = {
    b"#ROSBAG V": ("it is a ROS 1 bag", "convert it: mcap convert in.bag out.mcap"),
    b"SQLite fo": ("it is a ROS 2 bag in SQLite", "convert it: ros2 bag convert, storage mcap"),
    b"ULog\x01\x12\x35": ("it is a PX4 ULog", "convert it to MCAP, or record /fmu/out with ros2 bag"),
    b"\x28\xb5\x2f\xfd": ("it is compressed as a whole", "unpack it first: zstd -d"),
    b"version ht": ("it is a pointer of git LFS", "fetch the file itself: git lfs pull"),
}


class _NoIndexError(mcap.DamagedError):
    """The log was written without an index, as recorders may."""


@dataclass(frozen=True)
class Channel:
    """One stream of messages of one schema."""

    channel_id: int
    topic: str
    encoding: str  # of the messages: cdr, ros1, protobuf, json
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
class Recording:
    """What an MCAP file holds; `losses` say in words what could not be read."""

    path: Path
    size: int
    schemas: dict[int, mcap.SchemaRecord] = field(default_factory=dict)
    channels: dict[int, mcap.ChannelRecord] = field(default_factory=dict)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    chunks: list[mcap.ChunkRef] = field(default_factory=list)
    # Messages outside of chunks, each with the id of its channel.
    loose: list[tuple[int, mcap.ChunkRef]] = field(default_factory=list)
    # Messages by channel, as the statistics say.
    counts: dict[int, int] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)

    def channel(self, channel_id: int) -> Channel | None:
        """The channel of this id with its schema, or None where the log does not define it."""
        record = self.channels.get(channel_id)
        if record is None:
            return None
        schema = self.schemas.get(record.schema_id, mcap.SchemaRecord(0, "", "", b""))
        return Channel(channel_id, record.topic, record.encoding, schema.name, schema.encoding, schema.data)

    def listed(self, most: int = 12) -> str:
        """Topics and schemas in words."""
        channels = [self.channel(channel_id) for channel_id in sorted(self.channels)]
        shown = [f"{c.topic} ({c.schema_short or 'no schema'})" for c in channels if c]
        return ", ".join(shown[:most]) + (f" and {len(shown) - most} more" if len(shown) > most else "")

    def add(self, opcode: int, content: bytes) -> None:
        """Keep a schema, channel or metadata record."""
        if opcode == mcap.SCHEMA:
            schema = mcap.read_schema(content)
            self.schemas.setdefault(schema.schema_id, schema)
        elif opcode == mcap.CHANNEL:
            channel = mcap.read_channel(content)
            self.channels.setdefault(channel.channel_id, channel)
        elif opcode == mcap.METADATA:
            self.metadata.append(mcap.read_metadata(content))

    def read(self, sink_of: Callable[[Channel], mcap.Sink | None]) -> Iterator[None]:
        """Collect the messages of the channels that get a sink; yields after each chunk.

        Damaged chunks are skipped and named in `losses`.
        """
        sinks, most = _Sinks(self, sink_of), self.limit(MAX_MESSAGES) + 1
        lost, unpacked, records = Counter[str](), 0, 0
        with self.path.open("rb", buffering=0) as stream:
            for ref in self.chunks:
                if ref.channel_ids is not None and all(sinks[i] is None for i in ref.channel_ids):
                    continue
                try:
                    chunk = mcap.unpack_chunk(_content(stream, ref))
                    unpacked += len(chunk)
                    self.check(unpacked, MAX_UNPACKED, "bytes after decompression")
                    records += mcap.collect(chunk, sinks, self.add, most)
                except mcap.DamagedError as error:
                    lost[str(error)] += 1
                self.check(records, MAX_RECORDS, "records")
                yield
        with self.path.open("rb") as stream:
            for channel_id, ref in self.loose:
                if sinks[channel_id] is not None:
                    head = ref.offset - 9
                    mcap.collect(_content(stream, mcap.ChunkRef(head, ref.length + 9)), sinks, self.add, most)
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
            raise InputError(
                str(self.path),
                f"holds more than {self.limit(bound)} {what}",
                "what an honest log of its size can hold",
                "check where it is from",
            )


class _Sinks(dict[int, "mcap.Sink | None"]):
    """The sink of each channel id, asked for once."""

    def __init__(self, recording: Recording, sink_of: Callable[[Channel], mcap.Sink | None]) -> None:
        super().__init__()
        self._recording, self._sink_of = recording, sink_of

    def __missing__(self, channel_id: int) -> mcap.Sink | None:
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
            if not start.startswith(mcap.MAGIC):
                raise _not_mcap(path, start)
            recording = Recording(path, size)
            try:
                _read_summary(stream, recording)
            except _NoIndexError:
                recording.metadata.clear()  # the scan meets them again
                scan(stream, recording, "")
            except mcap.DamagedError as error:
                recording = Recording(path, size)
                scan(stream, recording, str(error))
            return recording
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "a readable file") from None


def _not_mcap(path: Path, start: bytes) -> InputError:
    if not start:
        return InputError(str(path), "is empty", "an MCAP log", "copy it again from the recorder")
    for magic, (found, remedy) in _OTHER_FORMATS.items():
        if start.startswith(magic):
            return InputError(str(path), found, "an MCAP log", remedy)
    return InputError(
        str(path), "does not start as an MCAP file", "an MCAP log", "check that it is the right file"
    )


def _read_summary(stream: BinaryIO, recording: Recording) -> None:
    footer_at = recording.size - 8 - 29
    tail = _content(stream, mcap.ChunkRef(footer_at, 37)) if footer_at >= 8 else b""
    if len(tail) < 37 or tail[29:] != mcap.MAGIC or tail[0] != mcap.FOOTER:
        raise mcap.DamagedError("the log was not closed")
    cursor = mcap.Cursor(tail[9:29])
    start, _, crc = cursor.number(8), cursor.number(8), cursor.number(4)
    if start == 0:
        raise _NoIndexError
    if not 8 <= start < footer_at or footer_at - start > 16 * mcap.MAX_RECORD_BYTES:
        raise mcap.DamagedError("the summary is not where the log says")
    summary = _content(stream, mcap.ChunkRef(start, footer_at - start))
    if crc and zlib.crc32(tail[:25], zlib.crc32(summary)) != crc:
        raise mcap.DamagedError("the summary fails its CRC")
    _index(stream, summary, recording)


def _index(stream: BinaryIO, summary: bytes, recording: Recording) -> None:
    refs = {}
    for opcode, start, stop in mcap.spans(summary):
        content = summary[start:stop]
        if opcode == mcap.CHUNK_INDEX:
            ref = mcap.read_chunk_index(content)
            refs[ref.offset] = ref
        elif opcode == mcap.STATISTICS:
            recording.counts = mcap.read_counts(content)
        elif opcode == mcap.METADATA_INDEX:
            recording.add(mcap.METADATA, _content(stream, mcap.read_metadata_index(content)))
        else:
            recording.add(opcode, content)
    if not refs or not recording.channels:
        raise _NoIndexError
    recording.chunks = [refs[offset] for offset in sorted(refs)]


def _content(stream: BinaryIO, ref: mcap.ChunkRef) -> bytes:
    if not 0 <= ref.length <= 2 * mcap.MAX_CHUNK_BYTES:
        raise mcap.DamagedError(f"a record of {ref.length} bytes")
    if ref.offset + ref.length > os.fstat(stream.fileno()).st_size:
        raise mcap.DamagedError("a record reaches beyond the end of the log")
    stream.seek(ref.offset)
    return stream.read(ref.length)
