"""The data of the pages of a fleet, of a structure and of a demonstration."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.inputs.rules import from_json
from upplied.outputs import pairs as of_pairs
from upplied.outputs.labels import LABELS
from upplied.outputs.pages import image_address
from upplied.outputs.pairs import COVERAGES, Pair, coverage, decision_words, number, shown_status, stamp
from upplied.outputs.verdicts import all_warnings
from upplied.records import Demonstration, Structure

_MOST = 200  # flights and decisions on a page; the tables contain all


def structure_facts(
    catalog: Catalog, structure: Structure, pairs: Sequence[Pair], zones: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """The content of the page; tables are lists of rows, the newest first."""
    name, place, triangles = structure.structure_id, structure.placement, len(structure.triangles)
    size = " × ".join(f"{side:.1f}" for side in np.ptp(structure.vertices, axis=0))
    facts = {
        "Kind": structure.kind.replace("_", " "),
        "Size": f"{size} m",
        "Model": f"{triangles:,} triangles" if triangles else "point cloud",
        "Landmarks": ", ".join(sorted(structure.landmarks)),
        "Latitude, longitude": "" if place is None else f"{place.lat_deg:.5f}, {place.lon_deg:.5f}",
        "Heading of +X": "" if place is None else f"{place.heading_deg:.0f}° from true north",
    }
    return {
        "id": name,
        "facts": list(facts.items()),
        "findings": [str(finding) for finding in from_json(structure.verdicts_json)],
        "zones": list(zones),
        "marks": marks(catalog, name),
        "plans": [
            _plan(pair, preset, row)
            for pair in pairs
            for preset, row in ((str(pair.main["preset"]), pair.main), ("newer draft", pair.draft))
            if row is not None
        ],
        "flights": [_flight(row) for row in _rows(catalog.flights(kind="flown"), name)],
        "history": [_decision(row) for row in _rows(catalog.decisions(), name)],  # about its plans
    }


def _flight(row: Any) -> dict[str, Any]:
    flown = {"when": stamp(row.get("flown_at")), "operator": str(row.get("operator") or "")}
    figures = {"share": number(row, "flown_pct"), "clearance": number(row, "min_clearance_m")}
    return {**flown, "plan": str(row["transfer_id"]), **figures, "findings": str(row.get("findings") or "")}


def _decision(row: Any) -> dict[str, str]:
    what = f"Plan {row['transfer_id']} {row['state']} by {row['by']}"
    return {"when": stamp(row.get("added_at")), "what": what, "note": str(row.get("note") or "")}


def marks(catalog: Catalog, structure_id: str) -> list[dict[str, Any]]:
    """The findings of a structure in their current state, the newest first."""
    return [mark(row) for row in _rows(catalog.findings(), structure_id)]


def mark(row: dict[str, Any]) -> dict[str, Any]:
    """A finding as pages show it."""
    place = [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]
    words = ", ".join(f"{round(value, 2) + 0.0:.2f}" for value in place)  # no -0.00
    shown: dict[str, Any] = {"finding": str(row["finding_id"])}
    shown |= {name: str(row[name] or "") for name in ("class", "severity")}
    shown |= {"state": str(row["state"]), "place": words, "xyz": place, "error": number(row, "place_error_m")}
    shown |= {"length": number(row, "length_mm"), "photo": str(row["photo"] or "")}
    return shown | {"by": f"{row['by']}, {stamp(row['added_at'])}"}


def _plan(pair: Pair, preset: str, row: Any) -> dict[str, Any]:
    plan: dict[str, Any] = {"pair": pair.name, "demonstration": pair.demonstration_id, "preset": preset}
    plan |= {"status": shown_status(row), "state": decision_words(row), "coverage": coverage(row)}
    plan |= {"gsd": number(row, "gsd_mm_p50"), "clearance": number(row, "min_clearance_m")}
    return plan | {"duration": number(row, "duration_s"), "planned": stamp(row.get("planned_at"))}


def _rows(frame: pd.DataFrame, structure_id: str) -> list[dict[str, Any]]:
    """Rows of a table about a structure, the newest first."""
    own = frame[frame["target_id"] == structure_id].iloc[::-1].head(_MOST)
    rows: list[dict[str, Any]] = own.to_dict("records")
    return rows


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
    ids = {"id": demonstration.demonstration_id, "structure": demonstration.structure_id}
    own = {"operator": demonstration.operator, "poses": len(demonstration), "notes": demonstration.notes}
    shown = {"picture": image_address(picture), "verdict": passport["verdict"] if passport else ""}
    keys, rows = ("rule", "found", "remedy"), passport["findings"] if passport else ()
    findings = [{key: str(one[key]) for key in keys} | {"overruled": bool(one["overruled"])} for one in rows]
    figures = [[name, value] for name, value in (rows_of(passport) if passport else ()) if value]
    return {**ids, **own, **shown, "findings": findings, "figures": figures}


def fleet_data(
    pairs: list[Pair], title: str, without_page: Collection[str], known: int, more: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """The columns of the page by name, and the rows in order of attention.

    No link leads to pairs `without_page`; `known` is the number of all pairs, of which these are the first;
    `more` has the place and the last flight of each structure.
    """
    rows = [_fleet_row(pair) | {"page": pair.name not in without_page} for pair in pairs]
    for row in rows:
        row["flown"] = more.get(row["target"], {}).get("flown")
    values = [list(row.values()) for row in rows]
    data = {"title": title, "columns": list(rows[0]) if rows else [], "rows": values, "known": known}
    return data | {"structures": {row["target"]: more.get(row["target"], {}) for row in rows}}


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
    values = {"coverage": coverage(row), "attainable": of_pairs.attainable(row)}
    values |= {"gsd": number(row, "gsd_mm_p50"), "clearance": number(row, "min_clearance_m")}
    values |= {"length": number(row, "path_length_m"), "duration": number(row, "duration_s")}
    values |= {"battery_pct": of_pairs.battery_pct(row)}
    values |= {preset: number(pair.plans.get(preset, {}), name) for preset in ("paper", "baseline")}
    values |= {"frechet": number(row, "frechet_z")}
    own = {"pair": pair.name, "status": shown_status(row), "demonstration": pair.demonstration_id}
    own |= {"source": pair.source_id, "target": pair.target_id, "kind": pair.kind}
    figures = {key: None if value is None else round(value, 3) for key, value in values.items()}
    last = {"change": of_pairs.change(pair), "planned": stamp(row.get("planned_at"))}
    last |= {"reason": of_pairs.reason_of(row)}
    return {**own, "state": str(row.get("state") or ""), **figures, **last, "warnings": all_warnings(row)}
