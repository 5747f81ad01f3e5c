"""Questions to the catalog, answered with pandas: rows, their history, and what changed between two moments.

Rows are only appended: what is current is the newest per name of those added until then, newest by commit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import reduce
from operator import and_
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.catalog.schema.rows import ADDED, Row
from upplied.catalog.schema.steps import checked
from upplied.catalog.schema.tables import MOMENT
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.verbs.ordering import COMMIT, NEWEST, PAIR
from upplied.errors import CatalogError, SettingsError
from upplied.records import Bools, Floats, Trajectory

if TYPE_CHECKING:
    from upplied.catalog.database import Catalog

When = datetime | str
Equal = Mapping[str, str | None]  # column -> its text; any where it is None

NAMED = ["transfer_id", "commit_id", *NEWEST]  # what tells a row of `transfers` from all others
_FEW = 0.25  # share of the rows up to which they are looked for by name
_FEW_ROWS = 10_000  # and so many at least: the rows to choose from may themselves be few of the table's


class Units(dict[str, str]):
    """The unit of each column; never changed, so that pandas, which copies it at every step, need not."""

    def __deepcopy__(self, memo: object) -> Units:
        return self


def frame(table: pa.Table) -> pd.DataFrame:
    """A DataFrame; the unit of each column is in ``frame.attrs["units"]``."""
    rows = table.to_pandas()
    units = ((field.name, field.metadata[b"unit"].decode()) for field in table.schema if field.metadata)
    rows.attrs["units"] = Units(units)
    return rows


def moment(when: When) -> pd.Timestamp:
    """A moment in UTC; a text without a zone is UTC."""
    try:
        stamp = pd.Timestamp(when)
    except ValueError:
        rule = "like 2026-11-21 or 2026-11-21T02:00:00Z"
        raise SettingsError(f"moment {when!r}", "cannot be read", rule) from None
    return stamp.tz_localize("UTC") if stamp.tzinfo is None else stamp.tz_convert("UTC")


def until(as_of: When | None) -> ds.Expression | None:
    """The rows that were added until a moment; all where none is asked for."""
    return None if as_of is None else pc.field("added_at") <= pa.scalar(moment(as_of), MOMENT)


class PlannedTrajectory(Trajectory):
    """A trajectory that can be asked for its pose at any time."""

    def at(self, t_s: float | Floats) -> Trajectory:
        """Poses at other times, s: linear in position, spherical in orientation; the ends are held."""
        from upplied.geometry import poses  # with scipy, which nothing else here needs

        return poses.interpolate(self, np.atleast_1d(np.asarray(t_s, float)))


def matching(equal: Equal, among: Mapping[str, Iterable[str] | None] | None = None) -> ds.Expression | None:
    """The rows whose columns are equal to these texts, or among these, where any are asked for."""
    parts = [pc.field(name) == value for name, value in equal.items() if value is not None]
    for name, values in (among or {}).items():
        parts += [] if values is None else [pc.field(name).isin(pa.array(list(values), pa.string()))]
    return reduce(and_, parts) if parts else None


def completed(
    table: StoredTable, plans: pd.DataFrame, columns: list[str], of: int, version: int | None = None
) -> pa.Table:
    """The `columns` columns of these rows (with `NAMED`), in their order, of a version that has `of` rows."""
    where = None
    if len(plans) < max(_FEW * of, _FEW_ROWS):
        where = pc.field("transfer_id").isin(pa.array(plans["transfer_id"].tolist(), pa.string()))
        oldest = plans["commit_version"].min() if len(plans) else -1
        if oldest >= 0:  # which spares files; of rows of schema version 1 it is null
            where &= pc.field("commit_version") >= int(oldest)
    more = table.narrow(list(dict.fromkeys([*NAMED, *columns])), where, version)
    return more.select(columns).take(pc.index_in(named(plans, NAMED), named(more, NAMED)))


def named(rows: pa.Table | pd.DataFrame, names: Sequence[str]) -> pa.Array:
    """Some columns of each row as one text."""
    if not isinstance(rows, pa.Table):
        rows = pa.Table.from_pandas(rows[[*names]], preserve_index=False)
    texts = []
    for column in (rows[name].combine_chunks() for name in names):
        plain = column.cast(MOMENT).cast(pa.int64()) if pa.types.is_timestamp(column.type) else column
        texts.append(plain.cast(pa.string()).fill_null(""))
    return pc.binary_join_element_wise(*texts, "\x1f")


def beginning(rows: pd.DataFrame, what: str, start: str) -> Row:
    """The newest row of the one flight or finding whose id begins so; none, or more than one, is an error."""
    ids = rows[f"{what}_id"]
    matches = rows[ids.str.startswith(start)].drop_duplicates(f"{what}_id", keep="last")
    if len(matches) != 1:
        known = ", ".join(ids.drop_duplicates().tail(5).str[:12]) or "none"
        words = "is not in the catalog" if matches.empty else f"may be {len(matches)}"
        raise CatalogError(f"{what} {start}", words, f"the last ones: {known}", f"see: upplied {what}s list")
    return {str(name): value for name, value in matches.iloc[0].items()}


def steps(table: StoredTable, row: Row) -> pa.Table:
    """The waypoints or poses that one row owns, in order; if not of its count and hash, an error."""
    declared = table.declared
    name, count = declared.names[0], row[f"n_{declared.name}"]
    if not count:
        return declared.schema.empty_table()
    own = (pc.field("commit_id") == row["commit_id"]) & (pc.field(name) == row[name])
    own_steps = table.read(own, commits=[row["commit_id"]])
    stated = {(row[name], row["commit_id"]): (count, row[f"{declared.name}_sha256"])}
    return checked(declared.name, own_steps.take(pc.sort_indices(own_steps["seq"])), stated)


def versions(table: StoredTable, equal: Equal, every: bool, as_of: When | None) -> pd.DataFrame:
    """Versions of each id counted in the order of commits, then narrowed to what was asked."""
    name = table.declared.names[0]
    versions = frame(table.read(until(as_of))).sort_values([name, *COMMIT], kind="stable")
    versions = versions[~_repeated(versions)]  # two writers may add the same version at once
    versions["version"] = versions.groupby(name).cumcount() + 1
    if not every:
        versions = versions.drop_duplicates(name, keep="last")
        versions = versions[~versions["retired"].astype(bool)]
    for column, value in equal.items():
        if value is not None:
            versions = versions[versions[column] == value]
    return versions.reset_index(drop=True)


def _repeated(ordered: pd.DataFrame) -> Bools:
    """Which rows (N,) say the same as the one before, apart from when and by which commit they were added."""
    names = ordered.iloc[:, 0]
    again = np.flatnonzero(names == names.shift())  # versions of one id, which are few
    repeated = np.zeros(len(ordered), bool)
    if len(again):
        pairs = (ordered.iloc[at].drop(columns=list(ADDED)) for at in (again, again - 1))
        now, before = (each.reset_index(drop=True) for each in pairs)
        repeated[again] = ((now == before) | (now.isna() & before.isna())).all(axis=1)
    return repeated


_INPUTS = ("demonstration", "source", "target", "settings")
_METHOD = {"method_version": "method", "sources_sha256": "planning sources", "libraries": "libraries"}
_COMPARED = (
    "status", "coverage_inspected_pct", "coverage_seen_pct", "coverage_paper_pct", "min_clearance_m",
    "frechet_z", "duration_s",
)  # fmt: skip


def history(catalog: Catalog, limit: int | None = None) -> pd.DataFrame:
    """Commits that logs still have, or `limit`, newest first: when, table, its version, what, rows added."""
    commits = []
    for name, table in catalog.tables.items():
        delta = table.delta()
        for commit in delta.history(limit) if delta is not None else []:
            at = pd.Timestamp(commit["timestamp"], unit="ms", tz="UTC")
            operation = str(commit.get("doing", commit.get("operation", ""))).lower()
            operation = {"write": "add", "create table": "create"}.get(operation, operation)
            commits.append((at, name, int(commit["version"]), operation, int(commit.get("rows", 0))))
    listed = pd.DataFrame(commits, columns=["at", "table", "version", "operation", "rows_added"])
    return listed.sort_values(["at", "table"], ascending=False, kind="stable", ignore_index=True)[:limit]


def runs(catalog: Catalog) -> pd.DataFrame:
    """Runs that planned, newest first: when, how many plans of which outcome, by which code."""
    columns = ["run_id", "status", "planned_at", "code_version", "method_version"]
    rows = catalog.transfers(every=True, columns=columns)
    counts = pd.crosstab(rows["run_id"], rows["status"])
    counts = counts.reindex(columns=["ok", "refused", "failed"], fill_value=0)
    moments = {"first_at": ("planned_at", "min"), "last_at": ("planned_at", "max")}
    first = rows.groupby("run_id").agg(**moments, **{name: (name, "last") for name in columns[3:]})
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
    why = pd.Series("", index=joined.index, dtype=object)  # which inputs changed, in words
    for column, name in ({f"{name}_sha256": name for name in _INPUTS} | _METHOD).items():
        changed = (joined["_merge"] == "both") & (joined[f"{column}_before"] != joined[f"{column}_after"])
        why[changed] += f", {name} changed"
    changes = joined[PAIR].assign(
        change=joined["_merge"].map(names).astype(str), why=why.str.removeprefix(", ")
    )
    for name in _COMPARED:
        before_after = [f"{name}_before", f"{name}_after"]
        changes[before_after] = joined[before_after]
        if name != "status":
            changes[f"{name}_change"] = joined[f"{name}_after"] - joined[f"{name}_before"]
    return changes.sort_values(["coverage_seen_pct_change", *PAIR], kind="stable").reset_index(drop=True)


def _current(catalog: Catalog, when: When | int | None) -> pd.DataFrame:
    version, as_of = (when, None) if isinstance(when, int) else (None, when)
    columns = ["transfer_id", *PAIR, *_METHOD, *(f"{name}_sha256" for name in _INPUTS), *_COMPARED]
    return catalog.transfers(version=version, as_of=as_of, columns=columns)
