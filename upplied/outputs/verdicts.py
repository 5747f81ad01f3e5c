"""The verdict of a transfer in the first lines of its page: flyable or not, why, and what to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.outputs.pairs import attainable, meaning, number, reason_of, shown_status, warnings_of

_WORTH_A_LOOK_PCT = 1.0  # of what was inspected: below it nobody finds the place in the picture
# The most honest coverage that was computed, in words.
_SHOWN = (
    ("coverage_inspected_pct", "what was inspected at least as finely as the demonstration,"),
    ("coverage_seen_pct", "what was seen"),
    ("coverage_paper_pct", "what lay in the camera's frustum, hidden or not"),
)


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
        headline = meaning(status, reason)
        return {"flyable": False, "headline": headline, "look": [reason] if reason else []}
    clearance = number(row, "min_clearance_m")
    known = [(number(row, name), words) for name, words in _SHOWN]
    parts = [f"shows {shown:.1f} % of {words}" for shown, words in known if shown is not None][:1]
    if known[0][0] is not None and row.get("standoff_mode") == "scaled":
        shown = scaled_coverage(row)
        parts = [
            f"shows {shown:.1f} % of what was inspected at least as well as the demonstration for its size,"
        ]
    if clearance is not None:
        kept = f", {safety_m:g} m asked for" if safety_m else ""
        parts.append(f"keeps {clearance:.1f} m from the structure{kept}")
    return {
        "flyable": True,
        "headline": " ".join(filter(None, [f"It {' and '.join(parts)}.", fineness(row), _passes(row)]))
        if parts
        else "No measure was computed.",
        "look": [*_lost(row), *warnings_of(row)],
    }


def scaled_coverage(row: Mapping[str, Any]) -> float | None:
    """What is shown relative to size, %; older rows of stand-offs that scale were judged so anyway."""
    known = number(row, "coverage_inspected_scaled_pct")
    return number(row, "coverage_inspected_pct") if known is None else known


def _passes(row: Mapping[str, Any]) -> str:
    """How long the passes take that were not demonstrated, in a sentence; empty where there are none."""
    added, whole = number(row, "added_s"), number(row, "duration_s")
    if not added or whole is None:
        return ""
    return f"Passes that were added to the demonstrated ones take {added:.0f} of its {whole:.0f} s."


def fineness(row: Mapping[str, Any]) -> str:
    """How much of the surface a pixel covers, planned and demonstrated, in a sentence; empty if unknown.

    Examples
    --------
    >>> fineness({"gsd_mm_p50": 14.8, "gsd_mm_p95": 16.5, "gsd_demonstrated_mm_p50": 7.9,
    ...           "gsd_demonstrated_mm_p95": 9.1, "gsd_within_pct": 3.2})
    'A pixel covers 14.8 mm (95 %: 16.5), in the demonstration 7.9 mm (9.1): 3.2 % of it is as fine.'
    """
    names = ("gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50", "gsd_demonstrated_mm_p95")
    now, now_most, then, then_most = (number(row, name) for name in names)
    if now is None or now_most is None or then is None or then_most is None:
        return ""
    within = number(row, "gsd_within_pct")
    share = "" if within is None else f": {within:.1f} % of it is as fine"
    pixel = f"A pixel covers {now:.1f} mm (95 %: {now_most:.1f})"
    return f"{pixel}, in the demonstration {then:.1f} mm ({then_most:.1f}){share}."


def _lost(row: Mapping[str, Any]) -> list[str]:
    """What of the inspected surface is not shown, and why."""
    told = []
    shown, most = number(row, "coverage_inspected_pct"), attainable(row)
    if shown is not None and most is not None and most - shown >= _WORTH_A_LOOK_PCT:
        told.append(f"{most - shown:.1f} % of what was inspected is missed though a viewpoint could show it")
    for name, words in (
        ("inspected_without_counterpart_pct", "has no counterpart here"),
        ("inspected_unattainable_pct", "can be shown from no safe viewpoint"),
    ):
        value = number(row, name)
        if value is not None and value >= _WORTH_A_LOOK_PCT:
            told.append(f"{value:.1f} % of what was inspected {words}")
    return told
