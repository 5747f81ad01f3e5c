"""Records of an MCAP file by the `mcap` library, behind one guard.

`mcap.stream_reader.StreamReader` believes a file's own sizes: it takes memory before it looks, returns short
reads as records, reads everything where a length is negative, and walks records of unknown kinds for ever.
`Guard` stands between it and the bytes and refuses all of that; `unpacked` bounds what a chunk becomes.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader

MAX_CHUNK_BYTES = 256 * 2**20  # of one chunk, unpacked; recorders write 1 to 16 MiB
# Of the specification, and those it leaves to others; a record of a reserved kind is damage.
OPCODES = frozenset([*range(1, 16), *range(128, 256)])


class DamagedError(ValueError):
    """Bytes that contradict their own sizes, kinds or checksums."""


# What the library raises for damaged files: the class does not tell the damage.
DAMAGE = (McapError, ValueError, struct.error, OverflowError, MemoryError)


@dataclass
class Budget:
    """How often the readers of one file may still read: short records cost time, whatever their bytes."""

    reads: int


class Guard:
    """Bytes as the library reads them: never more than there are."""

    def __init__(self, data: bytes, budget: Budget) -> None:
        self._data, self._budget, self._at = data, budget, 0
        self._record_at, self._opcode = 0, 1

    def read(self, size: int) -> bytes:
        """The next `size` bytes; none at the end, where a record would begin."""
        self._budget.reads -= 1
        if size == 1 and self._at == len(self._data):
            return b""
        if not 0 <= size <= len(self._data) - self._at or self._budget.reads < 0:
            raise DamagedError("a record ends before its content")
        if size == 8 and self._record_at == self._at - 1 and self._opcode not in OPCODES:
            raise DamagedError("a record is of no known kind")
        data = self._data[self._at : self._at + size]
        if size == 1:
            self._record_at, self._opcode = self._at, data[0]
        self._at += size
        return data


def records_in(data: bytes, budget: Budget) -> Iterator[McapRecord]:
    """The records that these bytes hold, one after the other."""
    limit = 2 * MAX_CHUNK_BYTES
    reader = StreamReader(Guard(data, budget), skip_magic=True, emit_chunks=True, record_size_limit=limit)
    try:
        yield from reader.records
    except EndOfFile:
        return


def unpacked(chunk: Chunk) -> bytes:
    """The records of a chunk, decompressed and checked against its CRC.

    Raises DamagedError if size, compression or CRC do not fit; the data's own statement of its size is
    not believed.
    """
    size, data = chunk.uncompressed_size, chunk.data
    if size > MAX_CHUNK_BYTES:
        raise DamagedError(f"a chunk of {size} bytes exceeds {MAX_CHUNK_BYTES}")
    try:
        if chunk.compression == "zstd":
            stated = zstandard.get_frame_parameters(data).content_size
            if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise DamagedError(f"a chunk unpacks to {stated} bytes instead of {size}")
            data = zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        elif chunk.compression:
            raise DamagedError(f"unknown compression {chunk.compression[:20]!r}")
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise DamagedError(f"a chunk does not unpack ({error})") from None
    if len(data) != size:
        raise DamagedError(f"a chunk unpacks to {len(data)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedError("a chunk fails its CRC")
    return data
