"""The rows of the fleet's page: one per demonstration and target, those first that need a person."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.checks import pair_name
from upplied.outputs.labels import LABELS

PRESETS = ("recommended", "paper", "baseline")
ATTENTION = {"recalled": -1, "failed": 0, "refused": 1, "not flyable": 1.5, "ok": 2}
NOT_FLYABLE, RECALLED = "not flyable", "recalled"
COVERAGES = ("coverage_inspected_pct", "coverage_seen_pct", "coverage_paper_pct")  # the strictest first
_ADVICE: dict[str, str] = LABELS["advice"]
_PAIR = ["demonstration_id", "target_id"]
_KEY = [*_PAIR, "preset"]
_COLUMNS = (  # by `attention`, and of each plan
    *("transfer_id", *_PAIR, "preset", "purpose", "status", "flyable", "not_flyable"),
    *("state", "state_at", *COVERAGES, "min_clearance_m"),
)


def shown_status(row: Mapping[str, Any]) -> str:
    """The status of a plan on pages: a plan that must not be flown is not "ok"."""
    if row.get("state") == RECALLED:
        return RECALLED
    status, flyable = str(row["status"]), row.get("flyable")
    forbidden = status == "ok" and flyable is not None and flyable == flyable and not flyable
    return NOT_FLYABLE if forbidden and row.get("not_flyable") else status


def meaning(status: str, reason: str) -> str:
    """Advice about a plan's status; its own reason is shown beside it."""
    if status != "refused":
        return _ADVICE.get(status, _ADVICE["failed"])
    known = [text for text, words in LABELS["refusals"].items() if any(word in reason for word in words)]
    return " ".join([_ADVICE["refused"], *(known or [_ADVICE["unresolved"]])[:1]])


@dataclass(frozen=True)
class Pair:
    """One demonstration on one target: the row of each preset, and the previous one.

    A released plan comes first, in place of the newest of its preset, which is then its `draft`. A recalled
    plan comes first until another is released.
    """

    demonstration_id: str
    source_id: str
    target_id: str
    kind: str
    plans: dict[str, dict[str, Any]]  # preset -> row of the table of transfers
    earlier: dict[str, dict[str, Any]] = field(default_factory=dict)
    draft: dict[str, Any] | None = None  # newer than the plan in force, or than the one that was recalled
    decided: str = ""  # preset of the plan in force, or of the one that was recalled

    @property
    def name(self) -> str:
        """Safe as a file name and in a URL; stays the same when the pair is planned anew."""
        return pair_name(self.demonstration_id, self.target_id)

    @property
    def main(self) -> Mapping[str, Any]:
        """The row of the plan that is flown."""
        if self.decided:
            return self.plans[self.decided]
        return next(self.plans[preset] for preset in (*PRESETS, *self.plans) if preset in self.plans)


def first_pairs(
    catalog: Catalog, most: int, demonstration: str | None = None, target: str | None = None
) -> tuple[list[Pair], int]:
    """The `most` pairs that need a person first, as `pairs_of` orders all, and how many there are."""
    rows_of = partial(catalog.transfers, demonstration=demonstration, structure=target)
    every = rows_of(every=True, columns=_COLUMNS)
    decided = every[(every["purpose"] == "") & every["state"].isin(["released", RECALLED])]
    plans = every[["transfer_id", *_PAIR]]
    del every  # of a million plans it is hundreds of megabytes
    main = _main_rows(rows_of(columns=_COLUMNS), decided)
    known = len(main)
    if not known:
        return [], 0
    if known <= most:
        return pairs_of(rows_of(), rows_of(every=True)), known
    chosen = _in_order(main).head(most)
    plans = plans[np.logical_and.reduce([plans[name].isin(chosen[name]) for name in _PAIR])]
    shown = pd.MultiIndex.from_frame(plans[_PAIR]).isin(pd.MultiIndex.from_frame(chosen))
    ids = plans["transfer_id"][shown].tolist()
    return pairs_of(catalog.transfers(ids=ids), catalog.transfers(every=True, ids=ids)), known


def _main_rows(newest: pd.DataFrame, decided: pd.DataFrame) -> pd.DataFrame:
    """The main plan of each pair: in force, recalled, or the newest of the best preset."""
    decided = decided.sort_values("state_at", kind="stable")
    decided = decided.assign(at=np.where(decided["state"] == "released", -2, -1)).iloc[::-1]
    ranks = {preset: rank for rank, preset in enumerate(PRESETS)}
    undecided = newest.assign(at=newest["preset"].map(ranks).fillna(len(ranks)))
    rows = pd.concat([decided, undecided]) if len(decided) else undecided
    rows = rows.sort_values([*_PAIR, "at"], kind="stable")
    return rows.drop_duplicates(_PAIR).reset_index(drop=True)


def _in_order(main: pd.DataFrame) -> pd.DataFrame:
    """The pairs of rows as `attention` sorts them."""
    standing = main[["state", "status", "flyable"]].assign(not_flyable=main["not_flyable"].fillna("") != "")
    alike = standing.groupby(list(standing), dropna=False).ngroup()  # few, of a million rows
    first = standing.loc[~alike.duplicated().to_numpy()].to_dict("records")
    ranks = [ATTENTION.get(shown_status(row), 0) for row in first]
    seen = pd.Series(np.nan, main.index)
    for name in COVERAGES:
        seen = seen.fillna(main[name].astype(float))
    names = zip(*(main[name] for name in _PAIR), strict=True)
    order = {
        "rank": alike.map(dict(zip(alike.drop_duplicates(), ranks, strict=True))),
        "seen": seen.fillna(-1.0),
        "clearance": main["min_clearance_m"].astype(float).fillna(-1.0),
        "name": [pair_name(*pair) for pair in names],
    }
    return main[_PAIR].assign(**order).sort_values(list(order), kind="stable")[_PAIR]


def pairs_of(current: pd.DataFrame, history: pd.DataFrame) -> list[Pair]:
    """The pairs of a table of transfers, those that need attention first.

    `current` has one row for each demonstration, target and preset; `history` older plans as well, of each
    pair in the order they were added: the last is the one before.
    """
    if not len(current):
        return []
    older = history[~history["transfer_id"].isin(current["transfer_id"])]
    before = {_key(row): row for row in older.to_dict("records")}
    pairs: dict[tuple[str, str], Pair] = {}
    for row in current.sort_values(_KEY, kind="stable").to_dict("records"):
        key = _key(row)
        pair = pairs.setdefault(key[:2], _pair_of(row))
        pair.plans[key[2]] = row
        if key in before:
            pair.earlier[key[2]] = before[key]
    for row in _decided(history):
        key = _key(row)
        pair = pairs.get(key[:2]) or _pair_of(row)  # a plan in force outlives its demonstration
        newest = pair.plans.get(key[2])
        if newest is not None and newest["transfer_id"] == row["transfer_id"]:
            pairs[key[:2]] = replace(pair, decided=key[2])
        else:  # it takes the place of the newest of its preset, which becomes its draft
            plans = {**pair.plans, key[2]: row}
            pairs[key[:2]] = replace(pair, plans=plans, earlier={}, draft=newest, decided=key[2])
    return sorted(pairs.values(), key=attention)


def _pair_of(row: Mapping[str, Any]) -> Pair:
    demonstration_id, target_id, _ = _key(row)
    return Pair(demonstration_id, str(row["source_id"]), target_id, str(row["kind"]), plans={})


def _decided(history: pd.DataFrame) -> list[dict[str, Any]]:
    """Plans in force, and recalled plans that were not replaced."""
    flown = history[history["purpose"] == ""]
    released = flown[flown["state"] == "released"]
    recalled = flown[flown["state"] == RECALLED].sort_values("state_at", kind="stable")
    rows = [*recalled.to_dict("records"), *released.to_dict("records")]
    return list({_key(row)[:2]: row for row in rows}.values())


def _key(row: Mapping[Any, Any]) -> tuple[str, str, str]:
    demonstration_id, target_id, preset = (str(row[name]) for name in _KEY)
    return demonstration_id, target_id, preset


def attention(pair: Pair) -> tuple[float, float, float, str]:
    """Sort key, attention first: failed, refused, then by coverage, then by clearance."""
    row = pair.main
    known = coverage(row), number(row, "min_clearance_m")
    seen, clearance = (-1.0 if value is None else value for value in known)
    return ATTENTION.get(shown_status(row), 0), seen, clearance, pair.name


def coverage(row: Mapping[str, Any]) -> float | None:
    """The strictest coverage that was computed, percent."""
    known = (number(row, name) for name in COVERAGES)
    return next((value for value in known if value is not None), None)


def attainable(row: Mapping[str, Any]) -> float | None:
    """The attainable share of the inspected surface, or else of the demonstrated surface, percent."""
    lost, hidden = (number(row, f"inspected_{name}_pct") for name in ("without_counterpart", "unattainable"))
    if lost is None or hidden is None:
        return number(row, "coverage_attainable_pct")
    return 100 - lost - hidden


def battery_pct(row: Mapping[str, Any]) -> float | None:
    """The inspection time of a plan as a share of the endurance in its settings, percent; None if unset."""
    try:
        endurance_s = json.loads(row["settings_json"])["vehicle"]["endurance_s"]
        share = 100 * float(row["duration_s"]) / float(endurance_s)
        return share if math.isfinite(share) else None
    except (TypeError, ValueError, KeyError, ZeroDivisionError):
        return None


def number(row: Mapping[str, Any], name: str) -> float | None:
    """A finite number of a row, or None; a share, whose name ends in ``_pct``, is 0 to 100.

    >>> number({"coverage_seen_pct": 100.00000000000001}, "coverage_seen_pct")
    100.0
    """
    value = row.get(name)
    if value is None or isinstance(value, str) or not math.isfinite(value):
        return None
    return min(max(float(value), 0.0), 100.0) if name.endswith("_pct") else float(value)


def change(pair: Pair) -> str:
    """The difference from the previous plan, in a few words; empty if there is none.

    For a plan in force, the difference of its newer draft.
    """
    row = pair.main
    if pair.draft is not None:
        return f"newer draft: {_changed(pair.draft, row) or 'no difference'}"
    before = pair.earlier.get(str(row["preset"]))
    return "" if before is None else _changed(row, before)


def _changed(row: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    if before["status"] != row["status"]:
        return f"{before['status']} → {row['status']}"
    parts = []
    seen, clear = ([coverage(each), number(each, "min_clearance_m")] for each in (row, before))
    for label, unit, now, then in zip(("coverage", "clearance"), ("%", " m"), seen, clear, strict=True):
        if now is not None and then is not None and abs(now - then) >= 0.05:
            parts.append(f"{label} {now - then:+.1f}{unit}")
    return ", ".join(parts)


def decision_words(row: Mapping[str, Any]) -> str:
    """The last decision about a plan, with its author and time."""
    state = str(row.get("state") or "")
    if not state or state == "draft":
        return "Draft, not released yet" if state else ""
    note = f": {row['state_note']}" if row.get("state_note") else ""
    return f"{state.capitalize()} by {row.get('state_by')}, {stamp(row.get('state_at'))} UTC{note}"


def reason_of(row: Mapping[str, Any]) -> str:
    """Why a plan must not be flown, in words; empty if it may."""
    recalled = row.get("state_note") if row.get("state") == RECALLED else ""
    return str(recalled or row.get("reason") or row.get("not_flyable") or "")


def warnings_of(row: Mapping[str, Any]) -> list[str]:
    """Warnings of a plan as sentences, from the JSON list in the catalog."""
    value = row.get("warnings")
    try:
        entries = json.loads(value) if isinstance(value, str) and value else []
    except ValueError:
        entries = [value]
    return [sentence(str(part)) for part in (entries if isinstance(entries, list) else [entries])]


def sentence(text: str) -> str:
    """A message as a sentence; a name at its start is not capitalised.

    >>> sentence("the scan is open"), sentence("part_0 is missing.")
    ('The scan is open.', 'part_0 is missing.')
    """
    first, text = text.split(" ", 1)[0], text.replace(" m2", " m²")
    text = text[:1].upper() + text[1:] if first.isalpha() else text
    return text if not text or text[-1] in ".!?" else f"{text}."


def stamp(value: Any) -> str:
    """A time as ``2026-11-21 09:30`` UTC, empty if there is none."""
    return "" if value is None or pd.isna(value) else pd.Timestamp(value).strftime("%Y-%m-%d %H:%M")
