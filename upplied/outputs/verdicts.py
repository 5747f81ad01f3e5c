"""The verdict of a transfer in the first lines of its page: flyable or not, the reason, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.outputs.pairs import attainable, meaning, number, reason_of, shown_status, warnings_of

_WORTH_A_LOOK_PCT = 1.0  # of the inspected surface: smaller places are not visible in the picture
# The strictest coverage that was computed, in words.
_SHOWN = (
    ("coverage_inspected_pct", "of the inspected surface at the demonstrated quality"),
    ("coverage_seen_pct", "of the demonstrated surface"),
    ("coverage_paper_pct", "of the surface by the camera's frustum alone"),
)


def headline(values: Mapping[str, Any], safety_m: float | None) -> str:
    """The result of a plan, by its measures, in one sentence; `safety_m` is the required distance, m."""
    known = [(number(values, name), words) for name, words in _SHOWN]
    parts = [f"shows {shown:.1f} % {words}" for shown, words in known if shown is not None][:1]
    if parts and known[0][0] is not None and values.get("standoff_mode") == "scaled":
        parts[0] += ", relative to the structure's size"
    if parts and (fine := resolution(values)):
        parts[0] += f", at {fine}"
    if (clearance := number(values, "min_clearance_m")) is not None:
        limit = f" (limit {safety_m:g} m)" if safety_m else ""
        parts.append(f"stays {clearance:.1f} m clear of the structure{limit}")
    if (time := number(values, "duration_s")) is not None:
        parts.append(f"takes {int(time + 0.5) // 60}:{int(time + 0.5) % 60:02d} min")
    if not parts:
        return "No measure was computed."
    listed = filter(None, [", ".join(parts[:-1]), parts[-1]])
    return f"The plan {' and '.join(listed)}."


def verdict(row: Mapping[str, Any], safety_m: float | None) -> dict[str, Any]:
    """The first lines about a plan of this row of `transfers`; `safety_m` is the required distance, m.

    They are ``flyable``; ``headline`` in a sentence; ``look``, what to look at before it is flown, most
    important first.
    """
    status, reason = shown_status(row), reason_of(row)
    if status != "ok":
        return {"flyable": False, "headline": meaning(status, reason), "look": [reason] if reason else []}
    return {"flyable": True, "headline": headline(row, safety_m), "look": all_warnings(row)}


def all_warnings(row: Mapping[str, Any]) -> list[str]:
    """The lost parts of the inspected surface, and the warnings stored with a plan, as sentences."""
    return [*_lost(row), *warnings_of(row)]


def resolution(row: Mapping[str, Any]) -> str:
    """The resolution in mm/px, planned and demonstrated; empty if unknown.

    >>> resolution({"gsd_mm_p50": 14.8, "gsd_demonstrated_mm_p50": 7.9, "gsd_within_pct": 3.2})
    '14.8 mm/px (demonstrated 7.9 mm/px; as fine on 3.2 % of the surface)'
    """
    names = ("gsd_mm_p50", "gsd_demonstrated_mm_p50", "gsd_within_pct")
    planned, flown, within = (number(row, name) for name in names)
    if planned is None:
        return ""
    share = "" if within is None else f"; as fine on {within:.1f} % of the surface"
    return f"{planned:.1f} mm/px" + ("" if flown is None else f" (demonstrated {flown:.1f} mm/px{share})")


def _lost(row: Mapping[str, Any]) -> list[str]:
    """The parts of the inspected surface that are not shown, with the reasons."""
    sentences = []
    shown, most = number(row, "coverage_inspected_pct"), attainable(row)
    if shown is not None and most is not None and most - shown >= _WORTH_A_LOOK_PCT:
        words = "of the inspected surface that a viewpoint could show."
        sentences.append(f"The plan misses {most - shown:.1f} % {words}")
    for name, words in (
        ("inspected_without_counterpart_pct", "has no counterpart on this structure."),
        ("inspected_unattainable_pct", "cannot be shown from any safe viewpoint."),
    ):
        value = number(row, name)
        if value is not None and value >= _WORTH_A_LOOK_PCT:
            sentences.append(f"{value:.1f} % of the inspected surface {words}")
    return sentences
