"""The verdict of a transfer in the first lines of its page: flyable or not, why, and what to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.outputs.pairs import attainable, meaning, number, reason_of, shown_status, warnings_of

_WORTH_A_LOOK_PCT = 1.0  # of the inspected surface: below it nobody finds the place in the picture
# The most honest coverage that was computed, in words.
_SHOWN = (
    ("coverage_inspected_pct", "of the inspected surface as well as the demonstration"),
    ("coverage_seen_pct", "of the demonstrated surface"),
    ("coverage_paper_pct", "of the surface in the camera's frustum, hidden or not"),
)


def headline(values: Mapping[str, Any], safety_m: float | None) -> str:
    """The result of a plan: coverage, clearance and time in one sentence, mm/px in another.

    Parameters
    ----------
    values : mapping
        Measures by name.
    safety_m : float or None
        Required distance from the structure, m.
    """
    known = [(number(values, name), words) for name, words in _SHOWN]
    parts = [f"shows {shown:.1f} % {words}" for shown, words in known if shown is not None][:1]
    if parts and known[0][0] is not None and values.get("standoff_mode") == "scaled":
        parts[0] += ", relative to the structure's size"
    fine = fineness(values)
    if parts and not fine and (pixel := number(values, "gsd_mm_p50")) is not None:
        parts[0] += f" at {pixel:.1f} mm/px"
    if (clearance := number(values, "min_clearance_m")) is not None:
        limit = f" (limit {safety_m:g} m)" if safety_m else ""
        parts.append(f"keeps {clearance:.1f} m clearance{limit}")
    if (time := number(values, "duration_s")) is not None:
        parts.append(f"takes {int(time + 0.5) // 60}:{int(time + 0.5) % 60:02d} min")
    if not parts:
        return "No measure was computed."
    return " ".join(filter(None, [f"The plan {_listed(parts)}.", fine]))


def _listed(parts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))


def verdict(row: Mapping[str, Any], safety_m: float | None) -> dict[str, Any]:
    """What a person reads first of a plan.

    Parameters
    ----------
    row : mapping
        Of the table of transfers.
    safety_m : float or None
        Distance that the plan was asked to keep, m.

    Returns
    -------
    dict
        ``flyable``; ``headline`` in a sentence; ``look``, what to look at before it is flown, most
        important first.
    """
    status = shown_status(row)
    reason = reason_of(row)
    if status != "ok":
        return {"flyable": False, "headline": meaning(status, reason), "look": [reason] if reason else []}
    return {"flyable": True, "headline": headline(row, safety_m), "look": [*_lost(row), *warnings_of(row)]}


def fineness(row: Mapping[str, Any]) -> str:
    """The resolution in mm/px, planned and demonstrated, in a sentence; empty if unknown.

    Examples
    --------
    >>> fineness({"gsd_mm_p50": 14.8, "gsd_mm_p95": 16.5, "gsd_demonstrated_mm_p50": 7.9,
    ...           "gsd_demonstrated_mm_p95": 9.1, "gsd_within_pct": 3.2})
    'Resolution 14.8 mm/px (95 %: 16.5), demonstrated 7.9 mm/px (95 %: 9.1); 3.2 % of the surface as fine.'
    """
    names = ("gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50", "gsd_demonstrated_mm_p95")
    now, now_most, then, then_most = (number(row, name) for name in names)
    if now is None or now_most is None or then is None or then_most is None:
        return ""
    within = number(row, "gsd_within_pct")
    share = "" if within is None else f"; {within:.1f} % of the surface as fine"
    planned = f"Resolution {now:.1f} mm/px (95 %: {now_most:.1f})"
    return f"{planned}, demonstrated {then:.1f} mm/px (95 %: {then_most:.1f}){share}."


def _lost(row: Mapping[str, Any]) -> list[str]:
    """What of the inspected surface is not shown, and why."""
    sentences = []
    shown, most = number(row, "coverage_inspected_pct"), attainable(row)
    if shown is not None and most is not None and most - shown >= _WORTH_A_LOOK_PCT:
        sentences.append(
            f"The plan misses {most - shown:.1f} % of the inspected surface that a viewpoint could show."
        )
    for name, words in (
        ("inspected_without_counterpart_pct", "has no counterpart on this structure."),
        ("inspected_unattainable_pct", "cannot be shown from any safe viewpoint."),
    ):
        value = number(row, name)
        if value is not None and value >= _WORTH_A_LOOK_PCT:
            sentences.append(f"{value:.1f} % of the inspected surface {words}")
    return sentences
