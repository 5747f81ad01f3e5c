"""The data dictionary ``catalog/README.md``: ``python -m upplied.catalog.schema.dictionary`` writes it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from upplied.catalog.schema.tables import SCHEMA_VERSION, TABLES, TYPES


def data_dictionary() -> str:
    """The data dictionary as Markdown, for people who open the tables."""
    preface = files(__package__).joinpath("dictionary.md").read_text(encoding="utf-8")
    parts = [preface.format(version=SCHEMA_VERSION)]
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


if __name__ == "__main__":
    place = Path(__file__).parents[3] / "catalog" / "README.md"
    place.write_text(data_dictionary(), encoding="utf-8")
