"""Records of an MCAP file, each read within its own bytes and within bounds.

The format: https://mcap.dev/spec. A record is an opcode (1 byte), a length (8 bytes) and its
content; a chunk holds records of its own, compressed as a whole.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import lz4.frame
import zstandard

try:
    from isal.isal_zlib import crc32  # ten times as fast
except ImportError:  # no wheel for this platform
    from zlib import crc32

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
CHUNK_INDEX, STATISTICS, METADATA, METADATA_INDEX, DATA_END = 8, 0x0B, 0x0C, 0x0D, 0x0F

MAX_CHUNK_BYTES = 256 * 2**20  # of one chunk, unpacked; recorders write 1 to 16 MiB
MAX_NAME = 500  # characters of a topic or schema
MIN_RECORD_BYTES = 8  # the shortest record that a chunk or a summary may hold
MAX_RECORD_BYTES = 16 * 2**20  # of a schema, channel, metadata or index record

Span = tuple[int, int, int]  # opcode, start and stop of the content
Sink = list[tuple[int, int, bytes]]  # log time, publish time (ns) and payload of each message


class DamagedError(ValueError):
    """A record that cannot be what it says it is."""


class SchemaRecord(NamedTuple):
    """A definition of messages."""

    schema_id: int
    name: str
    encoding: str
    data: bytes


class ChannelRecord(NamedTuple):
    """A stream of messages."""

    channel_id: int
    schema_id: int
    topic: str
    encoding: str


class ChunkRef(NamedTuple):
    """Where a chunk's record lies and, where an index tells, which channels it holds."""

    offset: int  # of its content
    length: int
    channel_ids: frozenset[int] | None = None


class Cursor:
    """Reads numbers and strings from the content of one record and never beyond it."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        stop = self._at + size
        if stop > len(self._content):
            raise DamagedError("a record ends before its content")
        piece, self._at = self._content[self._at : stop], stop
        return piece

    def number(self, size: int) -> int:
        """An unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """A string with its length before it."""
        try:
            return self.take(self.number(4)).decode("utf-8")
        except UnicodeDecodeError:
            raise DamagedError("a text is not UTF-8") from None

    def name(self) -> str:
        """A string that names something, and so is short."""
        name = self.text()
        if len(name) > MAX_NAME:
            raise DamagedError(f"a name of {len(name)} characters")
        return name

    def mapping(self) -> dict[str, str]:
        """A map of strings to strings."""
        inner = Cursor(self.take(self.number(4)))
        found = {}
        while inner.left:
            key = inner.text()
            found[key] = inner.text()
        return found

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return len(self._content) - self._at


def read_schema(content: bytes) -> SchemaRecord:
    """A schema record."""
    cursor = Cursor(content)
    return SchemaRecord(cursor.number(2), cursor.name(), cursor.name(), cursor.take(cursor.number(4)))


def read_channel(content: bytes) -> ChannelRecord:
    """A channel record; its own metadata is not kept."""
    cursor = Cursor(content)
    return ChannelRecord(cursor.number(2), cursor.number(2), cursor.name(), cursor.name())


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and content of a metadata record."""
    cursor = Cursor(content)
    return cursor.text(), cursor.mapping()


def read_chunk_index(content: bytes) -> ChunkRef:
    """Where a chunk lies; offset and length are those of its content."""
    cursor = Cursor(content)
    cursor.take(16)
    offset, length = cursor.number(8), cursor.number(8)
    offsets = cursor.take(cursor.number(4))
    ids = frozenset(
        channel_id for channel_id, _ in struct.iter_unpack("<HQ", offsets[: len(offsets) // 10 * 10])
    )
    return ChunkRef(offset + 9, length - 9, ids or None)


def read_counts(content: bytes) -> dict[int, int]:
    """Messages by channel, from a statistics record."""
    cursor = Cursor(content)
    cursor.take(8 + 2 + 4 + 4 + 4 + 4 + 8 + 8)
    counts = cursor.take(cursor.number(4))
    return dict(struct.iter_unpack("<HQ", counts[: len(counts) // 10 * 10]))


def read_metadata_index(content: bytes) -> ChunkRef:
    """Where a metadata record lies; offset and length are those of its content."""
    cursor = Cursor(content)
    offset, length = cursor.number(8), cursor.number(8)
    return ChunkRef(offset + 9, length - 9)


def unpack_chunk(content: bytes) -> bytes:
    """The records of a chunk, decompressed and checked against its CRC.

    Raises
    ------
    DamagedError
        If size, compression or CRC do not fit.
    """
    if len(content) < _CHUNK.size:
        raise DamagedError("a chunk's header is cut off")
    _, _, size, crc, name = _CHUNK.unpack_from(content)
    at = _CHUNK.size + name + 8
    if size > MAX_CHUNK_BYTES or at > len(content):
        raise DamagedError(f"a chunk of {size} bytes exceeds {MAX_CHUNK_BYTES}")
    compression, length = content[_CHUNK.size : at - 8], int.from_bytes(content[at - 8 : at], "little")
    try:
        records = _decompressed(memoryview(content)[at : at + length], compression, size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise DamagedError(f"a chunk does not unpack ({error})") from None
    if len(records) != size:
        raise DamagedError(f"a chunk unpacks to {len(records)} bytes instead of {size}")
    if crc and crc32(records) != crc:
        raise DamagedError("a chunk fails its CRC")
    return records


def spans(records: bytes) -> Iterator[Span]:
    """The records of an unpacked chunk.

    Raises
    ------
    DamagedError
        If a record reaches beyond the chunk, or is too short to be one.
    """
    at, end = 0, len(records)
    while at + 9 <= end:
        opcode, length = _RECORD.unpack_from(records, at)
        start = at + 9
        at = start + length
        if at > end or length < MIN_RECORD_BYTES:
            raise DamagedError("a chunk holds what is no record")
        yield opcode, start, at


def collect(
    records: bytes, sinks: Mapping[int, Sink | None], define: Callable[[int, bytes], None], most: int
) -> int:
    """Put the messages of a chunk into the sinks of their channels.

    Parameters
    ----------
    records : bytes
        An unpacked chunk.
    sinks : mapping of channel id to list, or to None where the channel is not wanted
    define : callable
        Takes opcode and content of each schema and channel.
    most : int
        Messages that one sink may hold; beyond that the walk ends.

    Returns
    -------
    int
        How many records the chunk holds.

    Raises
    ------
    DamagedError
        If it holds what is no record; the messages before it are kept.
    """
    at, end, number, unpack = 0, len(records), 0, _MESSAGE_RECORD.unpack_from
    while at + MESSAGE_HEAD <= end:
        opcode, length, channel_id, log_ns, publish_ns = unpack(records, at)
        stop = at + 9 + length
        if stop > end or length < MIN_RECORD_BYTES:
            raise DamagedError("a chunk holds what is no record")
        number += 1
        if opcode == MESSAGE:
            sink = sinks[channel_id]
            if sink is not None and length >= MESSAGE_HEAD - 9:
                sink.append((log_ns, publish_ns, records[at + MESSAGE_HEAD : stop]))
                if len(sink) > most:
                    return number
        elif opcode in (SCHEMA, CHANNEL):
            define(opcode, records[at + 9 : stop])
        at = stop
    for opcode, start, stop in spans(records[at:]):  # a short record at the end
        number += 1
        if opcode in (SCHEMA, CHANNEL):
            define(opcode, records[at + start : at + stop])
    return number


def _decompressed(data: memoryview, compression: bytes, size: int) -> bytes:
    """At most `size` bytes and one: what the data says of its own size is checked, not believed."""
    if compression == b"":
        return bytes(data)
    if compression == b"zstd":
        frame = zstandard.get_frame_parameters(data).content_size
        if frame not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise DamagedError(f"a chunk unpacks to {frame} bytes instead of {size}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))
    if compression == b"lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    raise DamagedError(f"unknown compression {compression[:20]!r}")


_CHUNK = struct.Struct("<QQQII")  # first and last time, size, CRC, length of the compression's name
_RECORD = struct.Struct("<BQ")
_MESSAGE_RECORD = struct.Struct("<BQH4xQQ")  # without the sequence number
MESSAGE_HEAD = _MESSAGE_RECORD.size
