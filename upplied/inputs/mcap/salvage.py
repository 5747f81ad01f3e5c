"""What is left of a log whose index cannot be used: unfinished, truncated or damaged.

The library's stream reader goes from the front, record by record. Where it loses its footing the
next chunk is looked for, so that damage costs the chunks it hit and no more.
"""

from __future__ import annotations

from typing import Any, BinaryIO, Protocol

from mcap.records import DataEnd
from mcap.stream_reader import CRCValidationError

from upplied.inputs.mcap.stream import DAMAGE, Guard

_CHUNK, _MAGIC_BYTES = 6, 8
_ANCHORS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")  # the name of the compression in a chunk
_ANCHOR_AT = 9 + 28  # from the start of the chunk's record
_WINDOW = 2**20


class Found(Protocol):
    """What receives the records of a damaged log, as `recording.Recording` does."""

    size: int  # of the file, bytes
    read_to: int  # byte at which the salvaged log ends
    losses: list[str]
    lost_bytes: int

    def budget(self) -> Any:
        """How often a reader of all its records may read."""

    def add(self, record: Any, start: int, stop: int) -> None:
        """Take a record that lies between two bytes of the file."""


def scan(stream: BinaryIO, recording: Found, why: str) -> None:
    """Find every record from front to back.

    Parameters
    ----------
    stream : binary file
    recording : Found
        Empty; receives channels, metadata, chunks and messages, and in `losses` what was lost.
    why : str
        Why the index could not be used; empty where the log has none, which is no fault.
    """
    at, budget = _MAGIC_BYTES, recording.budget()
    found: int | None = 0
    while found is not None:
        guard = Guard(stream, found, recording.size, budget)
        try:
            for record in guard.records(whole=found == 0):
                if isinstance(record, DataEnd):
                    recording.losses += [f"{why}, though its data is whole"] if why else []
                    return
                recording.add(record, guard.record_at, guard.at)
                at = guard.at
        except CRCValidationError:
            recording.losses += ["the data fails its CRC", *([why] if why else [])]
            return
        except DAMAGE:
            pass
        found = _next_chunk(stream, max(at, found + 1), recording.size)
        if found is not None:
            recording.losses.append(f"{found - at} bytes lost at byte {at}")
            recording.lost_bytes += found - at
            at = found
    recording.read_to = at
    recording.losses.append(f"{why or 'the data is cut off'}; read up to byte {at} of {recording.size}")


def _next_chunk(stream: BinaryIO, start: int, size: int) -> int | None:
    """Where the next whole compressed chunk begins, or None."""
    while start < size:
        stream.seek(start)
        window = stream.read(_WINDOW + _ANCHOR_AT + 16)
        for hit in sorted(hit for anchor in _ANCHORS for hit in _hits(window, anchor)):
            begin = hit - _ANCHOR_AT
            length = int.from_bytes(window[begin + 1 : begin + 9], "little")
            if begin >= 0 and window[begin] == _CHUNK and start + begin + 9 + length <= size:
                return start + begin
        start += _WINDOW
    return None


def _hits(window: bytes, anchor: bytes) -> list[int]:
    found, at = [], window.find(anchor)
    while at >= 0:
        found.append(at)
        at = window.find(anchor, at + 1)
    return found
