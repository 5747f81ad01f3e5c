"""The page of a demonstration: its passport in words, with a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.outputs.labels import LABELS
from upplied.outputs.pages import image_address
from upplied.records import Demonstration


def rows_of(passport: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The figures of a passport with their names, as text."""
    measured = passport["measured"]
    return [(words, short(measured.get(name))) for name, words in LABELS["import_checks"].items()]


def short(value: Any) -> str:
    """A value as a person reads it."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return "; ".join(short(item) for item in value)
    return "" if value is None else str(value)


def passport_data(demonstration: Demonstration, picture: bytes) -> dict[str, Any]:
    """The content of a demonstration's page, with a picture (PNG) of the flight round its structure."""
    passport: Any = demonstration.passport
    return {
        "id": demonstration.demonstration_id,
        "structure": demonstration.structure_id,
        "operator": demonstration.operator,
        "poses": len(demonstration),
        "notes": demonstration.notes,
        "picture": image_address(picture),
        "verdict": passport["verdict"] if passport else "",
        "findings": [
            {name: str(item[name]) for name in ("rule", "found", "remedy")}
            | {"overruled": bool(item["overruled"])}
            for item in (passport["findings"] if passport else ())
        ],
        "figures": [[words, value] for words, value in (rows_of(passport) if passport else ()) if value],
    }
