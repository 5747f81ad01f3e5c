"""What is left of a log whose index cannot be used: unfinished, truncated or damaged.

The file is walked record by record from the front. Where the walk loses its footing it looks for
the next chunk, so that damage costs the chunks it hit and no more.
"""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, BinaryIO

from upplied.inputs.mcap import records as mcap

if TYPE_CHECKING:
    from upplied.inputs.mcap.recording import Recording

_KNOWN = range(mcap.HEADER, mcap.DATA_END + 1)
_ANCHORS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")  # the name of the compression in a chunk
_ANCHOR_AT = 9 + 28  # from the start of the chunk's record
_WINDOW = 2**20


def scan(stream: BinaryIO, recording: Recording, why: str) -> None:
    """Find every record from front to back.

    Parameters
    ----------
    stream : binary file
    recording : Recording
        Empty; receives channels, metadata, chunks and messages, and in `losses` what was lost.
    why : str
        Why the index could not be used; empty where the log has none, which is no fault.
    """
    at = len(mcap.MAGIC)
    while at + 9 <= recording.size:
        stream.seek(at)
        head = stream.read(9)
        opcode, length = head[0], int.from_bytes(head[1:], "little")
        if opcode == mcap.DATA_END and length <= 64:
            if recording.loose and not _sound(stream, at, length):
                recording.losses.append("the data fails its CRC")
            if why:
                recording.losses.append(f"{why}, though its data is whole")
            return
        if (
            opcode in _KNOWN
            and at + 9 + length <= recording.size
            and _keep(stream, opcode, length, recording)
        ):
            at += 9 + length
            continue
        found = _next_chunk(stream, at + 1, recording.size)
        if found is None:
            break
        recording.losses.append(f"{found - at} bytes lost at byte {at}")
        at = found
    recording.losses.append(f"{why or 'the data is cut off'}; read up to byte {at} of {recording.size}")


def _keep(stream: BinaryIO, opcode: int, length: int, recording: Recording) -> bool:
    start = stream.tell()
    if opcode == mcap.CHUNK:
        if length < 40:
            return False
        recording.chunks.append(mcap.ChunkRef(start, length))
    elif opcode == mcap.MESSAGE:
        if length < 22:
            return False
        channel_id = int.from_bytes(stream.read(2), "little")
        recording.loose.append((channel_id, mcap.ChunkRef(start, length)))
    elif opcode in (mcap.SCHEMA, mcap.CHANNEL, mcap.METADATA):
        if length > mcap.MAX_RECORD_BYTES:
            return False
        try:
            recording.add(opcode, stream.read(length))
        except mcap.DamagedError:
            return False
    return True


def _sound(stream: BinaryIO, end: int, length: int) -> bool:
    """Whether the bytes before the end of the data fit their CRC, where there is one."""
    told = int.from_bytes(stream.read(min(length, 4)), "little")
    stream.seek(0)
    crc, left = 0, end if told else 0
    while left > 0:
        piece = stream.read(min(left, _WINDOW))
        crc, left = zlib.crc32(piece, crc), left - len(piece)
        if not piece:
            break
    return crc == told


def _next_chunk(stream: BinaryIO, start: int, size: int) -> int | None:
    """Where the next whole compressed chunk begins, or None."""
    overlap = _ANCHOR_AT + 16
    while start < size:
        stream.seek(start)
        window = stream.read(_WINDOW + overlap)
        hits = sorted(hit for anchor in _ANCHORS for hit in _hits(window, anchor))
        for hit in hits:
            begin = hit - _ANCHOR_AT
            length = int.from_bytes(window[begin + 1 : begin + 9], "little")
            if begin >= 0 and window[begin] == mcap.CHUNK and start + begin + 9 + length <= size:
                return start + begin
        start += _WINDOW
    return None


def _hits(window: bytes, anchor: bytes) -> list[int]:
    found, at = [], window.find(anchor)
    while at >= 0:
        found.append(at)
        at = window.find(anchor, at + 1)
    return found
