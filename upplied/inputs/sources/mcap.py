"""MCAP logs: channels of messages, decoded by the schemas in the log."""

from __future__ import annotations

from pathlib import Path

from upplied.inputs.mcap.messages import read_tables
from upplied.inputs.mcap.recording import open_recording
from upplied.inputs.sources.source import Fields, Source


def read(path: Path, fields: Fields) -> Source:
    """The tables of a log."""
    log = open_recording(path)
    tables = read_tables(log, lambda channel: fields.get(channel.schema_short, ()))
    return Source(tables, log.metadata, log.losses, log.listed(), log.read_pct)
