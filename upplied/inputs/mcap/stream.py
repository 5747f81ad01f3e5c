"""Records of an MCAP file by the `mcap` library, behind one guard.

`mcap.stream_reader.StreamReader` believes what a file says of its own sizes: it takes memory before
it looks, returns short reads as records, reads everything where a length is negative, and walks
records of unknown kinds for ever. `Guard` stands between it and the bytes and refuses all of that;
`unpacked` bounds what a chunk becomes.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader

MAX_CHUNK_BYTES = 256 * 2**20  # of one chunk, unpacked; recorders write 1 to 16 MiB


# Of the specification, and those it leaves to others; a record of a reserved kind is damage.
_OPCODES = frozenset([*range(1, 16), *range(128, 256)])


class DamagedError(ValueError):
    """Bytes that cannot be what they say they are."""


# What the library raises for damaged files: the class says nothing of the damage.
DAMAGE = (McapError, ValueError, struct.error, OverflowError, MemoryError)


@dataclass
class Budget:
    """How often the readers of one file may read yet: short records cost time, whatever their bytes."""

    reads: int


class Guard:
    """The bytes of a file from `at` to `end`, as the library reads them: never more than are there.

    Attributes
    ----------
    at : int
        Where the next read begins.
    record_at : int
        Where the record that is read begins.
    """

    def __init__(self, stream: BinaryIO, at: int, end: int, budget: Budget) -> None:
        self._read, self._budget, self._opcode = stream.read, budget, 1
        self.at, self.end, self.record_at = at, end, at
        stream.seek(at)

    def read(self, size: int) -> bytes:
        """The next `size` bytes; none at the end, where a record would begin."""
        self._budget.reads -= 1
        if size == 1 and self.at == self.end:
            return b""
        if not 0 <= size <= self.end - self.at or self._budget.reads < 0:
            raise DamagedError("a record ends before its content")
        if size == 8 and self.record_at == self.at - 1 and self._opcode not in _OPCODES:
            raise DamagedError("what should be a record is none")
        data = self._read(size)
        if size == 1:
            self.record_at, self._opcode = self.at, data[0]
        self.at += size
        return data

    def records(self, whole: bool = False) -> Iterator[McapRecord]:
        """The records up to the end; `whole`: of a file from its first byte on, with its CRC."""
        reader = StreamReader(
            self,
            skip_magic=not whole,
            emit_chunks=True,
            validate_crcs=whole,
            record_size_limit=2 * MAX_CHUNK_BYTES,
        )
        try:
            yield from reader.records
        except EndOfFile:
            return


def unpacked(chunk: Chunk) -> bytes:
    """The records of a chunk, decompressed and checked against its CRC.

    Raises
    ------
    DamagedError
        If size, compression or CRC do not fit; what the data says of its own size is not believed.
    """
    size, data = chunk.uncompressed_size, chunk.data
    if size > MAX_CHUNK_BYTES:
        raise DamagedError(f"a chunk of {size} bytes exceeds {MAX_CHUNK_BYTES}")
    try:
        if chunk.compression == "zstd":
            told = zstandard.get_frame_parameters(data).content_size
            if told not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise DamagedError(f"a chunk unpacks to {told} bytes instead of {size}")
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


def records_in(chunk: Chunk, budget: Budget) -> Iterator[McapRecord]:
    """The records of a chunk; see `unpacked`."""
    content = unpacked(chunk)
    return Guard(io.BytesIO(content), 0, len(content), budget).records()
