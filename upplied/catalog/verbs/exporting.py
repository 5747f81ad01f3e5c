"""A part of a catalog as a folder that stands for itself (`dataset_files`); `importing` takes it in."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa

from upplied.catalog.database import Catalog
from upplied.catalog.schema import codec
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.contents import NAMED_CONTENTS, States, file_name
from upplied.catalog.verbs.custody import checked_steps
from upplied.catalog.verbs.dataset_files import describe, names_of, new_folder
from upplied.catalog.verbs.published import write
from upplied.catalog.verbs.splits import splits_of
from upplied.errors import CatalogError, InputError
from upplied.files import replace_file

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}-v[1-9][0-9]*")


def export_dataset(
    catalog: Catalog,
    folder: str | os.PathLike[str],
    name: str,
    transfers: pd.DataFrame | Sequence[str],
    licence: str,
    attribution: str = "",
) -> dict[str, int]:
    """Write some plans, with all they refer to, as a folder that stands for itself.

    Parameters
    ----------
    catalog : Catalog
    folder : path
        New, or empty.
    name : str
        With its version, as ``airliners-v1``.
    transfers : DataFrame or sequence of str
        Rows of `Catalog.transfers`, or names of plans.
    licence : str
        Under which the data may be used, as an SPDX name (``CC-BY-4.0``) or in words.
    attribution : str
        Whom to name.

    Returns
    -------
    dict
        Rows written, by table.
    """
    place = new_folder(folder)
    if not _NAME.fullmatch(name):
        raise InputError(f"dataset name {name[:80]!r}", "is not a name with a version", "like airliners-v1")
    if not licence.strip():
        raise InputError(f"dataset {name}", "has no licence", "say one, like CC-BY-4.0")
    names, every = set(names_of(transfers)), catalog.transfers(every=True)
    missing = sorted(names - set(every["transfer_id"]))
    if missing or not names:
        what = f"transfers {', '.join(missing[:5]) or '(none)'}"
        raise CatalogError(what, "are not in the catalog", "at least one that is")
    plans = every[every["transfer_id"].isin(names)]
    demonstrations = _only(catalog.demonstrations(every=True), "demonstration_id", plans["demonstration_id"])
    wanted = {*plans["source_id"], *plans["target_id"], *demonstrations["structure_id"]}
    wanted |= {*plans["parts_told_by"].dropna()} - {""}
    structures = _only(catalog.structures(every=True), "structure_id", wanted)
    tables = {
        "structures": iter([_table("structures", structures)]),
        "demonstrations": iter([_table("demonstrations", demonstrations)]),
        "poses": checked_steps(catalog, "poses", demonstrations),
        "transfers": iter([_table("transfers", plans)]),
        "waypoints": checked_steps(catalog, "waypoints", plans[plans["n_waypoints"] > 0]),
    }
    try:
        counts = {name: write(place / f"{name}.parquet", TABLES[name], rows) for name, rows in tables.items()}
    except OSError as error:
        raise CatalogError(str(place), f"cannot be written: {error}", "", "free space or rights") from None
    rows = {"structures": structures, "transfers": plans}
    for kind, table, column in NAMED_CONTENTS:
        for sha256 in sorted({*rows[table][column]} - {""}) if table in rows else ():
            _put(catalog, place, kind, sha256)
    splits = splits_of(catalog, plans.to_dict("records"))
    replace_file(place / "splits.json", json.dumps(splits, indent=1))
    describe(place, {"name": name, "licence": licence, "attribution": attribution, "rows": counts})
    return counts


def _put(catalog: Catalog, place: Path, kind: str, sha256: str) -> None:
    """Write what is kept by its content, and the samples that it names."""
    path = place / kind / file_name(sha256)
    if not path.exists():
        record = catalog.contents[kind].get(sha256)
        replace_file(path, codec.encode(record))
        if isinstance(record, States):
            _put(catalog, place, "samples", record.samples_sha256)


def _only(frame: pd.DataFrame, column: str, names: Any) -> pd.DataFrame:
    """The newest version of each, retired or not."""
    return frame[frame[column].isin(set(names))].drop_duplicates(column, keep="last")


def _table(name: str, frame: pd.DataFrame) -> pa.Table:
    return pa.Table.from_pandas(frame, TABLES[name].schema, preserve_index=False)
