"""The plain Parquet that a run publishes: current rows only, for any program, one generation at a time.

``tables/`` holds generations and ``current``, a link that is switched in one step; ``transfers.parquet``
and the others lead through it. What did not change is linked from the generation before, which stays for
its readers. (Who reads more than one table asks `published_tables` for the paths of one generation.)
"""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, Table
from upplied.catalog.store.chain import decoded
from upplied.catalog.store.locking import locked
from upplied.catalog.verbs import parted
from upplied.catalog.verbs.generations import Before, Generation, check, clean, current, switch
from upplied.config import digest
from upplied.errors import CatalogError

_ROW_GROUP = 16_384
#: What a publication says depends on these, too: a newer program knows more columns.
_COLUMNS = digest([SCHEMA_VERSION, {name: table.names for name, table in TABLES.items()}])


def export_tables(catalog: Catalog, folder: str | os.PathLike[str], force: bool = False) -> dict[str, int]:
    """Publish the current rows of every table as Parquet: ``transfers.parquet`` and so on.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        Made where it does not exist.
    force : bool
        Also replace a publication that is newer, of another catalog, or would shrink to nothing.

    Returns
    -------
    dict
        Rows published, by table.

    Raises
    ------
    CatalogError
        If the folder cannot be written, holds what must not be replaced, or a trajectory is damaged.
        What was published still is.

    Notes
    -----
    Transfers are the newest plan of each demonstration, target and preset, but the one in force where a
    person released one; the others stay in the catalog. Waypoints and poses are those of the published
    rows. The rows that name steps are read before the steps, so no trajectory is published without its
    points.
    """
    catalog.identity.required()
    place = local_folder(folder)
    with locked(place):
        return publish_generation(catalog, place, force)


def local_folder(folder: str | os.PathLike[str]) -> Path:
    """A folder to publish into; object stores are refused."""
    text = os.fspath(folder)
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", text):
        remedy = "publish into a folder and copy it there, as with: aws s3 sync"
        raise CatalogError(text, "is no folder", "reports are published into a folder", remedy)
    return Path(text)


def published_tables(folder: str | os.PathLike[str]) -> dict[str, Path]:
    """Where the tables of the current generation lie: paths that stay as they are while others publish.

    Raises
    ------
    CatalogError
        If nothing is published there.
    """
    current = Path(folder) / "tables" / "current"
    if not current.exists():
        raise CatalogError(str(folder), "nothing is published there")
    place = current.resolve()
    return {name: path for name in TABLES if (path := place / f"{name}.parquet").exists()}


def publish_generation(catalog: Catalog, place: Path, force: bool) -> dict[str, int]:
    """As `export_tables`, by who holds the lock of the folder."""
    before, now = current(place), Generation(catalog.identity.required(), columns=_COLUMNS)
    tables = place / "tables"
    was = Before(tables, before)
    for name, table in catalog.tables.items():  # before the rows are read: they are at least as new
        now.versions[name], now.added[name] = table.newest()
    if was.is_newest(now):
        return {name: before.rows[name] for name in TABLES if name in before.rows}
    plans, same = parted.plans_of(catalog, was, now)
    frames = {"demonstrations": catalog.demonstrations(), "structures": catalog.structures()}
    now.rows = {name: sum(weights.values()) for name, weights in now.weights.items()}
    if not force:
        check(place, before, now, now.rows["transfers"])
    files = parted.files_of(now, plans, frames)
    draft = tables / f".{uuid.uuid4().hex[:8]}.draft"
    try:
        clean(tables)
        draft.mkdir(parents=True)
        for name in [table for table in TABLES if table not in files]:
            file = f"{name}.parquet"
            if now.has_same(name, before) and was.linked(draft, file):
                now.rows[name] = before.rows[name]
                continue
            asked_by = {"settings": "declared_settings"}.get(name, name)
            frame = frames[name] if name in frames else getattr(catalog, asked_by)()
            rows = pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)
            now.rows[name] = write(draft / file, TABLES[name], iter([rows]))
        for file in same:
            was.linked(draft, file)
        for name, by_file in files.items():
            new = {file: rows for file, rows in sorted(by_file.items()) if not was.linked(draft, file)}
            for file, steps in parted.rows_of(catalog, was, name, new):
                write(draft / file, TABLES[name], iter([steps]))
        now.rows["poses"] = int(frames["demonstrations"]["n_poses"].sum())
        switch(place, draft, now)
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(place), f"cannot be written: {error}", "", remedy) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return {name: now.rows[name] for name in TABLES if name in now.rows}


def write(path: Path, declared: Table, parts: Iterator[pa.Table]) -> int:
    """Write a table as a Parquet file that is on the disk when this returns; its rows."""
    about = {"schema_version": str(SCHEMA_VERSION), "table": declared.name, "meaning": declared.meaning}
    schema = declared.schema.with_metadata(about)
    count = 0
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        with pq.ParquetWriter(file, schema, compression="zstd") as writer:
            for rows in parts:
                for at in range(0, len(rows), _ROW_GROUP):  # decoded so many at a time
                    part = decoded(rows.slice(at, _ROW_GROUP))
                    writer.write_table(part.select(schema.names).cast(schema))
                count += len(rows)
        file.flush()
        os.fsync(file.fileno())
    return count
