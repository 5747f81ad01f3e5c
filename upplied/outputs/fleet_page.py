"""The data of the fleet's page: a row for each demonstration and target, in order of attention."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from upplied.outputs.pairs import (
    COVERAGES,
    Pair,
    attainable,
    battery_pct,
    change,
    coverage,
    number,
    reason_of,
    shown_status,
    stamp,
    warnings_of,
)


def fleet_data(
    pairs: list[Pair],
    title: str,
    without_page: Collection[str] = (),
    known: int | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """What the fleet page needs: columns by name, and rows in order of attention.

    `without_page` names the pairs whose own page could not be made, so that nothing links there; `known` is
    how many pairs there are, where these are the first of more; `more` holds, by structure, its place and
    when it was last flown.
    """
    structures = more or {}
    rows = [_fleet_row(pair) | {"page": pair.name not in without_page} for pair in pairs]
    for row in rows:
        row["flown"] = structures.get(row["target"], {}).get("flown")
    columns = list(rows[0]) if rows else []
    return {
        "title": title,
        "columns": columns,
        "rows": [list(row.values()) for row in rows],
        "known": len(pairs) if known is None else known,
        "structures": {row["target"]: structures.get(row["target"], {}) for row in rows},
    }


def _fleet_row(pair: Pair) -> dict[str, Any]:
    row = pair.main
    name = next((name for name in COVERAGES if number(row, name) is not None), COVERAGES[-1])
    values = {
        "coverage": coverage(row),
        "attainable": attainable(row),
        "gsd": number(row, "gsd_mm_p50"),
        "clearance": number(row, "min_clearance_m"),
        "length": number(row, "path_length_m"),
        "duration": number(row, "duration_s"),
        "battery_pct": battery_pct(row),
        "paper": number(pair.plans.get("paper", {}), name),
        "baseline": number(pair.plans.get("baseline", {}), name),
        "frechet": number(row, "frechet_z"),
    }
    return {
        "pair": pair.name,
        "status": shown_status(row),
        "demonstration": pair.demonstration_id,
        "source": pair.source_id,
        "target": pair.target_id,
        "kind": pair.kind,
        "state": str(row.get("state") or ""),
        **{key: None if value is None else round(value, 3) for key, value in values.items()},
        "change": change(pair),
        "planned": stamp(row.get("planned_at")),
        "reason": reason_of(row),
        "warnings": warnings_of(row),
    }
