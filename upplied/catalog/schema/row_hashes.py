"""The hash of a row: of the names and values of all its fields, the same on every machine.

A field that is null or an empty text has no part in it: columns that came later leave older hashes as they
are. Numbers count by their bits.
"""

from __future__ import annotations

import hashlib

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.columns import BEFORE_SHA256, MOMENT, ROW_SHA256

_TEXT = pa.large_string()
_COLON = pa.scalar(":", _TEXT)
_ROWS = 4096  # hashed at a time: a row of plans takes kilobytes
_OWN = (ROW_SHA256, BEFORE_SHA256)


def content_hashes(rows: pa.Table) -> list[str]:
    """The hash of each row, but for its own hash and that of the row before it."""
    names = sorted(set(rows.column_names) - {*_OWN})
    return [
        hashlib.sha256(text).hexdigest()
        for start in range(0, len(rows), _ROWS)
        for text in _texts(rows.select(names).slice(start, _ROWS))
    ]


def link(before: str, content: str) -> str:
    """The hash of a row that follows another one.

    Parameters
    ----------
    before : str
        The hash of that one; empty for the first row of all.
    content : str
        Of this one, by `content_hashes`.
    """
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


def _texts(rows: pa.Table) -> list[bytes]:
    """What is hashed of each row: its fields by name, each with its length, so that none runs on."""
    parts = []
    for name in rows.column_names:
        values = _text(rows[name].combine_chunks())
        if values.null_count < len(values):
            length = pc.binary_length(values).cast(_TEXT)
            parts.append(pc.binary_join_element_wise(pa.scalar(name, _TEXT), length, values, _COLON))
    if not parts:
        return [b""] * len(rows)
    joined = pc.binary_join_element_wise(*parts, pa.scalar("\n", _TEXT), null_handling="skip")
    found: list[bytes] = joined.cast(pa.large_binary()).to_pylist()
    return found


def _text(values: pa.Array) -> pa.Array:
    """Values as texts, nothing where they say nothing."""
    kind = values.type
    if pa.types.is_dictionary(kind):
        return _text(values.cast(kind.value_type))
    if pa.types.is_timestamp(kind):
        values = values.cast(MOMENT).cast(pa.int64())
    elif pa.types.is_floating(kind):
        values = pc.if_else(pc.is_nan(values), None, values.cast(pa.float64()))
        values = pa.Array.from_buffers(pa.int64(), len(values), values.buffers(), offset=values.offset)
    elif pa.types.is_nested(kind):  # of a newer program; we have none
        values = pa.array([None if value is None else repr(value) for value in values.to_pylist()])
    texts = values.cast(_TEXT)
    return pc.if_else(pc.equal(texts, ""), None, texts)
