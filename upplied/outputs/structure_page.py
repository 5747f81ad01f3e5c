"""The page of a structure: facts, required zones, plans, flights, findings and history."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.inputs.rules import from_json
from upplied.outputs.pairs import Pair, coverage, decision_words, number, shown_status, stamp
from upplied.records import Structure

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
        "plans": [_plan(pair, preset, row) for pair in pairs for preset, row in _plans(pair)],
        "flights": [
            {
                "when": stamp(row.get("flown_at")),
                "operator": str(row.get("operator") or ""),
                "plan": str(row["transfer_id"]),
                "share": number(row, "flown_pct"),
                "clearance": number(row, "min_clearance_m"),
                "findings": str(row.get("findings") or ""),
            }
            for row in _rows(catalog.flights(kind="flown"), name)
        ],
        "history": _history(catalog, name),
    }


def marks(catalog: Catalog, structure_id: str) -> list[dict[str, Any]]:
    """The findings of a structure in their current state, the newest first."""
    return [mark(row) for row in _rows(catalog.findings(), structure_id)]


def mark(row: dict[str, Any]) -> dict[str, Any]:
    """A finding as pages show it."""
    place = [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]
    return {
        "finding": str(row["finding_id"]),
        "class": str(row["class"] or ""),
        "severity": str(row["severity"] or ""),
        "state": str(row["state"]),
        "place": ", ".join(f"{round(value, 2) + 0.0:.2f}" for value in place),  # no -0.00
        "xyz": place,
        "error": number(row, "place_error_m"),
        "length": number(row, "length_mm"),
        "photo": str(row["photo"] or ""),
        "by": f"{row['by']}, {stamp(row['added_at'])}",
    }


def _plans(pair: Pair) -> list[tuple[str, Any]]:
    drafts = [] if pair.draft is None else [("newer draft", pair.draft)]
    return [(str(pair.main["preset"]), pair.main), *drafts]


def _plan(pair: Pair, preset: str, row: Any) -> dict[str, Any]:
    return {
        "pair": pair.name,
        "demonstration": pair.demonstration_id,
        "preset": preset,
        "status": shown_status(row),
        "state": decision_words(row),
        "coverage": coverage(row),
        "gsd": number(row, "gsd_mm_p50"),
        "clearance": number(row, "min_clearance_m"),
        "duration": number(row, "duration_s"),
        "planned": stamp(row.get("planned_at")),
    }


def _rows(frame: pd.DataFrame, structure_id: str) -> list[dict[str, Any]]:
    """Rows of a table about a structure, the newest first."""
    own = frame[frame["target_id"] == structure_id].iloc[::-1].head(_MOST)
    return [{str(key): value for key, value in row.items()} for row in own.to_dict("records")]


def _history(catalog: Catalog, structure_id: str) -> list[dict[str, str]]:
    """Decisions about the plans of a structure, the newest first."""
    return [
        {
            "when": stamp(row.get("added_at")),
            "what": f"Plan {row['transfer_id']} {row['state']} by {row['by']}",
            "note": str(row.get("note") or ""),
        }
        for row in _rows(catalog.decisions(), structure_id)
    ]
