"""The steps that rows own, many owners at once and a bounded number of steps at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.steps import checked, run_starts, unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.files import explained

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

CHUNK = 1_000_000  # steps held in memory at once
COMPARED = 250_000  # steps that are compared at a time


def checked_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """The steps that the given rows own, in order, a bounded number at a time, `checked`."""
    owners = owners.sort_values([TABLES[name].names[0], "commit_id"])
    for chunk, steps in _chunks(catalog, name, owners, CHUNK):
        yield checked(name, steps, stated(name, chunk))


def step_faults(catalog: Reading, name: str, rows: pa.Table) -> Iterator[tuple[str, str]]:
    """Steps that are missing, too many, out of order, or not those whose hash the row keeps, and whose."""
    key, count = TABLES[name].names[0], f"n_{name}"
    # As texts: a dictionary's would be sorted as they stand in it.
    types = {key: pa.string(), "commit_id": pa.string(), count: pa.int64(), f"{name}_sha256": pa.string()}
    owning = rows.filter(pc.greater(rows[count], 0)).select(list(types)).cast(pa.schema(types))
    owners = as_frame(owning).drop_duplicates([key, "commit_id"])
    owners = owners.sort_values(["commit_id", key])  # each commit is a file, which is then read once
    for chunk, steps in _chunks(catalog, name, owners, COMPARED):
        yield from unlike(name, steps, stated(name, chunk))


def _chunks(
    catalog: Reading, name: str, owners: pd.DataFrame, most: int
) -> Iterator[tuple[pd.DataFrame, pa.Table]]:
    """Some of the given rows at a time, with what is stored of their steps."""
    for _, chunk in owners.groupby(owners[f"n_{name}"].cumsum() // most, sort=True):
        yield chunk, stored_steps(catalog, name, chunk)


def stored_steps(catalog: Reading, name: str, owners: pd.DataFrame) -> pa.Table:
    """What is stored of the steps of the given rows, in their order: all of it or not."""
    key = TABLES[name].names[0]
    if not len(owners):
        return TABLES[name].schema.empty_table()
    table, commits, where = catalog.tables[name], owners["commit_id"].unique(), None
    dataset = table.dataset(commits=commits)
    there = 0 if dataset is None else explained(table.uri, dataset.count_rows)
    if 2 * owners[f"n_{name}"].sum() < there:  # else most are wanted
        ids = pa.array(list(owners[key]), pa.string())
        ends = pc.min_max(ids).as_py()
        where = (pc.field(key) >= ends["min"]) & (pc.field(key) <= ends["max"]) & pc.field(key).isin(ids)
    stored = pa.concat_tables(table.batches(TABLES[name].names, where, commits=commits))
    starts = run_starts(stored, (key, "commit_id"))
    place = pc.index_in(named(stored.take(pa.array(starts)), key), named(owners, key)).fill_null(-1)
    place = np.repeat(place.to_numpy(), np.diff(starts, append=len(stored)))
    order = np.lexsort((stored["seq"].to_numpy(), place))[np.count_nonzero(place < 0) :]
    return stored if np.array_equal(order, np.arange(len(stored))) else stored.take(pa.array(order))


def named(rows: pa.Table | pd.DataFrame, key: str) -> pa.Array:
    """What tells the owner of each step, or each owner: its id and commit."""
    names = [key, "commit_id"]
    table = rows if isinstance(rows, pa.Table) else pa.Table.from_pandas(rows[names], preserve_index=False)
    texts = (table[name].cast(pa.string()).combine_chunks() for name in names)
    return pc.binary_join_element_wise(*texts, "/")


def in_order(name: str, steps: pa.Table) -> pa.Table:
    """Steps by owner, commit and sequence."""
    return steps.sort_by([(column, "ascending") for column in (TABLES[name].names[0], "commit_id", "seq")])


def stated(name: str, owners: pd.DataFrame) -> dict[tuple[str, str], tuple[int, str]]:
    """What rows say of the steps they own: how many, and their hash."""
    names = zip(owners[TABLES[name].names[0]], owners["commit_id"], strict=True)
    return dict(zip(names, zip(owners[f"n_{name}"], owners[f"{name}_sha256"], strict=True), strict=True))


def as_frame(rows: pa.Table) -> pd.DataFrame:
    """Rows whose texts stay Arrow's: as Python's, each takes a hundred bytes more."""
    return rows.to_pandas(types_mapper={pa.string(): pd.ArrowDtype(pa.string())}.get)
