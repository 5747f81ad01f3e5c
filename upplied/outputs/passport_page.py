"""The page of a demonstration: its passport with a picture, for people; no scripts."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from typing import Any

from upplied.records import Demonstration

#: Figures of a passport in words, in the order of pages and terminals.
FIGURES = {
    "lowest_m": "lowest height, m",
    "min_clearance_m": "least clearance, m",
    "inside_pct": "poses inside the structure, %",
    "near_pct": "poses nearer than 0.5 m, %",
    "axis_pct": "poses with the axis on the structure, %",
    "shown_pct": "pictures that show the structure, %",
    "range_m": "distance along the axis, m",
    "fit_pct": "poses an inspection could hold, %",
    "other": "best other convention",
    "other_fit_pct": "poses it could hold then, %",
    "aim_drift_deg": "camera turning off the nearest surface, deg",
    "aim_off_deg": "camera looking aside of it, deg",
    "motion_fit_pct": "motion of the poses along the velocity in the log, %",
    "motion_ratio": "speed of the poses over that in the log",
    "speed_p99_mps": "speed, m/s",
    "acceleration_p99_mps2": "acceleration, m/s2",
    "turn_p99_degps": "turn rate, deg/s",
    "clock": "clock",
    "clock_steps": "steps of the clock",
    "span_s": "from first to last pose, s",
    "recorded_pct": "time recorded, %",
    "gaps": "gaps",
    "longest_gap_s": "longest gap, s",
    "cut_gap_s": "cut of gaps, s",
    "hover_s": "long hovering, s",
    "cut_hover_s": "cut of it, s",
    "hfov_deg": "fields of view, deg",
    "frame": "frame of the log",
    "child": "body in the log",
    "frames": "how frames became ours",
    "assumed": "assumed",
    "read_pct": "log read, %",
}
_POLICY = "default-src 'none'; script-src 'self'; img-src data:; style-src 'self' 'unsafe-inline'"


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


def passport_page(demonstration: Demonstration, picture: bytes) -> str:
    """The page, with the flight drawn round its structure inside."""
    passport: Any = demonstration.passport
    name = html.escape(demonstration.demonstration_id)
    source = html.escape(demonstration.structure_id)
    if passport:
        refused = passport["verdict"] == "refused"
        found = "".join(_finding(item) for item in passport["findings"])
        said = (
            f'<section class="verdict {"refused" if refused else "ok"}">'
            f"<h2>Taken in: {html.escape(passport['verdict'])}</h2>"
            + (f"<ul>{found}</ul>" if found else "<p>Nothing stands out.</p>")
            + "</section>"
        )
        told = "".join(
            f"<dt>{html.escape(words)}</dt><dd>{html.escape(value)}</dd>"
            for words, value in rows_of(passport)
            if value
        )
        measured = f"<h2>What was measured when it was taken in</h2><dl>{told}</dl>"
    else:
        said, measured = "<p>Taken in without a passport: add its log again to have it judged.</p>", ""
    image = base64.b64encode(picture).decode()
    wide, high = (int.from_bytes(picture[at : at + 4]) for at in (16, 20))  # of a PNG
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="stylesheet" href="../assets/report.css"></head><body><main>'
        f'<a href="../index.html">All transfers</a><h1>{name}</h1><p class="sub">Flown on {source}'
        f"{' by ' + html.escape(demonstration.operator) if demonstration.operator else ''},"
        f" {len(demonstration)} poses. {html.escape(demonstration.notes)}</p>{said}"
        f'<figure role="img" aria-label="{name} round {source}" '
        f'style="max-width:60rem;aspect-ratio:{wide}/{high};'
        f'background:url(data:image/png;base64,{image}) 0/contain no-repeat"></figure>'
        f"{measured}</main></body></html>\n"
    )


def _finding(item: Mapping[str, Any]) -> str:
    overruled = " (overruled)" if item["overruled"] else ""
    return (
        f"<li><strong>{html.escape(item['rule'])}</strong>{overruled}: {html.escape(item['found'])}"
        f" <i>{html.escape(item['remedy'])}</i></li>"
    )
