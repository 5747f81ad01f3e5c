"""Rows with their hashes: each of its own content and, in the tables of one place, of the row before it.

Who knows the hash of the last row (`head_of`) can tell later that no row before it was changed, taken away or
put in: it is printed where people keep it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.columns import BEFORE_SHA256, ROW_SHA256, Table
from upplied.catalog.schema.row_hashes import content_hashes, link

_HASH, _BEFORE = ROW_SHA256, BEFORE_SHA256


def sealed(rows: pa.Table, stored: pa.Table | None) -> pa.Table:
    """Rows that are about to be committed, with their hashes.

    Parameters
    ----------
    rows : Table
        Complete but for their hashes.
    stored : Table or None
        All that are there, where rows follow each other.
    """
    if _HASH not in rows.column_names:
        return rows
    hashes = content_hashes(rows)
    if stored is not None:
        before = [head_of(stored)]
        for content in hashes:
            before.append(link(before[-1], content))
        rows, hashes = _with(rows, _BEFORE, before[:-1]), before[1:]
    return _with(rows, _HASH, hashes)


def head_of(stored: pa.Table) -> str:
    """The hash that the next row follows; empty where there is no row.

    Rows of before there were hashes count as one: by the hash of all of theirs.
    """
    followed = set(stored[_BEFORE].to_pylist())
    last = [name for name in stored[_HASH].to_pylist() if name and name not in followed]
    newest = stored.filter(pc.is_in(stored[_HASH], pa.array(last, pa.string())))
    if not last:
        return root_of(stored)
    order = newest["commit_version"].to_pylist()
    return str(newest[_HASH][max(range(len(order)), key=order.__getitem__)])


def root_of(stored: pa.Table) -> str:
    """What the first row with a hash follows: the hash of all that have none; empty where there are none."""
    older = content_hashes(stored.filter(pc.equal(pc.coalesce(stored[_HASH], ""), "")))
    return hashlib.sha256("\n".join(sorted(older)).encode()).hexdigest() if older else ""


def breaks(table: Table, parts: Iterable[pa.Table]) -> Iterator[tuple[str, str]]:
    """Rows that are not those that were written, or do not follow each other: which, and what is wrong.

    Parameters
    ----------
    table : Table
    parts : iterable of Table
        All rows with all their columns, some at a time.
    """
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
    for name, content, said, one in zip(names, content_hashes(rows), stated, before, strict=True):
        if said and said != (content if one is None else link(one, content)):
            yield str(name), "does not match its hash: it was changed after it was written"


def _loose(key: str, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Rows of a chain that follow no other one, or follow one that another follows."""
    linked = rows.filter(pc.not_equal(pc.coalesce(rows[_HASH], ""), "")).sort_by("commit_version")
    known, followed = {root_of(rows), *linked[_HASH].to_pylist()}, set()
    for name, before in zip(linked[key].to_pylist(), linked[_BEFORE].to_pylist(), strict=True):
        before = before or ""
        if before not in known:
            yield str(name), "follows a row that is not there: one was taken away or changed"
        elif before in followed:
            yield str(name), "follows a row that another one follows: one of them was put in"
        followed.add(before)


def _with(rows: pa.Table, name: str, values: list[str]) -> pa.Table:
    at = rows.schema.get_field_index(name)
    return rows.set_column(at, rows.schema.field(at), pa.array(values, pa.string()))
