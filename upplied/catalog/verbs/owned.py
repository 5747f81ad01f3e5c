"""The steps that rows own, many owners at once and a bounded number of steps at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.errors import CatalogError

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

CHUNK = 4_000_000  # steps held in memory at once


def checked_steps(catalog: Catalog, name: str, owners: pd.DataFrame) -> Iterator[pa.Table]:
    """As `owned_steps`, each trajectory compared with the hash in its row; one that differs is an error."""
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
    chunk_of = owners[count_name].cumsum() // CHUNK
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
