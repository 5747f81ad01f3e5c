"""The data dictionary ``catalog/README.md``: ``python -m upplied.catalog.schema.dictionary`` writes it."""

from __future__ import annotations

from pathlib import Path

from upplied.catalog.schema.columns import TYPES
from upplied.catalog.schema.migrations import SCHEMA_VERSION
from upplied.catalog.schema.tables import TABLES


def data_dictionary() -> str:
    """The data dictionary as Markdown, for people who open the tables."""
    parts = [_PREFACE.format(version=SCHEMA_VERSION)]
    for table in TABLES.values():
        parts.append(f"## {table.name}\n\n{table.meaning[0].upper()}{table.meaning[1:]}.\n")
        parts.append("| column | type | unit | meaning | constraint |\n|---|---|---|---|---|")
        parts += [
            f"| `{c.name}` | {_TYPES[c.type]} | {c.unit} | {c.meaning} | {c.constraint} |"
            for c in table.columns
        ]
        parts.append("")
    return "\n".join(parts).rstrip() + "\n"


_NAMES = {"text": "text", "real": "float64", "whole": "int64", "truth": "bool", "moment": "time, UTC, us"}
_TYPES = {TYPES[word]: name for word, name in _NAMES.items()}


_PREFACE = """\
# The catalog: data dictionary

Written by `python -m upplied.catalog.schema.dictionary`; schema version {version}.

Metres, seconds and degrees; the structure frame is Z up and +X forward; quaternions are `x y z w` and turn
the camera frame (x forward, y left, z up) into the structure frame. A missing measure is null (NaN in
pandas), a missing text is empty.

The tables here are Delta tables. Read them with `upplied.open_catalog(...)`, or read the plain Parquet
files of the same names and columns that every run publishes into `reports/`. Do not point `pd.read_parquet`
at a folder of the catalog: it would count rows that the table no longer holds. Rows are only ever added: a
newer plan is a new row, and which one is current is a question asked when reading. A row of `transfers` or
`demonstrations` owns the rows of `waypoints` or `poses` that carry its id and its `commit_id`; others
belong to writers that were stopped, and are not part of the catalog.
"""


def write_data_dictionary(path: Path) -> None:
    """Write the data dictionary to a file."""
    path.write_text(data_dictionary(), encoding="utf-8")


if __name__ == "__main__":
    write_data_dictionary(Path(__file__).parents[3] / "catalog" / "README.md")
