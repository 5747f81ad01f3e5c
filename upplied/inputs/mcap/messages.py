"""Messages of the wanted channels as columns: one table per channel, in one pass over the log."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import zstandard

from upplied.inputs.mcap.decoders import Decoder
from upplied.inputs.mcap.recording import MAX_MESSAGES, Recording, Sink
from upplied.inputs.mcap.rosmsg import DefinitionError
from upplied.inputs.tables import Channel, Piece, Table, stacked

_MAX_CHANNELS = 500
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"  # no CDR begins so
_MAX_PAYLOAD_BYTES = 2**20  # a pose or a tree of transforms is far smaller


def read_tables(recording: Recording, fields: Callable[[Channel], Iterable[str]]) -> list[Table]:
    """The tables of every channel for which `fields` names paths, in one pass over the log."""
    builders: dict[int, _Builder] = {}

    def sink_of(channel: Channel) -> Sink | None:
        paths = tuple(fields(channel))
        if not paths:
            return None
        recording.check(len(builders) + 1, (_MAX_CHANNELS, 0.0), "channels of poses")
        builder = builders[channel.channel_id] = _Builder(channel, paths)
        return builder.sink

    for _ in recording.read(sink_of):
        for builder in builders.values():
            if builder.sink:
                held = sum(one.rows for one in builders.values())
                held += builder.decode(recording.limit(MAX_MESSAGES) - held)
                recording.check(held, MAX_MESSAGES, "messages of poses")
    tables = [builders[channel_id].table() for channel_id in sorted(builders)]
    recording.compare({table.channel.channel_id: table.messages for table in tables})
    return tables


class _Builder:
    """Collects the messages of a channel and decodes them chunk by chunk."""

    def __init__(self, channel: Channel, paths: tuple[str, ...]) -> None:
        self.sink: Sink = []
        self.rows = 0
        self._table = Table(channel)
        self._paths = paths
        self._pieces: list[Piece] = []
        self._decoder: Decoder | None = None
        try:
            self._decoder = Decoder(channel)
        except DefinitionError as error:
            self._table.problem = str(error)

    def table(self) -> Table:
        """What was collected."""
        self._table.columns, times = stacked(self._pieces)
        self._table.log_ns, self._table.publish_ns = times[:, 0], times[:, 1]
        return self._table

    def decode(self, most: int) -> int:
        """How many rows the messages that wait hold, once they are columns; about `most` are read."""
        self._table.messages += len(self.sink)
        held = [message for message in self.sink if len(message[2]) <= _MAX_PAYLOAD_BYTES]
        if len(held) < len(self.sink):
            self._table.dropped["too large a message"] += len(self.sink) - len(held)
        self.sink.clear()
        if self._decoder is None or not held:
            return 0
        log_ns, publish_ns, payloads = zip(*held, strict=True)
        if self._table.channel.encoding == "cdr" and payloads[0].startswith(_ZSTD_MAGIC):
            payloads = tuple(map(_unwrapped, payloads))
        columns, row, unreadable = self._decoder.columns(payloads, self._paths, most)
        if unreadable:
            self._table.dropped["unreadable message"] += unreadable
        self.rows += len(row)
        if len(row):
            times = np.array([log_ns, publish_ns], np.uint64).T.astype(np.int64)
            self._pieces.append((columns, np.maximum(times, 0)[row]))
        return len(row)


def _unwrapped(payload: bytes) -> bytes:
    """A message that rosbag2 compressed by itself; empty, and so unreadable, where it is damaged."""
    try:
        if zstandard.get_frame_parameters(payload).content_size > _MAX_PAYLOAD_BYTES:
            return b""
        return zstandard.ZstdDecompressor().decompress(payload, max_output_size=_MAX_PAYLOAD_BYTES)
    except zstandard.ZstdError:
        return b""
