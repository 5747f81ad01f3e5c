"""The tables of the catalog, each column declared once in ``columns.csv``: type, unit, constraint, meaning.

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


def _declared() -> dict[str, list[Column]]:
    """The columns of each table, in order."""
    text = files(__package__).joinpath("columns.csv").read_text(encoding="utf-8")
    tables: dict[str, list[Column]] = {}
    last: dict[str, Column] = {}
    for row in csv.DictReader(text.splitlines()):
        name, allowed = row["column"], tuple(row["allowed"].split("|")) if row["allowed"] else ()
        low, high = (float(bound) if bound else None for bound in (row["low"], row["high"]))
        if row["type"]:
            last[name] = Column(
                name,
                TYPES[row["type"]],
                row["unit"],
                row["meaning"],
                row["required"] == "yes",
                allowed,
                low,
                high,
            )
        tables.setdefault(row["table"], []).append(last[name])
    return tables


_COLUMNS = _declared()


def _table(name: str, key: str, order: str, meaning: str) -> tuple[str, Table]:
    return name, Table(name, meaning, tuple(key.split()), tuple(_COLUMNS[name]), tuple(order.split()))


TABLES = dict([
    _table("structures", "structure_id version", "structure_id added_at",
           "one row per structure and version; the newest of an id is current"),
    _table("demonstrations", "demonstration_id version", "demonstration_id added_at",
           "one row per demonstration and version; the newest of an id is current"),
    _table("poses", "demonstration_id commit_id seq", "commit_id demonstration_id seq",
           "one row per step of a demonstration, as flown"),
    _table("transfers", "transfer_id", "transfer_id planned_at",
           "one row per plan, refused and failed ones too; "
           "the newest of a pair, preset and purpose is current"),
    _table("waypoints", "transfer_id commit_id seq", "commit_id transfer_id seq",
           "one row per step of a planned trajectory"),
    _table("flights", "flight_id", "target_id added_at",
           "one row per flight of a plan, flown or in simulation"),
    # What people decide is never changed: which plan is in force follows from the order of commits.
    _table("decisions", "decision_id", "added_at",
           "one row per decision about a plan, by a person or by the check of a changed structure"),
    _table("overruled", "overruled_id commit_id", "transfer_id added_at",
           "one row per rule of the gate that a person overruled when a plan was exported, briefed or flown"),
    _table("settings", "setting_id", "owner added_at",
           "one row per setting of a kind or a structure, and per change of it; the newest counts"),
    _table("requirements", "requirement_id", "owner added_at",
           "one row per set of requirements and version; the newest of a name counts"),
    _table("edits", "edit_id", "target_id added_at",
           "one row per change of a plan, and one for each plan made later that it was carried over to, "
           "or was not"),
])  # fmt: skip

#: The tables of steps, and whose rows own them.
STEPS = {"waypoints": "transfers", "poses": "demonstrations"}
