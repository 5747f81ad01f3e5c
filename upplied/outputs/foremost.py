"""The pairs of a fleet that are shown: those first that need a person, by a few columns of all plans."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from upplied.catalog import Catalog
from upplied.checks import pair_name
from upplied.outputs.pairs import ATTENTION, COVERAGES, PRESETS, RECALLED, Pair, pairs_of, shown_status

_PAIR = ["demonstration_id", "target_id"]
_COLUMNS = (  # by `attention`, and of each plan
    *("transfer_id", *_PAIR, "preset", "purpose", "status", "flyable", "not_flyable"),
    *("state", "state_at", *COVERAGES, "min_clearance_m"),
)


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
