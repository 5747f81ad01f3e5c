"""The plain Parquet that a run publishes: one file per table, current rows only, for any program.

``pd.read_parquet("transfers.parquet")`` is right: a file is replaced in one step, and all five are
replaced together once every one is written. (Pandas opens a path twice; who reads while a run may be
publishing opens the file himself.) Each carries the unit and meaning of its columns, and the schema
version and generation (the newest commit) in its metadata.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from upplied.catalog.schema.columns import Table
from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES
from upplied.errors import CatalogError

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

_ROW_GROUP = 65_536
_CHUNK = 4_000_000  # steps held in memory at once


def export_tables(catalog: Catalog, folder: str | os.PathLike[str]) -> dict[str, int]:
    """Write the current rows of every table as ``<table>.parquet``, replacing what was there.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        Made where it does not exist.

    Returns
    -------
    dict
        Rows written, by table.

    Notes
    -----
    Transfers are the newest plan of each demonstration, target and preset; older plans stay in the
    catalog. Waypoints and poses are those of the published rows. The rows that name steps are read
    before the steps, so no trajectory is published without its points.
    """
    transfers, demonstrations = catalog.transfers(), catalog.demonstrations()
    frames = {
        "transfers": transfers,
        "demonstrations": demonstrations,
        "structures": catalog.structures(),
        "flights": catalog.flights(),
    }
    generation = max([str(frame["commit_id"].max()) for frame in frames.values() if len(frame)], default="")
    parts: dict[str, Iterator[pa.Table]] = {
        "waypoints": checked_steps(catalog, "waypoints", transfers[transfers["n_waypoints"] > 0]),
        "poses": checked_steps(catalog, "poses", demonstrations),
    }
    for name, frame in frames.items():
        parts[name] = iter([pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)])
    return write_tables(Path(folder), parts, generation)


def write_tables(folder: Path, parts: dict[str, Iterator[pa.Table]], generation: str) -> dict[str, int]:
    """Write tables as Parquet files, all of them before the first replaces what was there."""
    counts: dict[str, int] = {}
    drafts: dict[str, Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, tables in parts.items():
            drafts[name] = folder / f".{name}.{uuid.uuid4().hex[:8]}.draft"
            counts[name] = _write(drafts[name], TABLES[name], tables, generation)
        for name, draft in drafts.items():
            os.replace(draft, folder / f"{name}.parquet")
    except OSError as error:
        raise CatalogError(
            str(folder), f"cannot be written: {error}", "", "free space or rights; what was there still is"
        ) from None
    finally:
        for draft in drafts.values():
            draft.unlink(missing_ok=True)
    return counts


def _write(path: Path, declared: Table, tables: Iterator[pa.Table], generation: str) -> int:
    metadata = {
        "schema_version": str(SCHEMA_VERSION),
        "generation": generation,
        "table": declared.name,
        "meaning": declared.meaning,
    }
    schema = declared.schema.with_metadata(metadata)
    count = 0
    with path.open("wb") as file:
        with pq.ParquetWriter(file, schema, compression="zstd") as writer:
            for table in tables:
                writer.write_table(table.cast(schema), row_group_size=_ROW_GROUP)
                count += len(table)
        file.flush()
        os.fsync(file.fileno())
    return count


def checked_steps(catalog: Catalog, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """The same, each trajectory compared with the hash in its row; one that differs is an error."""
    key = TABLES[name].names[0]
    hashes = dict(
        zip(zip(owners[key], owners["commit_id"], strict=True), owners[f"{name}_sha256"], strict=True)
    )
    for steps in owned_steps(catalog, name, owners):
        for row_id, wrong in unlike(name, steps, hashes):
            remedy = "take the damaged files from a backup; nothing was written"
            raise CatalogError(f"{name} of {row_id}", wrong, "", remedy)
        yield steps


def owned_steps(catalog: Catalog, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """The steps that the given rows own, ordered by owner and sequence, a bounded number at a time."""
    id_name, count_name = TABLES[name].names[0], f"n_{name}"
    owners = owners.sort_values([id_name, "commit_id"])
    chunk_of = owners[count_name].cumsum() // _CHUNK
    for _, chunk in owners.groupby(chunk_of, sort=True):
        first, last = chunk[id_name].iloc[0], chunk[id_name].iloc[-1]
        ids = list(chunk[id_name])
        within = (pc.field(id_name) >= first) & (pc.field(id_name) <= last) & pc.field(id_name).isin(ids)
        stored = catalog.tables[name].read(within)
        wanted = pa.table({id_name: ids, "commit_id": list(chunk["commit_id"])})
        owned = stored.join(wanted, [id_name, "commit_id"], join_type="left semi")
        owned = owned.sort_by([(column, "ascending") for column in (id_name, "commit_id", "seq")])
        if len(owned) != chunk[count_name].sum():
            raise CatalogError(
                f"{name} of {first} to {last}",
                f"{len(owned)} steps are stored, their rows say {chunk[count_name].sum()}",
                "",
                "run: upplied catalog verify",
            )
        yield owned
