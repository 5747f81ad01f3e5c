"""Keeping a catalog fast and small, while others read and write it.

Small data files become large ones, ordered so that what is read together lies together. Delta-rs's own
compaction mixes the rows of its files: one trajectory then lies in many row groups.
"""

import logging
import math
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from deltalake import CommitProperties, DeltaTable, Transaction
from deltalake.transaction import RemoveAction

from upplied.catalog.reading import Reading
from upplied.catalog.schema.tables import STEPS
from upplied.catalog.store.chain import decoded, encoded, new_file
from upplied.catalog.store.delta import StepTable, StoredTable
from upplied.catalog.store.files import FileStore
from upplied.errors import CatalogError, SettingsError

log = logging.getLogger(__name__)

KEEP_DAYS = 30.0  # of versions that `version` can still ask for
SHORTEST_KEEP_HOURS = 1.0  # a writer that takes longer between points and row would lose its points
CACHE_BYTES = 20 << 30
TARGET_BYTES = 64 << 20  # of a data file
DECODED_BYTES = 256 << 20  # of its rows in memory, where merging holds them some three times
_MANY = 16  # files that are merged while a table is written; their rows differ by less than so many times
_TIDIED_BYTES = 16 << 20  # of rows in memory: a writer has little to spare; the rest is for `merge`

File = dict[str, Any]  # path, size_bytes, modification_time, num_records


@dataclass(frozen=True)
class Removed:
    """What maintenance removed."""

    orphan_commits: dict[str, int]  # of steps, of writers that were stopped, by table
    surfaces_removed: int  # that no plan names
    files_removed: dict[str, int]  # by table
    drafts_removed: int
    runs_removed: int  # that were killed: their jobs
    cache_bytes_freed: int


def compact(catalog: Reading) -> dict[str, int]:
    """Merge small data files, in the order of commits, while others read and write; how many, by table."""
    return {name: merge(table, TARGET_BYTES) for name, table in catalog.tables.items()}


def vacuum(catalog: Reading, keep_days: float = KEEP_DAYS, cache_bytes: int = CACHE_BYTES) -> Removed:
    """Remove what nobody can ask for any more.

    That is: data files that were merged or whose version is older than `keep_days`; points and
    unfinished files of stopped writers, and what their plans see; jobs of killed runs; cache entries unused
    for longest beyond `cache_bytes`. Rows are never removed: `as_of` reaches back to the first one.

    Parameters
    ----------
    catalog : Catalog
    keep_days : float
        Versions younger than this can still be asked for; at least an hour, so that the files of
        writers at work are left alone.
    cache_bytes : int
    """
    hours = keep_days * 24
    if not hours >= SHORTEST_KEEP_HOURS:
        rule = f"at least {SHORTEST_KEEP_HOURS / 24:.3f} (an hour)"
        raise SettingsError("keep_days", f"is {keep_days:g}", rule)
    catalog.identity.required()  # before the clock, whose file would stand in a folder that is no catalog
    before = catalog.clock.now() - timedelta(hours=hours)

    def remove(delta: DeltaTable) -> int:
        # Not an enforced week: the caller states the history, and an hour protects writers.
        removed = delta.vacuum(max(1, int(hours)), dry_run=False, enforce_retention_duration=False, full=True)
        return len(removed)

    steps = [(name, table.files) for name, table in catalog.tables.items() if isinstance(table, StepTable)]
    contents = [store for store in catalog.contents.values() if store.about.of_plans]
    return Removed(
        {name: _drop_unnamed(catalog, files, [(STEPS[name], "commit_id")], before) for name, files in steps},
        # One that is kept again meanwhile counts as young.
        sum(_drop_unnamed(catalog, store.files, store.about.columns, before) for store in contents),
        {name: table.change(remove) or 0 for name, table in catalog.tables.items()},
        0 if "://" in catalog.location else _remove_drafts(Path(catalog.location), before),
        _drop_shards(catalog.shards, before),
        catalog.cache.prune(cache_bytes),
    )


def _drop_unnamed(
    catalog: Reading, files: FileStore, columns: Sequence[tuple[str, str]], before: datetime
) -> int:
    """Remove files older than a moment that no row names in these columns of tables; how many."""
    if not (old := files.older(before)):
        return 0
    read = (catalog.tables[table].read(None, [name])[0].to_pylist() for table, name in columns)
    named = {sha256 for column in read for sha256 in column}
    gone = [name for name in old if name.removesuffix(".parquet") not in named]
    for name in gone:
        files.remove(name)
    return len(gone)


def _drop_shards(shards: FileStore, before: datetime) -> int:
    """Remove the jobs of runs that wrote nothing there since a moment; of how many."""
    runs = {run: FileStore(shards.path(run)) for run in shards.names()}
    gone = [run for run, files in runs.items() if files.names() and files.older(before) == files.names()]
    for run in gone:
        shards.remove_folder(run)
    return len(gone)


def _remove_drafts(root: Path, before: datetime) -> int:
    removed = 0
    for pattern in ("*/*.parquet#*", "*/_delta_log/*.tmp*", "**/.*.draft"):
        for path in root.glob(pattern):
            with suppress(FileNotFoundError):  # finished or removed meanwhile
                if path.stat().st_mtime < before.timestamp():
                    path.unlink()
                    removed += 1
    return removed


def merge(table: StoredTable, size_bytes: int) -> int:
    """Merge files of less than half of some size into ones of about that size; how many were merged."""
    merged = 0
    while count := table.change(lambda delta: _merged(table, delta, _oldest_small(table, delta, size_bytes))):
        merged += count
    return merged


def tidy(table: StoredTable, version: int) -> None:
    """Merge small files of a table now and then, beside those who write it; questions stay quick."""
    # Every sixteenth commit does so, in a thread that only the end of the process waits for, and for files of
    # about one size, so that a row is written again only as its file grows sixteenfold. Errors are logged.
    beside = table.beside() if version % _MANY == 0 else table

    def act() -> None:
        try:
            while beside.change(lambda delta: _merged(beside, delta, _of_a_size(beside, delta))):
                pa.default_memory_pool().release_unused()  # what this thread took would stay with the process
        except CatalogError as error:
            log.warning("small files of %s were not merged: %s", table.uri, error)

    if beside is not table:
        threading.Thread(target=act, name=f"tidy {table.declared.name}").start()


def _merged(table: StoredTable, delta: DeltaTable, chosen: list[File]) -> int:
    if len(chosen) < 2:
        return 0
    # One file after the other, with texts that repeat once: a row's settings alone take kilobytes.
    files = (table.rows_in(delta, [file["path"]]) for file in chosen)
    parts = [encoded(rows.to_table(use_threads=False)) for rows in files]
    rows = pa.concat_tables(parts).unify_dictionaries()
    order = [(name, "ascending") for name in table.declared.order]
    rows = rows.take(pc.sort_indices(decoded(rows.select(table.declared.order)), sort_keys=order))
    now = int(time.time() * 1000)
    sought = [name for name in table.declared.sought if name in rows.column_names]  # not all, of older rows
    added = replace(new_file(FileStore(table.uri), rows, sought), data_change=False)
    removed = [RemoveAction(file["path"], False, now, file["size_bytes"], {}) for file in chosen]
    # Delta-rs does not see that two removals contradict each other, but that both advance one transaction.
    turns, schema = [Transaction("upplied.maintenance", time.time_ns())], decoded(rows[:0]).schema
    commit = CommitProperties({"doing": "maintenance"}, max_commit_retries=30, app_transactions=turns)
    delta.create_write_transaction([added, *removed], "append", schema, commit_properties=commit)
    return len(chosen)


def _oldest_small(table: StoredTable, delta: DeltaTable, size_bytes: int) -> list[File]:
    """The oldest files less than half of some size, or of what is decoded at once, that together make it."""
    files, chosen, fill = _files(delta), list[File](), 0.0
    row_bytes = _row_bytes(table, delta, files)
    for file in files:
        share = max(file["size_bytes"] / size_bytes, (file["num_records"] or 0) * row_bytes / DECODED_BYTES)
        if share >= 0.5:
            continue
        if len(chosen) > 1 and fill + share > 1:
            break
        chosen.append(file)
        fill += share
    return chosen


def _of_a_size(table: StoredTable, delta: DeltaTable) -> list[File]:
    """The oldest of the smallest files that are many and have about as many rows."""
    classes: dict[int, list[File]] = {}
    for file in _files(delta):
        classes.setdefault(int(math.log(max(file["num_records"] or 1, 1), _MANY)), []).append(file)
    many = next((files[:_MANY] for _, files in sorted(classes.items()) if len(files) >= _MANY), [])
    rows = sum(file["num_records"] or 0 for file in many)
    return [] if rows * _row_bytes(table, delta, many) > _TIDIED_BYTES else many


def _files(delta: DeltaTable) -> list[File]:
    names = ["path", "size_bytes", "modification_time", "num_records"]
    files = pa.table(delta.get_add_actions()).select(names).to_pylist()
    return sorted(files, key=lambda file: (file["modification_time"], file["path"]))


def _row_bytes(table: StoredTable, delta: DeltaTable, files: list[File]) -> float:  # in memory, about
    if not files:
        return 0.0
    some = table.rows_in(delta, [files[0]["path"]]).head(100, use_threads=False)
    return some.nbytes / max(len(some), 1)
