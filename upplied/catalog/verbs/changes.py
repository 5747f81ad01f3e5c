"""What happened to the catalog, and what is different between two moments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from upplied.catalog.verbs.ordering import PAIR
from upplied.catalog.verbs.queries import When, moment

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

_INPUTS = ("demonstration", "source", "target", "settings")
_METHOD = {
    "method_version": "method changed",
    "sources_sha256": "planning sources changed",
    "libraries": "libraries changed",
}
_COMPARED = (
    "status", "coverage_inspected_pct", "coverage_seen_pct", "coverage_paper_pct", "min_clearance_m",
    "frechet_z", "duration_s",
)  # fmt: skip


def history(catalog: Catalog, limit: int | None = None) -> pd.DataFrame:
    """Commits, newest first: when, to which table, its version after it, what was done, rows added.

    All, or the newest `limit`, as far back as the tables keep their log; `as_of` reaches to the first row.
    """
    commits = []
    for name, table in catalog.tables.items():
        delta = table.delta()
        for commit in delta.history(limit) if delta is not None else []:
            at = pd.Timestamp(commit["timestamp"], unit="ms", tz="UTC")
            operation = str(commit.get("doing", commit.get("operation", ""))).lower()
            operation = {"write": "add", "create table": "create"}.get(operation, operation)
            commits.append((at, name, int(commit["version"]), operation, int(commit.get("rows", 0))))
    columns = ["at", "table", "version", "operation", "rows_added"]
    listed = pd.DataFrame(commits, columns=columns)
    return listed.sort_values(["at", "table"], ascending=False, kind="stable", ignore_index=True)[:limit]


def runs(catalog: Catalog) -> pd.DataFrame:
    """Runs that planned, newest first: when, how many plans of which outcome, by which code."""
    columns = ["run_id", "status", "planned_at", "code_version", "method_version"]
    rows = catalog.transfers(every=True, columns=columns)
    counts = pd.crosstab(rows["run_id"], rows["status"]).reindex(
        columns=["ok", "refused", "failed"], fill_value=0
    )
    first = rows.groupby("run_id").agg(
        first_at=("planned_at", "min"),
        last_at=("planned_at", "max"),
        code_version=("code_version", "last"),
        method_version=("method_version", "last"),
    )
    return first.join(counts).sort_values("last_at", ascending=False).reset_index()


def diff(catalog: Catalog, before: When | int, after: When | int | None = None) -> pd.DataFrame:
    """What is different between two moments, one row per change, worst loss of coverage first.

    Parameters
    ----------
    catalog : Catalog
    before, after : datetime, str or int
        A moment, or a version of `transfers`; `after` is now where it is not said.

    Returns
    -------
    DataFrame
        demonstration_id, target_id, preset, change (added, replanned, gone), why (which inputs
        changed), and for each measure its value before, after, and the difference.
    """
    sides = [_current(catalog, before), _current(catalog, after)]
    joined = sides[0].merge(sides[1], how="outer", on=PAIR, suffixes=("_before", "_after"), indicator=True)
    replanned = joined["transfer_id_before"] != joined["transfer_id_after"]
    joined = joined[replanned].reset_index(drop=True)
    names = {"left_only": "gone", "right_only": "added", "both": "replanned"}
    changes = joined[PAIR].assign(change=joined["_merge"].map(names).astype(str), why=_why(joined))
    for name in _COMPARED:
        sides_of = [f"{name}_before", f"{name}_after"]
        changes[sides_of] = joined[sides_of]
        if name != "status":
            changes[f"{name}_change"] = joined[f"{name}_after"] - joined[f"{name}_before"]
    return changes.sort_values(["coverage_seen_pct_change", *PAIR], kind="stable").reset_index(drop=True)


def changed_structures(catalog: Catalog, since: When) -> pd.DataFrame:
    """Versions of structures that were added, changed or retired after a moment."""
    every = catalog.structures(every=True)
    return every[every["added_at"] > moment(since)].reset_index(drop=True)


def _current(catalog: Catalog, when: When | int | None) -> pd.DataFrame:
    version, as_of = (when, None) if isinstance(when, int) else (None, when)
    columns = ["transfer_id", *PAIR, *_METHOD, *(f"{name}_sha256" for name in _INPUTS), *_COMPARED]
    return catalog.transfers(version=version, as_of=as_of, columns=columns)


def _why(joined: pd.DataFrame) -> pd.Series:
    """Which inputs changed, in words; empty for what was added or is gone."""
    both = joined["_merge"] == "both"
    reasons = pd.Series("", index=joined.index, dtype=object)
    columns = {f"{name}_sha256": f"{name} changed" for name in _INPUTS} | _METHOD
    for column, words in columns.items():
        changed = both & (joined[f"{column}_before"] != joined[f"{column}_after"])
        reasons[changed] = reasons[changed].where(reasons[changed] == "", reasons[changed] + ", ") + words
    return reasons
