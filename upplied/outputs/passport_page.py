"""The page of a demonstration: its passport in words, with a picture."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

from upplied.records import Demonstration

#: Figures of a passport in words, in the order of pages and terminals.
FIGURES = {
    "lowest_m": "lowest height, m",
    "min_clearance_m": "minimum clearance, m",
    "inside_pct": "poses inside the structure, %",
    "near_pct": "poses nearer than 0.5 m, %",
    "axis_pct": "poses whose optical axis hits the structure, %",
    "shown_pct": "pictures that show the structure, %",
    "range_m": "distance along the optical axis, m",
    "fit_pct": "plausible inspection poses, %",
    "other": "best alternative pose convention",
    "other_fit_pct": "plausible poses under that convention, %",
    "aim_drift_deg": "drift of the camera off the nearest surface, deg",
    "aim_off_deg": "offset of the camera from the nearest surface, deg",
    "motion_fit_pct": "motion that agrees with the logged velocity, %",
    "motion_ratio": "speed of the poses over the logged speed",
    "speed_p99_mps": "speed, m/s",
    "acceleration_p99_mps2": "acceleration, m/s2",
    "turn_p99_degps": "turn rate, deg/s",
    "clock": "clock",
    "clock_steps": "clock steps",
    "span_s": "time from first to last pose, s",
    "recorded_pct": "recorded time, %",
    "gaps": "gaps",
    "longest_gap_s": "longest gap, s",
    "cut_gap_s": "time cut from gaps, s",
    "hover_s": "long hovering, s",
    "cut_hover_s": "time cut from hovering, s",
    "hfov_deg": "field of view, deg",
    "frame": "frame of the log",
    "child": "body in the log",
    "frames": "frame conversion",
    "assumed": "assumptions",
    "read_pct": "share of the log that was read, %",
}


def rows_of(passport: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The figures of a passport with their names, as text."""
    measured = passport["measured"]
    return [(words, short(measured.get(name))) for name, words in FIGURES.items()]


def short(value: Any) -> str:
    """A value as a person reads it."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return "; ".join(short(item) for item in value)
    return "" if value is None else str(value)


def passport_data(demonstration: Demonstration, picture: bytes) -> dict[str, Any]:
    """What the page of a demonstration shows, with the flight drawn round its structure (PNG) inside."""
    passport: Any = demonstration.passport
    return {
        "id": demonstration.demonstration_id,
        "structure": demonstration.structure_id,
        "operator": demonstration.operator,
        "poses": len(demonstration),
        "notes": demonstration.notes,
        "picture": f"data:image/png;base64,{base64.b64encode(picture).decode()}",
        "verdict": passport["verdict"] if passport else "",
        "findings": [
            {name: str(item[name]) for name in ("rule", "found", "remedy")}
            | {"overruled": bool(item["overruled"])}
            for item in (passport["findings"] if passport else ())
        ],
        "figures": [[words, value] for words, value in (rows_of(passport) if passport else ()) if value],
    }
