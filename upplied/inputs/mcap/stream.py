"""Records of an MCAP file by the `mcap` library, each from its own bytes alone.

Its `StreamReader` believes a file's sizes, returns short reads as records, and never ends on unknown kinds.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema, Statistics

MAX_CHUNK_BYTES = 256 * 2**20  # of one chunk, unpacked; recorders write 1 to 16 MiB
# Of the specification, and those it leaves to others; a record of a reserved kind is damage.
OPCODES = frozenset([*range(1, 16), *range(128, 256)])
#: What is read of the others, by opcode.
READ: dict[int, Any] = {2: Footer, 3: Schema, 4: Channel, 6: Chunk, 11: Statistics, 12: Metadata, 15: DataEnd}
MESSAGE = 5


class DamagedError(ValueError):
    """Bytes that contradict their own sizes, kinds or checksums."""


# What the library raises for damaged files: the class does not tell the damage.
DAMAGE = (McapError, ValueError, struct.error, OverflowError, MemoryError)


class _Content(BytesIO):
    """The bytes of one record: never more are read than there are."""

    def read(self, size: int | None = -1) -> bytes:
        if size is None or len(data := super().read(size)) != size:
            raise DamagedError("a record ends before its content")
        return data


def records_in(data: bytes) -> Iterator[McapRecord | None]:
    """The records that these bytes hold, one after the other; None for one of a kind that is not read."""
    at = 0
    while at < len(data):
        opcode, stop = data[at], at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        if opcode not in OPCODES:
            raise DamagedError("a record is of no known kind")
        if stop > len(data):
            raise DamagedError("a record ends before its content")
        if opcode == MESSAGE:
            yield Message.read(ReadDataStream(_Content(data[at + 9 : stop])), stop - at - 9)
        else:
            kind = READ.get(opcode)
            yield kind and kind.read(ReadDataStream(_Content(data[at + 9 : stop])))
        at = stop


def unpacked(chunk: Chunk) -> bytes:
    """The records of a chunk, decompressed; DamagedError if size, compression or CRC do not fit."""
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
