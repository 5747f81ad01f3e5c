"""Small data files into large ones, with the rows that are asked for together lying together.

Not delta-rs's own compaction: that one mixes the rows of the files it reads at the same time, so
that one trajectory lies in many row groups.
"""

from __future__ import annotations

import logging
import time
from dataclasses import replace

import pyarrow as pa
from deltalake import CommitProperties, DeltaTable, Transaction
from deltalake.transaction import RemoveAction

from upplied.catalog.store.delta import StoredTable
from upplied.errors import CatalogError

log = logging.getLogger(__name__)

TARGET_BYTES = 64 << 20  # of a data file
DECODED_BYTES = 256 << 20  # of its rows in memory, where merging holds them some three times
_ROWS_WEIGHED = 100
_LOOKED_AT = 16
_MANY = 32


def merge(table: StoredTable, size_bytes: int) -> int:
    """Merge files of less than half of some size into ones of about that size; how many were merged."""
    merged = 0
    while done := table.change(lambda delta: _merge_oldest(table, delta, size_bytes)):
        merged += done
    return merged


def tidy(table: StoredTable, size_bytes: int) -> None:
    """Merge the small files of a table now and then, while it is written; questions stay quick.

    Whoever makes every sixteenth commit looks, and merges where there are many. What hinders it is no
    matter of the row that was added.
    """
    try:
        delta = table.delta()
        if delta is None or delta.version() % _LOOKED_AT:
            return
        if len(_small(table, delta, size_bytes)) >= _MANY:
            table.change(lambda found: _merge_oldest(table, found, size_bytes))
    except CatalogError as error:
        log.warning("small files of %s were not merged: %s", table.uri, error)


def removing() -> CommitProperties:
    """What marks commits that remove files.

    Delta-rs does not see that two of our removals contradict each other. It does see that both
    advance the same transaction: the second one fails, and is done again on what is there then.
    """
    turn = Transaction("upplied.maintenance", time.time_ns())
    return CommitProperties({"doing": "maintenance"}, max_commit_retries=30, app_transactions=[turn])


def _merge_oldest(table: StoredTable, delta: DeltaTable, size_bytes: int) -> int:
    chosen = _oldest_small(table, delta, size_bytes)
    if len(chosen) < 2:
        return 0
    rows = _rows_of(table, delta, set(chosen))
    rows = rows.sort_by([(name, "ascending") for name in table.declared.order])
    now = int(time.time() * 1000)
    added = replace(table.new_file(rows), data_change=False)
    removed = [RemoveAction(name, False, now, size, {}) for name, size in chosen.items()]
    delta.create_write_transaction([added, *removed], "append", rows.schema, commit_properties=removing())
    return len(chosen)


def _oldest_small(table: StoredTable, delta: DeltaTable, size_bytes: int) -> dict[str, int]:
    """Names and sizes of the oldest small files that together make one of about that size."""
    chosen: dict[str, int] = {}
    held = 0.0
    for name, size, share in _small(table, delta, size_bytes):
        if len(chosen) > 1 and held + share > 1:
            break
        chosen[name] = size
        held += share
    return chosen


def _small(table: StoredTable, delta: DeltaTable, size_bytes: int) -> list[tuple[str, int, float]]:
    """Files less than half of the largest that is made, oldest first: name, size, and share of that."""
    files = pa.table(delta.get_add_actions())
    row_bytes = _row_bytes(table, delta)
    found = []
    for file in sorted(files.to_pylist(), key=lambda file: (file["modification_time"], file["path"])):
        size, rows = file["size_bytes"], file["num_records"] or 0
        share = max(size / size_bytes, rows * row_bytes / DECODED_BYTES)
        if share < 0.5:
            found.append((file["path"], size, share))
    return found


def _row_bytes(table: StoredTable, delta: DeltaTable) -> float:
    """What a row takes in memory, bytes, told from some."""
    some = table.rows_of(delta).head(_ROWS_WEIGHED)
    return some.nbytes / max(len(some), 1)


def _rows_of(table: StoredTable, delta: DeltaTable, names: set[str]) -> pa.Table:
    """All rows of some data files, in the table's own schema: a newer program's columns are kept."""
    dataset = table.rows_of(delta)
    parts = [part for part in dataset.get_fragments() if part.path.rsplit("/", 1)[-1] in names]
    return pa.concat_tables([part.to_table(schema=dataset.schema) for part in parts])
