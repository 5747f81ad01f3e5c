"""Keeping a catalog fast and small, while others read and write it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from deltalake import DeltaTable

from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import STEPS
from upplied.catalog.store.delta import StepTable
from upplied.catalog.store.files import FileStore
from upplied.catalog.store.merging import TARGET_BYTES, merge
from upplied.errors import SettingsError

KEEP_DAYS = 30.0  # of versions that `version` can still ask for
SHORTEST_KEEP_HOURS = 1.0  # a writer that takes longer between points and row would lose its points
CACHE_BYTES = 20 << 30


@dataclass(frozen=True)
class Removed:
    """What maintenance removed."""

    orphan_commits: dict[str, int]  # of steps, of writers that were stopped, by table
    surfaces_removed: int  # that no plan names
    files_removed: dict[str, int]  # by table
    drafts_removed: int
    cache_bytes_freed: int


def compact(catalog: Catalog) -> dict[str, int]:
    """Merge small data files, in the order of commits; returns how many files were merged, by table.

    Readers and writers go on meanwhile, and older versions can still be asked for.
    """
    return {name: merge(table, TARGET_BYTES) for name, table in catalog.tables.items()}


def vacuum(catalog: Catalog, keep_days: float = KEEP_DAYS, cache_bytes: int = CACHE_BYTES) -> Removed:
    """Remove what nobody can ask for any more.

    That is: data files that were merged or whose version is older than `keep_days`; points that
    stopped writers left behind, what their plans see, and their unfinished files; and cache entries
    unused for longest beyond `cache_bytes`. Rows are never removed: `as_of` reaches back to the first one.

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
        catalog.cache.prune(cache_bytes),
    )


def _drop_unnamed(
    catalog: Catalog, files: FileStore, columns: Sequence[tuple[str, str]], before: datetime
) -> int:
    """Remove files older than a moment that no row names in these columns of tables; how many."""
    old = files.older(before)
    if not old:
        return 0
    columns_read = (catalog.tables[table].read(None, [name])[name] for table, name in columns)
    named = {sha256 for column in columns_read for sha256 in column.to_pylist()}
    gone = [name for name in old if name.removesuffix(".parquet") not in named]
    for name in gone:
        files.remove(name)
    return len(gone)


def _remove_drafts(root: Path, before: datetime) -> int:
    """Files that stopped writers began and never finished."""
    removed = 0
    for pattern in ("*/*.parquet#*", "*/_delta_log/*.tmp*", "**/.*.draft"):
        for path in root.glob(pattern):
            with suppress(FileNotFoundError):  # finished or removed meanwhile
                if path.stat().st_mtime < before.timestamp():
                    path.unlink()
                    removed += 1
    return removed
