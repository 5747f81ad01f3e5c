"""A flight of a plan, flown or in simulation, as reports tell of it; its row and path are the catalog's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from upplied.catalog.store.contents import StoredLooks
from upplied.outputs.pairs import number, stamp
from upplied.records import SURFACE_STATES, Measures, Record, SurfaceStates, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Flown(Record):
    """What came of flying a plan."""

    transfer_id: str
    waypoints_sha256: str  # of the plan that was flown
    wind_mps: float
    towards_deg: float
    gusts: bool
    seed: int
    trajectory: Trajectory  # as flown
    measures: Measures  # of what was flown
    kind: str = "simulated"  # or "flown"
    told: str = ""  # of a flight that was flown: when, by whom, how much of the plan
    findings: str = ""  # what was found of it, in words
    inspected_pct: float = float("nan")  # of what the plan shows, the share inspected as asked
    required_pct: float = float("nan")  # of it, the share that was certainly in view
    assumed_pct: float = float("nan")  # of it, the share in view besides if the log's correction is right
    silent_s: float = 0.0  # how long the log says nothing: what it kept from the structure then is not known
    looks_sha256: str = ""  # of what it saw of each patch; empty where that was not kept
    wind: str = ""  # of a flight that was flown: what its log says of it, in words


def flight_row(flight_id: str, flown: Flown) -> dict[str, Any]:
    """The row of `flights` of one flight."""
    names = ("transfer_id", "waypoints_sha256", "wind_mps", "towards_deg", "gusts", "seed")
    return {
        "flight_id": flight_id,
        **{name: getattr(flown, name) for name in names},
        **asdict(flown.measures),
    }


def flown_of(row: Mapping[str, Any], path: Trajectory) -> Flown:
    """The flight of a row of `flights` and its path."""
    measures = {item.name: number(row, item.name) for item in fields(Measures)}
    kind = str(row.get("kind") or "simulated")
    return Flown(
        str(row["transfer_id"]),
        str(row["waypoints_sha256"] or ""),
        number(row, "wind_mps") or 0.0,
        number(row, "towards_deg") or 0.0,
        bool(row["gusts"]),
        int(number(row, "seed") or 0),
        path,
        Measures(**{name: value for name, value in measures.items() if value is not None}),
        kind,
        _told(row),
        str(row.get("findings") or ""),
        _known(number(row, "inspected_pct")),
        _known(number(row, "required_pct")),
        _known(number(row, "assumed_pct")),
        number(row, "silent_s") or 0.0,
        str(row.get("looks_sha256") or ""),
        wind_words(row) if kind == "flown" else "",
    )


def wind_words(row: Mapping[str, Any]) -> str:
    """The wind of a row of `flights`, in words."""
    speed, most, towards = (number(row, name) for name in ("wind_mps", "wind_most_mps", "towards_deg"))
    if speed is None:
        return "wind not logged"
    upto = "" if most is None else f", up to {most:.1f} m/s"
    return f"wind of {speed:.1f} m/s{upto}" + ("" if towards is None else f", towards {towards:.0f}°")


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _told(row: Mapping[str, Any]) -> str:
    """When a flight was flown, by whom, and how much of the plan."""
    if row.get("kind") != "flown":
        return ""
    who = f" by {row['operator']}" if row.get("operator") else ""
    share = number(row, "flown_pct")
    part = "" if share is None else f", {share:.0f} % of the plan"
    return f"{stamp(row.get('flown_at'))} UTC{who}{part}"


class Flights:
    """The last flight of each plan; one that was flown comes before any that was simulated.

    Parameters
    ----------
    source : Source
        The catalog, or anything that answers like it; one that knows no flights has none.
    """

    def __init__(self, source: Any) -> None:
        self._source = source

    @cached_property
    def _last(self) -> dict[str, Mapping[str, Any]]:
        if not hasattr(self._source, "flights"):
            return {}
        rows = self._source.flights().to_dict("records")
        rows.sort(key=lambda row: row.get("kind") == "flown")  # stable: the order they were added in
        return {str(row["transfer_id"]): row for row in rows}

    def of(self, row: Mapping[str, Any]) -> Flown | None:
        """The last flight of the plan of this row; None where it was not flown as it now stands."""
        last = self._last.get(str(row["transfer_id"]))
        if last is None or (last["waypoints_sha256"] or "") != (row.get("waypoints_sha256") or ""):
            return None
        return flown_of(last, self._source.flown(last["flight_sha256"]))


def flown_sentence(flown: Flown | None, row: Mapping[str, Any]) -> str:
    """Planned against flown, in words; empty where the plan was not flown."""
    if flown is None:
        return ""
    gusts = f"with gusts (seed {flown.seed})" if flown.gusts else "without gusts"
    simulated = f"In a wind of {flown.wind_mps:g} m/s towards {flown.towards_deg:g}° {gusts}"
    parts = [f"Flown {flown.told}" if flown.kind == "flown" else simulated]
    clearance, coverage = flown.measures.min_clearance_m, flown.measures.coverage_seen_pct
    if np.isfinite(clearance):
        unknown = f", unknown for {flown.silent_s:.0f} s without log" if flown.silent_s else ""
        parts.append(f"minimum clearance {clearance:.2f} m{_of(row, 'min_clearance_m', 2, ' m')}{unknown}")
    if np.isfinite(flown.inspected_pct):
        parts.append(f"{flown.inspected_pct:.1f} % of the planned surface was inspected as planned")
    if np.isfinite(flown.required_pct):
        parts.append(f"{flown.required_pct:.1f} % of it was certainly in view")
    if flown.assumed_pct > 0:
        parts.append(f"{flown.assumed_pct:.1f} % more if the correction of the log is right")
    if np.isfinite(coverage):
        parts.append(f"surface seen {coverage:.1f} %{_of(row, 'coverage_seen_pct', 1, ' %')}")
    if flown.kind == "flown":
        parts.append(flown.wind)
    measured = f"{parts[0]}: {', '.join(parts[1:]) or 'nothing was measured'}."
    return f"{measured} Findings: {flown.findings}." if flown.findings else measured


def seen_as_flown(planned: SurfaceStates, looks: StoredLooks) -> SurfaceStates:
    """What a plan shows of a surface, less what its flight did not look at as asked, or did not see."""
    state, shown = planned.state.copy(), planned.state == SURFACE_STATES.index("shown")
    become = np.full(len(state), SURFACE_STATES.index("missed"))
    become[looks.patch] = SURFACE_STATES.index("seen if corrected")
    become[looks.certain.patch] = SURFACE_STATES.index("in view only")
    become[looks.as_asked] = SURFACE_STATES.index("shown")
    state[shown] = become[shown]
    return replace(planned, state=state)


def flown_data(flown: Flown, row: Mapping[str, Any], path: dict[str, Any]) -> dict[str, Any]:
    """What a transfer's page shows of a flight; `path` is the flown path as `path_data` gives it."""
    return {
        "said": flown_sentence(flown, row),
        "kind": flown.kind,
        "path": path,
        "measures": {item.name: number(vars(flown.measures), item.name) for item in fields(Measures)},
    }


def _of(row: Mapping[str, Any], name: str, digits: int, unit: str) -> str:
    planned = number(row, name)
    return "" if planned is None else f" (planned {planned:.{digits}f}{unit})"
