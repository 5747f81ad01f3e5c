"""A transfer in sentences: flyable or not, the reason, warnings; and its flights, flown or simulated."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.store.contents import StoredLooks
from upplied.outputs.pairs import attainable, meaning, number, reason_of, shown_status, stamp, warnings_of
from upplied.records import SURFACE_STATES, Measures, SurfaceStates

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


def wind_words(row: Mapping[str, Any]) -> str:
    """The wind of a row of `flights`, in words."""
    speed, most, towards = (number(row, name) for name in ("wind_mps", "wind_most_mps", "towards_deg"))
    if speed is None:
        return "wind not logged"
    upto = "" if most is None else f", up to {most:.1f} m/s"
    return f"wind of {speed:.1f} m/s{upto}" + ("" if towards is None else f", towards {towards:.0f}°")


@dataclass
class Flights:
    """The last flight of each plan; real flights come before simulated ones."""

    catalog: Catalog

    @cached_property
    def _last(self) -> dict[str, Row]:
        rows = self.catalog.flights().to_dict("records")
        rows.sort(key=lambda row: row["kind"] == "flown")  # stable: the order they were added in
        return {str(row["transfer_id"]): row for row in rows}

    def of(self, row: Mapping[str, Any]) -> Row | None:
        """The last flight of the plan of this row; None if the stored version was not flown."""
        last = self._last.get(str(row["transfer_id"]))
        same = last is not None and (last["waypoints_sha256"] or "") == (row.get("waypoints_sha256") or "")
        return last if same else None


def flown_sentence(flight: Mapping[str, Any] | None, row: Mapping[str, Any]) -> str:
    """The comparison of a flight with its plan, in words; empty without a flight."""
    if flight is None:
        return ""
    real = flight["kind"] == "flown"
    parts = [_occasion(flight) if real else _weather(flight)]
    if (clearance := number(flight, "min_clearance_m")) is not None:
        silent = number(flight, "silent_s")
        unknown = f", unknown for {silent:.0f} s without a log" if silent else ""
        parts.append(f"minimum clearance {clearance:.2f} m{_of(row, 'min_clearance_m', 2, ' m')}{unknown}")
    for name, words in _SHARES.items():
        share = number(flight, name)
        if share is not None and (share or name != "assumed_pct"):
            parts.append(f"{share:.1f} % {words}")
    if (coverage := number(flight, "coverage_seen_pct")) is not None:
        parts.append(f"surface seen {coverage:.1f} %{_of(row, 'coverage_seen_pct', 1, ' %')}")
    if real:
        parts.append(wind_words(flight))
    measured = f"{parts[0]}: {', '.join(parts[1:]) or 'nothing was measured'}."
    return f"{measured} Findings: {flight['findings']}." if flight.get("findings") else measured


_SHARES = {
    "inspected_pct": "of the planned surface was inspected as planned",
    "inspected_if_corrected_pct": "if the correction of the log is right",
    "required_pct": "was certainly in view",
    "assumed_pct": "more in view if the correction of the log is right",
}


def _occasion(flight: Mapping[str, Any]) -> str:
    """When a plan was flown, by whom, and how much of it."""
    who = f" by {flight['operator']}" if flight.get("operator") else ""
    share = number(flight, "flown_pct")
    part = "" if share is None else f", {share:.0f} % of the plan"
    return f"Flown {stamp(flight.get('flown_at'))} UTC{who}{part}"


def _weather(flight: Mapping[str, Any]) -> str:
    speed, towards, seed = (number(flight, name) or 0.0 for name in ("wind_mps", "towards_deg", "seed"))
    gusts = f"with gusts (seed {seed:.0f})" if flight["gusts"] else "without gusts"
    return f"In a wind of {speed:g} m/s towards {towards:g}° {gusts}"


def seen_as_flown(planned: SurfaceStates, looks: StoredLooks) -> SurfaceStates:
    """States of a planned surface, with what its flight did not inspect as planned, or did not see."""
    state, shown = planned.state.copy(), planned.state == SURFACE_STATES.index("shown")
    become = np.full(len(state), SURFACE_STATES.index("missed"))
    become[looks.patch] = SURFACE_STATES.index("seen if corrected")
    become[looks.certain.patch] = SURFACE_STATES.index("in view only")
    if (flags := looks.inspected_if_corrected) is not None:
        become[looks.patch[flags > 0]] = SURFACE_STATES.index("inspected if corrected")
    become[looks.as_asked] = SURFACE_STATES.index("shown")
    state[shown] = become[shown]
    return replace(planned, state=state)


def flown_data(flight: Mapping[str, Any], row: Mapping[str, Any], path: dict[str, Any]) -> dict[str, Any]:
    """A flight for the page of its plan; `path` is the flown path by `path_data`."""
    measures = {item.name: number(flight, item.name) for item in fields(Measures)}
    summary = flown_sentence(flight, row)
    return {"summary": summary, "kind": flight["kind"], "path": path, "measures": measures}


def _of(row: Mapping[str, Any], name: str, digits: int, unit: str) -> str:
    planned = number(row, name)
    return "" if planned is None else f" (planned {planned:.{digits}f}{unit})"
