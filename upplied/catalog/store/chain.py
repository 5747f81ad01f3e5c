"""Data files, written before a commit names them, whose rows carry hashes; and hashes of a log's entries.

A row has that of its own content and, in the tables of one place, of the row before it: who noted the last
one (`head_of`) can tell that no row was changed since. Of a log each entry, or checkpoint, states the hashes
that none before it states, the newest `opening.Heads`.
"""

import hashlib
import json
import re
import secrets
import time
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from io import BytesIO
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from deltalake.transaction import AddAction

from upplied.catalog.schema.tables import BEFORE_SHA256, MOMENT, ROW_SHA256, Table
from upplied.catalog.store.files import FileStore
from upplied.records import Ints

_HASH, _BEFORE = ROW_SHA256, BEFORE_SHA256
_TEXT = pa.large_string()
_COLON, _NONE = pa.scalar(":", _TEXT), pa.scalar("", _TEXT)
_ROWS = 4096  # hashed at a time: a row of plans takes kilobytes


def sealed(rows: pa.Table, stored: pa.Table | None) -> pa.Table:
    """Rows about to be committed, with their hashes; `stored` are all, where rows follow each other."""
    if _HASH not in rows.column_names:
        return rows
    hashes = content_hashes(rows)
    if stored is not None:
        before = [head_of(stored)]
        for content in hashes:
            before.append(_link(before[-1], content))
        rows, hashes = _with(rows, _BEFORE, before[:-1]), before[1:]
    return _with(rows, _HASH, hashes)


def head_of(stored: pa.Table) -> str:
    """The hash that the next row follows; empty without rows. Rows without hashes count as one."""
    followed = set(stored[_BEFORE].to_pylist())
    hashes = zip(stored[_HASH].to_pylist(), stored["commit_version"].to_pylist(), strict=True)
    last = [(version, name) for name, version in hashes if name and name not in followed]
    return str(max(last, key=lambda one: one[0])[1]) if last else _root_of(stored)


def _root_of(stored: pa.Table) -> str:
    """What the first row with a hash follows: the hash of all that have none; empty where there are none."""
    older = content_hashes(stored.filter(pc.equal(pc.coalesce(stored[_HASH], ""), "")))
    return hashlib.sha256("\n".join(sorted(older)).encode()).hexdigest() if older else ""


def breaks(table: Table, parts: Iterable[pa.Table]) -> Iterator[tuple[str, str]]:
    """Rows, some at a time, that are not as written or do not follow each other: which, and what is wrong."""
    chain: list[pa.Table] = []
    for part in parts:
        yield from changed_rows(table, part)
        if table.is_chained:
            chain.append(part)
    if chain:
        yield from _loose(table.names[0], pa.concat_tables(chain, promote_options="default"))


def changed_rows(table: Table, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Rows, with all their columns, that do not match their own hashes: which, and what is wrong."""
    before = rows[_BEFORE].to_pylist() if table.is_chained else [None] * len(rows)
    names, stated = rows[table.names[0]].to_pylist(), rows[_HASH].to_pylist()
    for name, content, own, one in zip(names, content_hashes(rows), stated, before, strict=True):
        if own and own != (content if one is None else _link(one, content)):
            yield str(name), "does not match its hash: it was changed after it was written"


def _loose(key: str, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Rows of a chain that follow no other one, or follow one that another follows."""
    linked = rows.filter(pc.not_equal(pc.coalesce(rows[_HASH], ""), "")).sort_by("commit_version")
    known, followed = {_root_of(rows), *linked[_HASH].to_pylist()}, set()
    befores = pc.coalesce(linked[_BEFORE], "").to_pylist()
    for name, before in zip(linked[key].to_pylist(), befores, strict=True):
        if before not in known:
            yield str(name), "follows a row that is not there: one was taken away or changed"
        elif before in followed:
            yield str(name), "follows a row that another one follows: one of them was put in"
        followed.add(before)


def _with(rows: pa.Table, name: str, values: list[str]) -> pa.Table:
    at = rows.schema.get_field_index(name)
    return rows.set_column(at, rows.schema.field(at), pa.array(values, pa.string()))


def _link(before: str, content: str) -> str:
    """The hash of a row of some content that follows the one of a hash, empty for the first of all."""
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


def content_hashes(rows: pa.Table) -> list[str]:
    """The hash of each row, but for its own hash and that of the row before it."""
    # Null and empty fields count for nothing: columns that came later leave older hashes as they are.
    names, hashes = sorted(set(rows.column_names) - {_HASH, _BEFORE}), list[str]()
    for start in range(0, len(rows), _ROWS):
        bounds, text = _texts(rows.select(names).slice(start, _ROWS))
        ends = zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
        hashes += [hashlib.sha256(text[min(begin + 1, end) : end]).hexdigest() for begin, end in ends]
    return hashes


def _texts(rows: pa.Table) -> tuple[Ints, memoryview]:
    """What is hashed of each row, in one buffer: where each begins, with a line's end, and the last ends."""
    # The fields by name, each with its length, so that none runs on; what all rows say alike is one text.
    parts, alike = list[Any](), ""
    for name in rows.column_names:
        column = rows[name].combine_chunks()
        if column.null_count == len(column) or (values := _text(column)).null_count == len(values):
            continue
        lengths = pc.binary_length(values)
        least, most = pc.min_max(lengths).values()
        if values.null_count:
            field = pa.scalar(f"\n{name}", _TEXT), lengths.cast(_TEXT), values, _COLON
            parts += [pa.scalar(alike, _TEXT), pc.binary_join_element_wise(*field)]
        elif least != most:
            parts += [pa.scalar(f"{alike}\n{name}:", _TEXT), lengths.cast(_TEXT), _COLON, values]
        else:
            alike += f"\n{name}:{least}:"
            if pc.all(pc.equal(values, values[0])).as_py():
                alike += values[0].as_py()
                continue
            parts += [pa.scalar(alike, _TEXT), values]
        alike = ""
    parts += [pa.scalar(alike, _TEXT), pa.array([""] * len(rows), _TEXT)]
    lines = pc.binary_join_element_wise(*parts, _NONE, null_handling="skip")
    _, offsets, text = lines.buffers()
    return np.frombuffer(offsets, np.int64, len(lines) + 1, 8 * lines.offset), memoryview(text or b"")


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
    textual = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    return pc.if_else(pc.equal(texts, ""), None, texts) if textual else texts


STATED = "upplied.log"  # property of a commit: name -> hash of entries of the log
CHECKPOINTS = 50  # entries to a checkpoint
_MOST = 100  # entries that are looked back at: those of an older program state nothing
_NAME = re.compile(r"[0-9]{20}(\.checkpoint)?\.(json|parquet)")


def unstated(log: FileStore, version: int) -> dict[str, str]:
    """The hashes of the entries up to a version that none of them states; of two racing writers both."""
    hashes, stated = dict[str, str](), -1
    for number in range(version, max(version - _MOST, -1), -1):
        if number <= stated:
            break
        try:
            content = log.read(name := f"{number:020}.json")
        except FileNotFoundError:
            break  # cleaned away: older than anybody asks for
        hashes[name] = _sha256(content)
        stated = max([stated, *(int(other[:20]) for other in _stated_in(content))])
        name = f"{number:020}.checkpoint.parquet"
        if (number + 1) % CHECKPOINTS == 0 and log.has(name):
            hashes[name] = _sha256(log.read(name))
    return hashes


def _commit(content: bytes) -> dict[str, Any]:
    lines = (line for line in content.splitlines() if line.startswith(b'{"commitInfo"'))
    return dict(json.loads(next(lines, b'{"commitInfo": {}}'))["commitInfo"])


def _stated_in(content: bytes) -> dict[str, str]:
    hashes = json.loads(_commit(content).get(STATED, "{}")).items()
    return {name: str(value) for name, value in hashes if _NAME.fullmatch(name)}


def rows_added(log: FileStore) -> int:
    """How many rows a log says were added, by the entries that were not cleaned away."""
    names = [name for name in log.names() if _NAME.fullmatch(name) and name.endswith(".json")]
    try:
        rows = [str(_commit(log.read(name)).get("rows", "")) for name in names]
    except (ValueError, AttributeError, KeyError, TypeError):
        return 0  # a finding of its own
    return sum(int(count) for count in rows if count.isdigit())


def changed_entries(log: FileStore, newest: str) -> Iterator[tuple[str, str]]:
    """Entries that are not as stated, and what is wrong; `newest` is what stands beside the log, as JSON."""
    contents = {name: log.read(name) for name in log.names() if _NAME.fullmatch(name)}
    stated: list[tuple[str, str]] = []
    try:
        stated += json.loads(newest or "{}").items()
        if "\n" in newest or (newest and json.dumps(json.loads(newest)) != newest):
            raise ValueError("it has other words")
    except (ValueError, AttributeError):
        yield "what is stated of the newest entry", "was changed after it was written"
    for name, content in contents.items():
        if name.endswith(".json"):
            try:
                stated += _stated_in(content).items()
            except (ValueError, AttributeError, KeyError, TypeError) as error:
                yield name, f"cannot be read: {error}"
    for name, sha256 in dict.fromkeys(stated):
        if not _NAME.fullmatch(name) or (name in contents and _sha256(contents[name]) != sha256):
            yield name, "was changed after it was written, or what is stated of it was"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


ROW_GROUP = 16_384
_LONGEST_STATISTIC = 64
_NAMES = ("transfer_id", "key", "waypoints_sha256")  # hardly one twice


def new_file(files: FileStore, rows: pa.Table, sought: Sequence[str]) -> AddAction:
    """Write a data file that no commit names yet; readers may skip it by the columns that are sought."""
    sink = BytesIO()
    # Without Arrow's own schema, which is as large as a hundred rows; texts may be dictionaries.
    pq.write_table(rows, sink, row_group_size=ROW_GROUP, compression="zstd", store_schema=False)
    name = f"part-{hashlib.sha256(sink.getbuffer()).hexdigest()}-{secrets.token_hex(4)}.parquet"
    files.write(name, sink.getvalue())
    ranges = statistics(decoded(rows.select(sought)))
    return AddAction(name, sink.tell(), {}, int(time.time() * 1000), True, ranges)


def statistics(rows: pa.Table) -> str:
    """What readers may skip a file by: the range of each column, and its nulls; long texts have no range."""
    # A column that is filtered by must have one: pyarrow takes a missing range for nulls.
    low, high = {}, {}
    for name in rows.column_names:
        least, most = pc.min_max(rows[name]).as_py().values()
        if most is None or len(str(most)) > _LONGEST_STATISTIC or most != most:
            continue
        if isinstance(most, datetime):
            most += timedelta(milliseconds=1)
            least, most = (when.isoformat(timespec="milliseconds") for when in (least, most))
        low[name], high[name] = least, most
    nulls = {name: rows[name].null_count for name in rows.column_names}
    return json.dumps({"numRecords": len(rows), "minValues": low, "maxValues": high, "nullCount": nulls})


def encoded(rows: pa.Table) -> pa.Table:
    """Rows with repeated texts as dictionaries; copied, since columns as read keep ten times their bytes."""
    for at, field in enumerate(rows.schema):
        if pa.types.is_string(field.type) and field.name not in _NAMES:
            rows = rows.set_column(at, field.name, rows.column(at).dictionary_encode())
    return rows.take(pa.array(np.arange(len(rows))))


def decoded(rows: pa.Table) -> pa.Table:
    """Rows whose dictionaries are plain columns again."""
    fields = [f.with_type(f.type.value_type) if pa.types.is_dictionary(f.type) else f for f in rows.schema]
    return rows.cast(pa.schema(fields, rows.schema.metadata))
