"""The tables of the catalog, declared once in ``tables.csv`` and ``columns.csv``: key, type, unit, meaning.

The stored tables, the published Parquet, the checks of `verify` and the data dictionary
``catalog/README.md`` all follow from there. `dictionary` writes it. A row without a type is the column of
that name as the last table above has it.

Columns may be added, and older catalogs then read as missing values; how older programs fare, and when the
schema version is raised, is told in `upplied.catalog.schema.migrations`.
"""

from __future__ import annotations

import csv
from importlib.resources import files

from upplied.catalog.schema.columns import TYPES, Column, Table


def _rows(name: str) -> csv.DictReader[str]:
    return csv.DictReader(files(__package__).joinpath(name).read_text(encoding="utf-8").splitlines())


def _columns() -> dict[str, list[Column]]:
    """The columns of each table, in order."""
    tables: dict[str, list[Column]] = {}
    last: dict[str, Column] = {}
    for row in _rows("columns.csv"):
        name, allowed = row["column"], tuple(row["allowed"].split("|")) if row["allowed"] else ()
        low, high = (float(bound) if bound else None for bound in (row["low"], row["high"]))
        if row["type"]:
            required = row["required"] == "yes"
            kind = TYPES[row["type"]]
            last[name] = Column(name, kind, row["unit"], row["meaning"], required, allowed, low, high)
        tables.setdefault(row["table"], []).append(last[name])
    return tables


def _declared() -> dict[str, Table]:
    columns = _columns()
    return {
        (name := row["table"]): Table(
            name, row["meaning"], tuple(row["key"].split()), tuple(columns[name]), tuple(row["order"].split())
        )
        for row in _rows("tables.csv")
    }


TABLES = _declared()
#: The tables of steps, and whose rows own them.
STEPS = {"waypoints": "transfers", "poses": "demonstrations"}
