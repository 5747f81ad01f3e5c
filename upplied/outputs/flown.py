"""A plan flown in simulation, as reports tell of it: what was measured, kept beside the catalog's tables.

The tables hold plans alone. A flight is kept in the cache, once by everything it depends on and once,
the one flown last, by the name of its plan, where reports look for it. A cache that was pruned loses
the sentence in the report until the plan is flown again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from upplied.config import digest
from upplied.outputs.pairs import number
from upplied.records import Measures, Record, Trajectory

STAGE = "flown"


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


def last_key(transfer_id: str) -> str:
    """Where the cache keeps the flight of a plan that was flown last."""
    return digest([STAGE, transfer_id])


def last_flown(source: Any, row: Mapping[str, Any]) -> Flown | None:
    """The last flight of the plan of this row; None where it was not flown as it now stands."""
    cache = getattr(source, "cache", None)
    if cache is None:
        return None
    found: Flown | None = cache.get(STAGE, Flown, last_key(str(row["transfer_id"])))
    if found is None or found.waypoints_sha256 != str(row.get("waypoints_sha256") or ""):
        return None
    return found


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
