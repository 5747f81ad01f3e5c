"""Flights of plans, flown or simulated, as sentences for reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog import Catalog
from upplied.catalog.schema.rows import Row
from upplied.catalog.store.contents import StoredLooks
from upplied.outputs.pairs import number, stamp
from upplied.records import SURFACE_STATES, Measures, SurfaceStates


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
    """The wind of a simulation."""
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
    return {
        "summary": flown_sentence(flight, row),
        "kind": flight["kind"],
        "path": path,
        "measures": {item.name: number(flight, item.name) for item in fields(Measures)},
    }


def _of(row: Mapping[str, Any], name: str, digits: int, unit: str) -> str:
    planned = number(row, name)
    return "" if planned is None else f" (planned {planned:.{digits}f}{unit})"
