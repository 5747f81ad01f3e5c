"""The verdict of a transfer in the first lines of its page: flyable or not, why, and what to look at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from upplied.outputs.pairs import attainable, meaning, number, reason_of, shown_status, warnings_of

_WORTH_A_LOOK_PCT = 1.0  # of what was inspected: below it nobody finds the place in the picture
# The most honest coverage that was computed, in words.
_SHOWN = (
    ("coverage_inspected_pct", "what was inspected at least as well as the demonstration,"),
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
    if clearance is not None:
        kept = f", {safety_m:g} m asked for" if safety_m else ""
        parts.append(f"keeps {clearance:.1f} m from the structure{kept}")
    return {
        "flyable": True,
        "headline": f"It {' and '.join(parts)}." if parts else "No measure was computed.",
        "look": [*_lost(row), *warnings_of(row)],
    }


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
