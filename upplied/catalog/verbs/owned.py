"""The steps that rows own, many owners at once and a bounded number of steps at a time."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.ipc

from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.errors import CatalogError
from upplied.records import Ints

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

CHUNK = 1_000_000  # steps held in memory at once
GATHERED = 250_000  # steps that are parted or compared at a time


def checked_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """As `owned_steps`, each trajectory compared with the hash in its row; one that differs is an error."""
    for steps in owned_steps(catalog, name, owners):
        _check(name, steps, owners)
        yield steps


def owned_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """The steps that the given rows own, ordered by owner and sequence, a bounded number at a time."""
    id_name, count_name = TABLES[name].names[0], f"n_{name}"
    for chunk, owned in stored_steps(catalog, name, owners):
        if len(owned) != chunk[count_name].sum():
            first, last = chunk[id_name].iloc[0], chunk[id_name].iloc[-1]
            raise _missing(name, first, last, len(owned), chunk[count_name].sum())
        yield owned


def stored_steps(
    catalog: Reading, name: str, owners: pd.DataFrame, most: int = CHUNK
) -> Iterator[tuple[pd.DataFrame, pa.Table]]:
    """Some of the given rows at a time, with what is stored of their steps, in order: all of it or not."""
    id_name, count_name = TABLES[name].names[0], f"n_{name}"
    owners = owners.sort_values([id_name, "commit_id"])
    chunk_of = owners[count_name].cumsum() // most
    for _, chunk in owners.groupby(chunk_of, sort=True):
        first, last = chunk[id_name].iloc[0], chunk[id_name].iloc[-1]
        ids = list(chunk[id_name])
        within = (pc.field(id_name) >= first) & (pc.field(id_name) <= last) & pc.field(id_name).isin(ids)
        commits = chunk["commit_id"].unique()
        stored = pa.concat_tables(catalog.tables[name].batches(TABLES[name].names, within, commits=commits))
        wanted = pa.table({id_name: ids, "commit_id": list(chunk["commit_id"])})
        owned = stored.join(wanted, [id_name, "commit_id"], join_type="left semi")
        yield chunk, owned.sort_by([(column, "ascending") for column in (id_name, "commit_id", "seq")])


def step_faults(catalog: Reading, name: str, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Steps that are missing, too many, out of order, or not those whose hash the row keeps, and whose."""
    key, count = TABLES[name].names[0], f"n_{name}"
    owning = rows.filter(pc.greater(rows[count], 0)).select([key, "commit_id", count, f"{name}_sha256"])
    # As texts: a dictionary's would be sorted as they stand in it.
    texts = pa.schema([TABLES[name].schema.field(column) for column in (key, "commit_id")])
    texts = pa.schema([*texts, (count, pa.int64()), (f"{name}_sha256", pa.string())])
    owners = as_frame(owning.cast(texts)).drop_duplicates([key, "commit_id"])
    for chunk, steps in stored_steps(catalog, name, owners, GATHERED):
        grouped = steps.group_by([key, "commit_id"]).aggregate([([], "count_all")])
        counts = {(row[key], row["commit_id"]): row["count_all"] for row in grouped.to_pylist()}
        rows = list(chunk[[key, "commit_id", count, f"{name}_sha256"]].itertuples(index=False, name=None))
        miscounted = set()
        for row_id, commit, said, _ in rows:
            if (there := counts.get((row_id, commit), 0)) != said:
                miscounted.add(row_id)
                yield row_id, f"{there} steps, the row says {said}"
        hashes = {(row_id, commit): sha256 for row_id, commit, _, sha256 in rows}
        for row_id, wrong in unlike(name, steps, hashes):
            if row_id not in miscounted:
                yield row_id, wrong


def as_frame(rows: pa.Table) -> pd.DataFrame:
    """Rows whose texts stay Arrow's: as Python's, each takes a hundred bytes more."""
    return rows.to_pandas(types_mapper={pa.string(): pd.ArrowDtype(pa.string())}.get)


def parted_steps(
    catalog: Reading, name: str, parts: Mapping[str, pd.DataFrame], spool: Path
) -> Iterator[tuple[str, pa.Table]]:
    """The stored steps of the owners of each part, in no order, part by part.

    They are read once, however many the parts are: each row goes to a file of its part.

    Parameters
    ----------
    catalog : Catalog
    name : {"waypoints", "poses"}
    parts : mapping
        The rows that own steps, by the name of the part.
    spool : path
        A folder for the files, which must not exist; it is removed.
    """
    key = TABLES[name].names[0]
    if not parts:
        return
    owners = pd.concat(list(parts.values()))
    number = np.repeat(np.arange(len(parts)), [len(part) for part in parts.values()])
    few = owners[f"n_{name}"].sum() <= CHUNK
    where = pc.field(key).isin(pa.array(owners[key].tolist(), pa.string())) if few else None
    spool.mkdir(parents=True)
    try:
        with ExitStack() as files:
            sinks: dict[int, pa.ipc.RecordBatchStreamWriter] = {}
            wanted = named(owners, key)
            commits = owners["commit_id"].unique()
            stored = catalog.tables[name].batches(TABLES[name].names, where, commits=commits)
            for rows in _gathered(stored):
                at = place(named(rows, key), wanted)
                rows = rows.filter(pa.array(at >= 0))
                of = number[at[at >= 0]]
                order = np.argsort(of, kind="stable")
                ends = np.flatnonzero(np.diff(of[order], append=-1)) + 1
                rows = rows.take(pa.array(order))
                for first, end in zip([0, *ends], ends, strict=False):
                    part = int(of[order[first]])
                    if part not in sinks:
                        sink = files.enter_context(pa.OSFile(str(spool / str(part)), "wb"))
                        sinks[part] = files.enter_context(pa.ipc.new_stream(sink, rows.schema))
                    sinks[part].write_table(rows.slice(first, end - first))
        for part, path in enumerate(parts):
            yield path, _spooled(name, spool / str(part))
    finally:
        shutil.rmtree(spool, ignore_errors=True)


def _spooled(name: str, file: Path) -> pa.Table:
    """What was gathered for one part."""
    if not file.exists():
        return TABLES[name].schema.empty_table()
    with pa.OSFile(str(file), "rb") as source, pa.ipc.open_stream(source) as stream:
        steps = stream.read_all()
    file.unlink()
    return steps


def in_order(name: str, owners: pd.DataFrame, steps: pa.Table) -> pa.Table:
    """The steps of some owners, ordered by owner and sequence, and compared with their hashes."""
    key = TABLES[name].names[0]
    if len(steps) != owners[f"n_{name}"].sum():
        first, last = owners[key].min(), owners[key].max()
        raise _missing(name, first, last, len(steps), owners[f"n_{name}"].sum())
    steps = steps.sort_by([(column, "ascending") for column in (key, "commit_id", "seq")])
    _check(name, steps, owners)
    return steps


def place(names: pa.Array, wanted: pa.Array) -> Ints:
    """Where each name stands among the wanted ones, -1 where it does not.

    Looked up by the few names of these steps, so that no table of all that are wanted is made for each lot.
    """
    encoded = names.dictionary_encode()
    there = pc.index_in(wanted, encoded.dictionary).to_numpy(zero_copy_only=False)
    held = np.flatnonzero(~np.isnan(there))
    place = np.full(len(encoded.dictionary), -1)
    place[there[held].astype(int)] = held
    return np.asarray(place[encoded.indices.to_numpy()], np.int64)


def named(rows: pa.Table | pd.DataFrame, key: str) -> pa.Array:
    """What tells the owner of each step, or each owner."""
    ids, commits = (
        rows[name].combine_chunks()
        if isinstance(rows, pa.Table)
        else pa.array(rows[name].tolist(), pa.string())
        for name in (key, "commit_id")
    )
    return pc.binary_join_element_wise(ids, commits, "/")


def _gathered(batches: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Many rows at a time, of tables with few."""
    waiting: list[pa.Table] = []
    for rows in batches:
        waiting.append(rows)
        if sum(map(len, waiting)) >= GATHERED:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def _check(name: str, steps: pa.Table, owners: pd.DataFrame) -> None:
    """Compare trajectories with the hashes in their rows; one that differs is an error."""
    key = TABLES[name].names[0]
    hashes = dict(
        zip(zip(owners[key], owners["commit_id"], strict=True), owners[f"{name}_sha256"], strict=True)
    )
    for row_id, wrong in unlike(name, steps, hashes):
        remedy = "take the damaged files from a backup; nothing was written"
        raise CatalogError(f"{name} of {row_id}", wrong, "", remedy)


def _missing(name: str, first: str, last: str, found: int, said: int) -> CatalogError:
    what = f"{found} steps are stored, their rows say {said}"
    return CatalogError(f"{name} of {first} to {last}", what, "", "run: upplied catalog verify")
