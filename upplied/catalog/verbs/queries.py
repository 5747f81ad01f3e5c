"""Questions to the catalog, answered with pandas.

Rows are only ever appended. What is current, and how the catalog stood at an earlier moment, are
therefore questions over the rows themselves: the newest per name, among those added until then. Newest
is what the latest commit brought; the clocks of those who wrote are not asked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.catalog.schema import rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.verbs.frames import Units, When, decoded, frame, moment, until
from upplied.catalog.verbs.ordering import NEWEST, SLOT, in_order, retired
from upplied.catalog.verbs.standing import DERIVED, Standing, standing_of, with_states
from upplied.errors import CatalogError, SettingsError
from upplied.records import Floats, Trajectory

if TYPE_CHECKING:
    import pandas as pd

_NAMED = ["transfer_id", "commit_id", *NEWEST]  # what tells a row of `transfers` from all others
_FEW = 0.25  # share of the rows up to which they are looked for by name
_FEW_ROWS = 10_000  # and so many at least: the rows to choose from may themselves be few of the table's


class PlannedTrajectory(Trajectory):
    """A trajectory that can be asked for its pose at any time."""

    def at(self, t_s: float | Floats) -> Trajectory:
        """Poses at other times, s: linear in position, spherical in orientation; the ends are held."""
        from upplied import poses  # with scipy, which nothing else here needs

        return poses.interpolate(self, np.atleast_1d(np.asarray(t_s, float)))


@dataclass(frozen=True)
class Which:
    """Which rows of `transfers`.

    With `every` false, only the newest plan of each demonstration, target and preset that was made for
    `purpose` is considered, and `status` and `since` then choose among those.
    """

    kind: str | None = None
    site: str | None = None  # of the target
    structure: str | None = None  # the target
    demonstration: str | None = None
    preset: str | None = None
    status: str | None = None
    since: When | None = None  # planned at or after
    as_of: When | None = None
    version: int | None = None  # of the table, as `history` lists them
    every: bool = False  # older plans of a pair as well
    columns: Sequence[str] | None = None
    purpose: str = ""  # as in the table: experiments and gaps are asked for by name
    ids: Sequence[str] | None = None  # only these plans are considered
    in_force: bool = False  # the plans that a person released, instead of the newest


def transfers(tables: Mapping[str, StoredTable], which: Which) -> pd.DataFrame:
    """Rows of `transfers`, ordered by demonstration, target, preset and time.

    Which rows those are is told from a few columns, with which those that are named are read; of all that a
    table has, the others are read of these rows alone.
    """
    import pandas as pd

    declared = TABLES["transfers"]
    wanted = declared.names if which.columns is None else _known_columns(declared.names, which.columns)
    derived = which.in_force or bool({*DERIVED} & {*wanted})
    now = standing_of(decided(tables["decisions"], _as_of(tables, which))) if derived else Standing()
    asked = [*_NAMED, *SLOT, *NEWEST, "status", "added_at"]
    asked += [] if which.columns is None else [name for name in wanted if name not in DERIVED]
    columns = [name for name in declared.names if name in asked]
    where = _pair_filter(tables, which, now)
    table = tables["transfers"].narrow(columns, where, which.version)
    if which.as_of is not None:
        table = table.filter(until("added_at", which.as_of))
    newest = not (which.every or which.in_force)
    found = frame(decoded(in_order(table, newest=newest)))
    if derived:
        found = with_states(found.assign(**dict.fromkeys(DERIVED)), now)
    if which.in_force:
        found = found[found["state"] == "released"]
    if not which.every:
        if not which.in_force or which.purpose:
            found = found[found["purpose"] == which.purpose]
        found = _in_use(tables, found, which)
    if which.status is not None:
        found = found[found["status"] == which.status]
    if which.since is not None:
        found = found[found["planned_at"] >= moment(which.since)]
    rest = [name for name in wanted if name not in found]
    if rest:
        more = completed(tables["transfers"], found, rest, len(table), which.version)
        found = pd.concat([found.reset_index(drop=True), frame(decoded(more))], axis=1)
    made = found[list(wanted)].reset_index(drop=True)
    made.attrs["units"] = Units((c.name, c.unit) for c in declared.columns if c.name in made)
    return made


def completed(
    table: StoredTable, found: pd.DataFrame, wanted: list[str], of: int, version: int | None = None
) -> pa.Table:
    """More columns of these rows, in their order; texts that repeat are kept once.

    Parameters
    ----------
    table : StoredTable
    found : DataFrame
        Rows with what names each (`_NAMED`).
    wanted : sequence of str
    of : int
        How many rows there are to choose from.
    version : int, optional
        Of the table.
    """
    import pandas as pd

    where = None
    if len(found) < max(_FEW * of, _FEW_ROWS):
        where = pc.field("transfer_id").isin(pa.array(found["transfer_id"].tolist(), pa.string()))
        oldest = found["commit_version"].min() if len(found) else -1
        if oldest >= 0:  # which spares files; of rows of schema version 1 it is null
            where &= pc.field("commit_version") >= int(oldest)
    more = table.narrow(list(dict.fromkeys([*_NAMED, *wanted])), where, version)
    names = frame(decoded(more.select(_NAMED)))
    first = ~names.duplicated().to_numpy()  # one commit of an older program might bring a row twice
    place = pd.MultiIndex.from_frame(names[first]).get_indexer(pd.MultiIndex.from_frame(found[_NAMED]))
    return more.select(wanted).take(pa.array(np.flatnonzero(first)[place]))


def decided(table: StoredTable, as_of: When | None = None) -> list[Row]:
    """The decisions until a moment, in the order of commits."""
    found = rows.rows_of(table.read(until("added_at", as_of)))
    return sorted(found, key=lambda row: row["commit_version"])


def steps(table: StoredTable, row: Row) -> pa.Table:
    """The waypoints or poses that one row owns, in order.

    Raises
    ------
    CatalogError
        If they are not as many as the row says, or not those whose hash it keeps: one changed bit is
        another flight.
    """
    declared = table.declared
    name, count = declared.names[0], row[f"n_{declared.name}"]
    if not count:
        return declared.schema.empty_table()
    own = (pc.field("commit_id") == row["commit_id"]) & (pc.field(name) == row[name])
    found = table.read(own, commits=[row["commit_id"]])
    found = found.take(pc.sort_indices(found["seq"]))
    what, remedy = f"{declared.name} of {row[name]}", "take the damaged files from a backup"
    if len(found) != count:
        raise CatalogError(what, f"{len(found)} steps are stored, the row says {count}", "", remedy)
    hashes = {(row[name], row["commit_id"]): row[f"{declared.name}_sha256"]}
    for _, wrong in unlike(declared.name, found, hashes):
        raise CatalogError(what, wrong, "", remedy)
    return found


def versions(
    table: StoredTable, equal: Mapping[str, str | None], every: bool, as_of: When | None
) -> pd.DataFrame:
    """Versions of each id counted in the order of commits, then narrowed to what was asked."""
    name = table.declared.names[0]
    found = frame(table.read(until("added_at", as_of))).sort_values(
        [name, "commit_version", "added_at", "commit_id"], kind="stable"
    )
    found = found[~_repeated(found)]  # two writers may add the same version at once
    found["version"] = found.groupby(name).cumcount() + 1
    if not every:
        found = found.drop_duplicates(name, keep="last")
        found = found[~found["retired"].astype(bool)]
    for column, value in equal.items():
        if value is not None:
            found = found[found[column] == value]
    return found.reset_index(drop=True)


def _repeated(ordered: pd.DataFrame) -> pd.Series:
    """Which rows say the same as the one before, apart from when and by which commit they were added."""
    said = ordered.drop(columns=list(rows.ADDED))
    before = said.shift()
    return ((said == before) | (said.isna() & before.isna())).all(axis=1)


def _pair_filter(tables: Mapping[str, StoredTable], which: Which, now: Standing) -> ds.Expression | None:
    """What may be left out before asking which plan of a pair is the newest."""
    parts = [
        pc.field(column) == value
        for column, value in (
            ("kind", which.kind),
            ("target_id", which.structure),
            ("demonstration_id", which.demonstration),
            ("preset", which.preset),
        )
        if value is not None
    ]
    if which.site is not None:
        there = versions(tables["structures"], {"site": which.site}, False, which.as_of)
        parts.append(pc.field("target_id").isin(list(there["structure_id"])))
    ids = [plan for plan, state in now.state.items() if state == "released"] if which.in_force else which.ids
    if ids is not None:
        parts.append(pc.field("transfer_id").isin(pa.array(ids, pa.string())))
    joined: ds.Expression | None = None
    for part in parts:
        joined = part if joined is None else joined & part
    return joined


def _in_use(tables: Mapping[str, StoredTable], found: pd.DataFrame, which: Which) -> pd.DataFrame:
    """Without the plans of demonstrations and targets that are retired, or were then."""
    as_of = _as_of(tables, which)
    used = [("structures", "target_id"), ("demonstrations", "demonstration_id")]
    for name, column in used[:1] if which.in_force else used:  # a released plan outlives its demonstration
        found = found[~found[column].isin(retired(tables[name], until("added_at", as_of)))]
    return found


def _as_of(tables: Mapping[str, StoredTable], which: Which) -> When | None:
    """The moment that is asked for, or that of the version."""
    if which.version is None:
        return which.as_of
    added = tables["transfers"].read(None, ["added_at"], which.version)["added_at"]
    return pc.max(added).as_py() if len(added) else None


def _known_columns(names: list[str], asked: Iterable[str]) -> list[str]:
    wanted = list(asked)
    for name in wanted:
        if name not in names:
            raise SettingsError(f"column {name!r}", "does not exist", f"one of {', '.join(names)}")
    return wanted
