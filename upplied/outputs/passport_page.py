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
_POLICY = "default-src 'none'; script-src 'self'; img-src data:; style-src 'unsafe-inline'"
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem}"
    "figure{margin:1rem 0}table{border-collapse:collapse}td{padding:.15rem .8rem .15rem 0;vertical-align:top}"
    "td+td{font-variant-numeric:tabular-nums}.refused,.allowed{color:#b00020}.warned{color:#8a5a00}"
    "@media(prefers-color-scheme:dark){body{background:#16191d;color:#e4e6e8}.allowed{color:#ff8a80}"
    ".warned{color:#ffca6b}}"
)


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
        findings = "".join(
            f'<li class="{"allowed" if item["overruled"] else "warned"}">'
            f"<strong>{html.escape(item['rule'])}</strong>"
            f"{' (overruled)' if item['overruled'] else ''}: {html.escape(item['found'])}"
            f" <i>{html.escape(item['remedy'])}</i></li>"
            for item in passport["findings"]
        )
        told = "".join(
            f"<tr><td>{html.escape(words)}</td><td>{html.escape(value)}</td></tr>"
            for words, value in rows_of(passport)
        )
        verdict = html.escape(passport["verdict"])
        said = f"<p>Verdict: <strong>{verdict}</strong></p><ul>{findings}</ul><table>{told}</table>"
    else:
        said = "<p>Taken in without a passport: add its log again to have it judged.</p>"
    image = base64.b64encode(picture).decode()
    wide, high = (int.from_bytes(picture[at : at + 4]) for at in (16, 20))  # of a PNG
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{name}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style>'
        f'<p><a href="../index.html">All transfers</a></p><h1>{name}</h1><p>Flown on {source}'
        f"{' by ' + html.escape(demonstration.operator) if demonstration.operator else ''},"
        f" {len(demonstration)} poses. {html.escape(demonstration.notes)}</p>"
        f'<figure role="img" aria-label="{name} round {source}" style="aspect-ratio:{wide}/{high};'
        f'background:url(data:image/png;base64,{image}) 0/contain no-repeat"></figure>{said}</html>\n'
    )
