"""The fleet as pages show it: one row per demonstration and target, the presets side by side, worst first."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from upplied.checks import pair_name

PRESETS = ("recommended", "paper", "baseline")
_ATTENTION = {"failed": 0, "refused": 1, "not flyable": 1.5, "ok": 2}

_FAILED = (
    "Planning stopped with an error. Other targets are not affected; run it again once the cause is removed."
)
_REFUSED = "No path was made: the inputs are sound, but no honest plan follows. "
_REFUSALS = (  # words of a plan's reason, and what they mean for a reader
    (
        ("do not fit", "gamma", "orientation", "cannot be shown here"),
        "The shapes of the two structures differ more than was allowed. Demonstrate on a structure that is "
        "more alike, or look at the views below and raise the gate if the parts do correspond.",
    ),
    (
        ("clearance", "keep-out", "ceiling", "geofence", "ground", "free way", "way round"),
        "No way was found that keeps the safety distance within the allowed airspace. Look at the place that "
        "is named; less clearance, other surroundings or another stand-off may help.",
    ),
)


NOT_FLYABLE = "not flyable"


def shown_status(row: Mapping[str, Any]) -> str:
    """The status of a plan as people read it: a plan for comparison that must not be flown is no "ok"."""
    status, flyable = str(row["status"]), row.get("flyable")
    forbidden = status == "ok" and flyable is not None and flyable == flyable and not flyable
    return NOT_FLYABLE if forbidden and row.get("not_flyable") else status


def meaning(status: str, reason: str) -> str:
    """What a reader should make of a plan's status; its own reason stands beside it."""
    if status == "ok":
        return ""
    if status == NOT_FLYABLE:
        return "For comparison only: do not fly this plan."
    if status != "refused":
        return _FAILED
    told = [text for words, text in _REFUSALS if any(word in reason for word in words)]
    return _REFUSED + (told[0] if told else "Nothing should be flown here until the reason is dealt with.")


@dataclass(frozen=True)
class Pair:
    """One demonstration on one target: the newest row of each preset, and the one before it."""

    demonstration_id: str
    source_id: str
    target_id: str
    kind: str
    plans: dict[str, dict[str, Any]]  # preset -> row of the table of transfers
    earlier: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Safe as a file name and in a URL; stays the same when the pair is planned anew."""
        return pair_name(self.demonstration_id, self.target_id)

    @property
    def main(self) -> Mapping[str, Any]:
        """The row of the preset that is flown."""
        return next(self.plans[preset] for preset in (*PRESETS, *self.plans) if preset in self.plans)


def pairs_of(current: pd.DataFrame, history: pd.DataFrame) -> list[Pair]:
    """The pairs of a table of transfers, those that need attention first.

    Parameters
    ----------
    current : DataFrame
        One row for each demonstration, target and preset.
    history : DataFrame
        Older plans as well, of each pair in the order they were added; the last tells what changed.
    """
    if not len(current):
        return []
    older = history[~history["transfer_id"].isin(current["transfer_id"])]
    before = {_key(row): _row(row) for row in older.to_dict("records")}
    pairs: dict[tuple[str, str], Pair] = {}
    for raw in current.sort_values(_KEY, kind="stable").to_dict("records"):
        key, row = _key(raw), _row(raw)
        names = (key[0], str(row["source_id"]), key[1], str(row["kind"]))
        pair = pairs.setdefault(key[:2], Pair(*names, plans={}, earlier={}))
        pair.plans[key[2]] = row
        if key in before:
            pair.earlier[key[2]] = before[key]
    return sorted(pairs.values(), key=attention)


_KEY = ["demonstration_id", "target_id", "preset"]


def _key(row: Mapping[Any, Any]) -> tuple[str, str, str]:
    demonstration_id, target_id, preset = (str(row[name]) for name in _KEY)
    return demonstration_id, target_id, preset


def _row(row: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(name): value for name, value in row.items()}


def attention(pair: Pair) -> tuple[float, float, float, str]:
    """Sorts what needs a person first: failed, refused, then by what is really seen, then by clearance."""
    row = pair.main
    seen = coverage(row)
    clearance = number(row, "min_clearance_m")
    return (
        _ATTENTION.get(shown_status(row), 0),
        -1.0 if seen is None else seen,
        -1.0 if clearance is None else clearance,
        pair.name,
    )


_COVERAGES = ("coverage_inspected_pct", "coverage_seen_pct", "coverage_paper_pct")  # the most honest first


def coverage(row: Mapping[str, Any]) -> float | None:
    """The most honest coverage that was computed, percent."""
    known = (number(row, name) for name in _COVERAGES)
    return next((value for value in known if value is not None), None)


def attainable(row: Mapping[str, Any]) -> float | None:
    """The most that could be shown of what was inspected, or seen where that was not computed, percent."""
    lost = [number(row, name) for name in ("inspected_without_counterpart_pct", "inspected_unattainable_pct")]
    if lost[0] is None or lost[1] is None:
        return number(row, "coverage_attainable_pct")
    return 100 - lost[0] - lost[1]


def number(row: Mapping[str, Any], name: str) -> float | None:
    """A finite number of a row, or None."""
    value = row.get(name)
    if value is None or isinstance(value, str) or not math.isfinite(value):
        return None
    return float(value)


def change(pair: Pair) -> str:
    """What is different from the plan before, in a few words; empty where nothing is."""
    row = pair.main
    before = pair.earlier.get(str(row["preset"]))
    if before is None:
        return ""
    if before["status"] != row["status"]:
        return f"{before['status']} → {row['status']}"
    parts = []
    for name, label, unit, least in (
        ("coverage", "coverage", "%", 0.05),
        ("min_clearance_m", "clearance", " m", 0.05),
    ):
        now, then = (coverage(each) if name == "coverage" else number(each, name) for each in (row, before))
        if now is not None and then is not None and abs(now - then) >= least:
            parts.append(f"{label} {now - then:+.1f}{unit}")
    return ", ".join(parts)


def fleet_data(pairs: list[Pair], title: str, without_page: Collection[str] = ()) -> dict[str, Any]:
    """What the fleet page needs: columns by name, and rows in order of attention.

    `without_page` names the pairs whose own page could not be made, so that nothing links there.
    """
    columns = [
        "pair", "status", "demonstration", "source", "target", "kind", "coverage", "attainable", "paper",
        "baseline", "clearance", "frechet", "length", "duration", "change", "planned", "reason", "warnings",
        "page",
    ]  # fmt: skip
    rows = [[*_fleet_row(pair), pair.name not in without_page] for pair in pairs]
    return {"title": title, "columns": columns, "rows": rows}


def _fleet_row(pair: Pair) -> list[Any]:
    row = pair.main
    name = next((name for name in _COVERAGES if number(row, name) is not None), _COVERAGES[-1])
    peers = [number(pair.plans.get(preset, {}), name) for preset in ("paper", "baseline")]
    values = [coverage(row), attainable(row), *peers]
    values += [number(row, name) for name in ("min_clearance_m", "frechet_z", "path_length_m", "duration_s")]
    return [
        pair.name,
        shown_status(row),
        pair.demonstration_id,
        pair.source_id,
        pair.target_id,
        pair.kind,
        *(None if value is None else round(value, 3) for value in values),
        change(pair),
        stamp(row.get("planned_at")),
        str(row.get("reason") or row.get("not_flyable") or ""),
        warnings_of(row),
    ]


def warnings_of(row: Mapping[str, Any]) -> list[str]:
    """Warnings of a plan as sentences; the catalog keeps them as a JSON list."""
    value = row.get("warnings")
    try:
        found = json.loads(value) if isinstance(value, str) and value else []
    except ValueError:
        found = [value]
    return [str(part) for part in (found if isinstance(found, list) else [found])]


def stamp(value: Any) -> str:
    """A time as ``2026-11-21 09:30`` UTC, empty where there is none."""
    return "" if value is None or pd.isna(value) else pd.Timestamp(value).strftime("%Y-%m-%d %H:%M")
