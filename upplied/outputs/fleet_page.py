"""The page of the fleet: a row for each pair, findings by kind and class, and the places of structures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any

from upplied.catalog import Catalog
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
)
from upplied.outputs.verdicts import all_warnings


def fleet_data(
    pairs: list[Pair],
    title: str,
    without_page: Collection[str] = (),
    known: int | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """The columns of the page by name, and the rows in order of attention.

    `without_page` names the pairs whose own page failed: no link leads there. `known` is the number of all
    pairs if these are only the first. `more` has the place and the last flight of each structure.
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


def fleet_findings(catalog: Catalog, mapped: Collection[str] = ()) -> list[dict[str, Any]]:
    """How many findings of each kind and class are in each state; whether there is a map of the kind."""
    rows = catalog.findings()
    count = Counter(zip(rows["kind"], rows["class"], rows["state"], strict=True))
    classes: dict[tuple[str, str], dict[str, Any]] = {}
    for (kind, name, state), number_of in sorted(count.items()):
        row = classes.setdefault((kind, name), {"kind": kind, "class": name, "map": kind in mapped})
        row[state] = number_of
    return list(classes.values())


def places(catalog: Catalog) -> dict[str, dict[str, Any]]:
    """The place and the last flight of each structure, by ID, if known."""
    known: dict[str, dict[str, Any]] = {}
    for row in catalog.structures().to_dict("records"):
        lat, lon = number(row, "lat_deg"), number(row, "lon_deg")
        if lat is not None and lon is not None:
            known[str(row["structure_id"])] = {"lat": lat, "lon": lon}
    for target, when in catalog.flights(kind="flown").groupby("target_id")["flown_at"].max().items():
        known.setdefault(str(target), {})["flown"] = stamp(when)
    return known


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
        "warnings": all_warnings(row),
    }
