"""A plan flown in simulation, as reports tell of it; rows and paths of flights are the catalog's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from upplied.outputs.pairs import number
from upplied.records import Measures, Record, Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Flown(Record):
    """What came of flying a plan in simulation."""

    transfer_id: str
    waypoints_sha256: str  # of the plan that was flown
    wind_mps: float
    towards_deg: float
    gusts: bool
    seed: int
    trajectory: Trajectory  # as flown
    measures: Measures  # of what was flown


def flight_row(flight_id: str, flown: Flown) -> dict[str, Any]:
    """The row of `flights` of one flight."""
    said = ("transfer_id", "waypoints_sha256", "wind_mps", "towards_deg", "gusts", "seed")
    return {
        "flight_id": flight_id,
        **{name: getattr(flown, name) for name in said},
        **asdict(flown.measures),
    }


def flown_of(row: Mapping[str, Any], path: Trajectory) -> Flown:
    """The flight of a row of `flights` and its path."""
    measures = {item.name: number(row, item.name) for item in fields(Measures)}
    return Flown(
        str(row["transfer_id"]),
        str(row["waypoints_sha256"] or ""),
        float(row["wind_mps"]),
        float(row["towards_deg"]),
        bool(row["gusts"]),
        int(row["seed"]),
        path,
        Measures(**{name: value for name, value in measures.items() if value is not None}),
    )


class Flights:
    """The last flight of each plan.

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
        return {str(row["transfer_id"]): row for row in self._source.flights().to_dict("records")}

    def of(self, row: Mapping[str, Any]) -> Flown | None:
        """The last flight of the plan of this row; None where it was not flown as it now stands."""
        found = self._last.get(str(row["transfer_id"]))
        if found is None or (found["waypoints_sha256"] or "") != (row.get("waypoints_sha256") or ""):
            return None
        return flown_of(found, self._source.flown(found["flight_sha256"]))


def flown_sentence(flown: Flown | None, row: Mapping[str, Any]) -> str:
    """Planned against flown, in words; empty where the plan was not flown."""
    if flown is None:
        return ""
    gusts = f"with gusts (seed {flown.seed})" if flown.gusts else "without gusts"
    parts = [f"In a wind of {flown.wind_mps:g} m/s towards {flown.towards_deg:g}° {gusts}"]
    clearance, coverage = flown.measures.min_clearance_m, flown.measures.coverage_seen_pct
    if np.isfinite(clearance):
        parts.append(f"least clearance {clearance:.2f} m{_of(row, 'min_clearance_m', 2, ' m')}")
    if np.isfinite(coverage):
        parts.append(f"really seen {coverage:.1f} %{_of(row, 'coverage_seen_pct', 1, ' %')}")
    return f"{parts[0]}: {', '.join(parts[1:])}." if parts[1:] else f"{parts[0]}: nothing could be measured."


def flown_data(flown: Flown, row: Mapping[str, Any], path: dict[str, Any]) -> dict[str, Any]:
    """What a transfer's page shows of a flight; `path` is the flown path as `path_data` gives it."""
    return {
        "said": flown_sentence(flown, row),
        "path": path,
        "measures": {item.name: number(vars(flown.measures), item.name) for item in fields(Measures)},
    }


def _of(row: Mapping[str, Any], name: str, digits: int, unit: str) -> str:
    planned = number(row, name)
    return "" if planned is None else f" (planned {planned:.{digits}f}{unit})"
