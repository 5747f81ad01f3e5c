"""The plain Parquet that a run publishes: current rows only, for any program, one generation at a time.

``tables/`` holds generations and ``current``, a link that is switched in one step; ``transfers.parquet``
and the others lead through it. What did not change is linked from the generation before, which stays for
its readers. (Who reads more than one table asks `published_tables` for the paths of one generation.)
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, Table
from upplied.catalog.store.chain import decoded
from upplied.catalog.store.locking import locked
from upplied.catalog.verbs import parted
from upplied.catalog.verbs.generations import Before, Generation, check, clean, current, switch
from upplied.catalog.verbs.ordering import DERIVED
from upplied.catalog.verbs.queries import NAMED
from upplied.config import digest
from upplied.errors import CatalogError

_ROW_GROUP = 16_384
#: What a publication says depends on these, too: a newer program knows more columns.
_COLUMNS = digest([SCHEMA_VERSION, {name: table.names for name, table in TABLES.items()}])
#: Of a plan: what names its row, what its steps are found by, and what is decided about it.
_OF_PLANS = (*NAMED, "kind", "target_id", "n_waypoints", "waypoints_sha256", *DERIVED)


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
    before = current(place)
    # Asked before the rows are read: what is published is at least as new as it says.
    versions = {name: -1 if (d := t.delta()) is None else d.version() for name, t in catalog.tables.items()}
    transfers, demonstrations = catalog.foremost(_OF_PLANS), catalog.demonstrations()
    structures = catalog.structures()
    others = ("flights", "decisions", "overruled", "requirements", "edits", "flight_photos", "findings")
    whole: dict[str, Callable[[], pd.DataFrame]] = {name: getattr(catalog, name) for name in others}
    whole |= {"demonstrations": lambda: demonstrations, "structures": lambda: structures}
    whole["settings"] = catalog.declared_settings
    now = Generation(catalog.identity.required(), versions, columns=_COLUMNS)
    if before is not None and not force:
        check(place, before, now, len(transfers))
    kinds = dict(zip(structures["structure_id"], structures["kind"], strict=True))
    of_demonstrations = demonstrations.rename(columns={"structure_id": "target_id"})
    of_demonstrations["kind"] = of_demonstrations["target_id"].map(kinds).fillna("unknown")
    planned = transfers[transfers["n_waypoints"] > 0]
    parts = {
        "transfers": parted.plan_files(transfers),
        "waypoints": parted.step_files("waypoints", planned),
        "poses": parted.step_files("poses", of_demonstrations),
    }
    tables = place / "tables"
    draft = tables / f".{uuid.uuid4().hex[:8]}.draft"
    try:
        clean(tables)
        draft.mkdir(parents=True)
        was = Before(tables, before)
        now.rows["transfers"] = len(transfers)
        for name, owners in (("waypoints", planned), ("poses", demonstrations)):
            now.rows[name] = int(owners[f"n_{name}"].sum())
        for name, frame in whole.items():
            if not now.has_same(name, before) or not was.linked(draft, f"{name}.parquet", now):
                _put_frame(was, draft, name, frame(), now)
        for name, files in parts.items():
            new = files.of([file for file in sorted(files.files) if not was.linked(draft, file, now)])
            for file, rows in parted.rows_of(catalog, was, name, new):
                write(draft / file, TABLES[name], iter([rows]))
        if not was.is_as(now, [file for files in parts.values() for file in files.files]):
            switch(place, draft, now)
    except OSError as error:
        remedy = "free space or rights; what was there still is"
        raise CatalogError(str(place), f"cannot be written: {error}", "", remedy) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return {name: now.rows[name] for name in TABLES if name in now.rows}


def _put_frame(was: Before, draft: Path, name: str, frame: pd.DataFrame, now: Generation) -> None:
    """Write a table that is one file, unless it was published just so."""
    file = f"{name}.parquet"
    rows = pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)
    now.rows[name] = len(rows)
    sink = pa.BufferOutputStream()  # the rows as they are encoded
    with pa.ipc.new_stream(sink, rows.schema) as writer:
        writer.write_table(rows.combine_chunks(), max_chunksize=_ROW_GROUP)
    now.parts[file] = digest([SCHEMA_VERSION, hashlib.sha256(sink.getvalue()).hexdigest()])
    if not was.linked(draft, file, now):
        write(draft / file, TABLES[name], iter([rows]))


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
