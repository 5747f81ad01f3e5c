"""What a catalog consists of, and the questions to it: tables, records, rows."""

import os
from collections.abc import Sequence
from typing import Any, Self

import pandas as pd
import pyarrow.compute as pc

from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.tables import STEPS, TABLES
from upplied.catalog.store.chain import decoded
from upplied.catalog.store.contents import CONTENTS, Cache, ContentStore, SurfaceStore
from upplied.catalog.store.delta import StepTable, StoredTable
from upplied.catalog.store.files import FileStore, cache_folder, checked
from upplied.catalog.store.opening import Clock, Identity
from upplied.catalog.verbs import ordering, queries
from upplied.catalog.verbs.ordering import DERIVED, Standing, standing_of, with_states
from upplied.catalog.verbs.queries import PlannedTrajectory, Units, When, frame, moment, until
from upplied.checks import check_id, suggested
from upplied.errors import CatalogError, SettingsError
from upplied.records import Demonstration, Structure

#: What of a plan's row says which waypoints are its own.
OWNER = ("transfer_id", "commit_id", "n_waypoints", "waypoints_sha256", "status", "reason", "planned_at")


class Reading:
    """The tables and files of a catalog, and the questions to them; see `upplied.catalog.Catalog`."""

    def __init__(self, location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> None:
        self.location = checked(os.fspath(location))
        self.clock = Clock(self.location)
        self.identity = Identity(self.location, list(TABLES))
        self.tables = {
            name: (StepTable if name in STEPS else StoredTable)(self.location, table, self.identity)
            for name, table in TABLES.items()
        }
        self.contents = {name: ContentStore[Any](self.location, name) for name in CONTENTS}
        self.surfaces = SurfaceStore(self.contents["surfaces"], self.contents["samples"])
        self.looks = self.contents["looks"]
        self.shards = FileStore(f"{self.location}/shards")  # jobs of runs at work
        self._newest = {name: ordering.Current(self.tables[name]) for name in ("structures", STEPS["poses"])}
        self.cache = Cache(cache if cache is not None else cache_folder(self.location))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.location!r})"

    def create(self) -> Self:
        """Make the catalog where there is none yet; adding does so as well."""
        self.identity.name()
        return self

    def structures(
        self,
        *,
        kind: str | None = None,
        site: str | None = None,
        every: bool = False,
        as_of: When | None = None,
    ) -> pd.DataFrame:
        """Structures, the current version of each; with `every`, older and retired versions as well."""
        return queries.versions(self.tables["structures"], {"kind": kind, "site": site}, every, as_of)

    def demonstrations(
        self,
        *,
        structure: str | None = None,
        site: str | None = None,
        every: bool = False,
        as_of: When | None = None,
    ) -> pd.DataFrame:
        """Demonstrations, the current version of each; with `every`, older and retired ones as well."""
        equal = {"structure_id": structure, "site": site}
        return queries.versions(self.tables["demonstrations"], equal, every, as_of)

    def transfers(
        self,
        *,
        kind: str | None = None,
        site: str | None = None,
        structure: str | None = None,
        demonstration: str | None = None,
        preset: str | None = None,
        status: str | None = None,
        since: When | None = None,
        as_of: When | None = None,
        version: int | None = None,
        every: bool = False,
        columns: Sequence[str] | None = None,
        purpose: str = "",
        ids: Sequence[str] | None = None,
        in_force: bool = False,
    ) -> pd.DataFrame:
        """Plans: the newest of each demonstration, target and preset, whether released or not.

        Parameters
        ----------
        kind, site, structure, demonstration, preset : str, optional
            The first three of the target.
        status : {"ok", "refused", "failed"}, optional
            Of the newest plan: a pair whose newest plan is refused has none that is ok.
        since, as_of : datetime or str, optional
            Planned at this moment or later; as the catalog stood at that moment.
        version : int, optional
            As of a version of the table, as `history` lists them; `vacuum` says how far back.
        every, in_force : bool
            Older plans of each pair as well; or those that a person released and that are in force.
        columns, ids : sequence of str, optional
            Only these are read; only these plans are considered.
        purpose : str
            Of the newest: those of an experiment (``experiment NAME``) or of a gap (``gap FLIGHT``), which
            are never among the others.
        """
        # Which rows those are is told from a few columns; the others are read of these rows alone.
        declared, tables = TABLES["transfers"], self.tables
        columns_read = declared.names if columns is None else list(columns)
        if unknown := [name for name in columns_read if name not in declared.names]:
            known = f"one of {', '.join(declared.names)}"
            raise SettingsError(f"column {unknown[0]!r}", "does not exist", known)
        if version is not None:  # its moment; none where it has no rows
            as_of = pc.max(tables["transfers"].read(None, ["added_at"], version)[0]).as_py()
        derived = in_force or not {*DERIVED}.isdisjoint(columns_read)
        until_then = until(as_of)
        now = standing_of(ordering.by_commit(tables["decisions"].read(until_then))) if derived else Standing()
        if in_force:
            among = now.state.keys() if ids is None else {*ids}
            ids = [plan for plan, state in now.state.items() if state == "released" and plan in among]
        there = None if site is None else self.structures(site=site, as_of=as_of)["structure_id"]
        where = queries.matching(
            {"kind": kind, "target_id": structure, "demonstration_id": demonstration, "preset": preset},
            {"target_id": there, "transfer_id": ids},
        )
        few = {*queries.NAMED, *ordering.ORDERED, "added_at"}
        few |= set() if columns is None else {*columns_read} - {*DERIVED}
        table = tables["transfers"].narrow([name for name in declared.names if name in few], where, version)
        if as_of is not None:
            table = table.filter(until_then)
        plans = frame(decoded(ordering.in_order(table, newest=not (every or in_force))))
        if derived:
            plans = with_states(plans.assign(**dict.fromkeys(DERIVED)), now)
        if in_force:
            plans = plans[plans["state"] == "released"]
        if not every:
            if purpose or not in_force:
                plans = plans[plans["purpose"] == purpose]
            used = [("structures", "target_id"), ("demonstrations", "demonstration_id")]
            for name, column in used[:1] if in_force else used:  # a released plan outlives its demonstration
                gone = ordering.retired(tables[name], until_then)
                plans = plans[~plans[column].isin(gone)] if gone else plans
        if status is not None:
            plans = plans[plans["status"] == status]
        if since is not None:
            plans = plans[plans["planned_at"] >= moment(since)]
        if rest := [name for name in columns_read if name not in plans]:
            more = queries.completed(tables["transfers"], plans, rest, len(table), version)
            plans = pd.concat([plans.reset_index(drop=True), frame(decoded(more))], axis=1)
        plans = plans[list(columns_read)].reset_index(drop=True)
        plans.attrs["units"] = Units((c.name, c.unit) for c in declared.columns if c.name in plans)
        return plans

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        """The steps of one planned trajectory, in order."""
        return frame(queries.steps(self.tables["waypoints"], self.transfer(transfer_id, OWNER)))

    def poses(self, demonstration_id: str) -> pd.DataFrame:
        """The steps of the current version of one demonstration, in order."""
        return frame(queries.steps(self.tables["poses"], self.newest("demonstrations", demonstration_id)))

    def path_of(self, row: Row) -> PlannedTrajectory:
        """The trajectory of one row of `transfers`, whether it may be flown or not."""
        if not row["n_waypoints"]:
            fault = f"has no trajectory: it is {row['status']}: {row['reason']}"
            raise CatalogError(f"transfer {row['transfer_id']}", fault)
        path = plan_rows.trajectory_of(queries.steps(self.tables["waypoints"], row))
        return PlannedTrajectory(path.t_s, path.positions, path.quat_xyzw, path.fov_deg)

    def structure(self, structure_id: str) -> Structure:
        """The current version of one structure, complete."""
        return self.structure_of(self.newest("structures", structure_id))

    def structure_of(self, row: Row) -> Structure:
        """The structure of one row of `structures`, of any version."""
        return rows.structure_of(row, self.contents["meshes"].get(row["mesh_sha256"]))

    def demonstration(self, demonstration_id: str) -> Demonstration:
        """The current version of one demonstration, complete."""
        return self.demonstration_of(self.newest("demonstrations", demonstration_id))

    def demonstration_of(self, row: Row) -> Demonstration:
        """The demonstration of one row of `demonstrations`, of any version."""
        return rows.demonstration_of(row, queries.steps(self.tables["poses"], row))

    def flights(
        self, transfer_id: str | None = None, *, structure: str | None = None, kind: str | None = None
    ) -> pd.DataFrame:
        """Flights of a plan, or round a structure, as added; of `kind` ``flown``, ``simulated``, or both."""
        flights = self.by_commit("flights", ["transfer_id"], transfer_id=transfer_id, target_id=structure)
        flights["kind"] = flights["kind"].where(flights["kind"] != "", "simulated")
        return flights if kind is None else flights[flights["kind"] == kind].reset_index(drop=True)

    def flight(self, start: str) -> Row:
        """The newest row of the one flight whose id begins so; none, or more than one, is an error."""
        return queries.beginning(self.flights(), "flight", start)

    def overruled(self, transfer_id: str | None = None) -> pd.DataFrame:
        """Rules of the gate that a person overruled, in the order they were added; of one plan, or all."""
        return self.by_commit("overruled", ["transfer_id"], transfer_id=transfer_id)

    def by_commit(self, name: str, first: Sequence[str] = (), **equal: str | None) -> pd.DataFrame:
        """Rows of a table with these values, in the order they were added, or by some columns `first`."""
        rows = frame(self.tables[name].read(queries.matching(equal)))
        return rows.sort_values([*first, "commit_version"], kind="stable").reset_index(drop=True)

    def transfer(self, transfer_id: str, columns: Sequence[str] | None = None) -> Row:
        """The row of one plan; only the columns that are named."""
        check_id(transfer_id, "transfer id")
        fields = None if columns is None else list(dict.fromkeys([*columns, *ordering.ORDERED]))
        same_id = self.tables["transfers"].read(pc.field("transfer_id") == transfer_id, fields)
        if not len(same_id):
            raise self._unknown(transfer_id)
        return dict(ordering.in_order(same_id, newest=False).to_pylist()[0])

    def find_transfer(self, start: str) -> str:
        """The id of the one plan whose id begins so; none, or more than one, is an error."""
        check_id(start, "transfer id")
        if len(self.tables["transfers"].read(pc.field("transfer_id") == start, ["transfer_id"])):
            return start  # without a look at all ids
        if not (matches := [name for name in self._ids("transfers") if name.startswith(start)]):
            raise self._unknown(start)
        if len(matches) > 1:
            raise CatalogError(f"transfer {start}", f"may be {len(matches)}: {', '.join(matches[:5])}")
        return matches[0]

    def _unknown(self, transfer_id: str) -> CatalogError:
        known = suggested(transfer_id, self._ids("transfers"), 0)
        what, remedy = f"transfer {transfer_id}", "see: upplied catalog transfers"
        return CatalogError(what, "is not in the catalog", known, remedy)

    def newest(self, table: str, name: str) -> Row:
        """The row of the current version of one structure or demonstration, retired or not."""
        check_id(name, TABLES[table].names[0].replace("_", " "))
        if (row := self._newest[table].row(name)) is None:
            what = f"{table.removesuffix('s')} {name}"
            raise CatalogError(what, "is not in the catalog", suggested(name, self._ids(table)))
        return row

    def _ids(self, table: str) -> list[str]:
        column = TABLES[table].names[0]
        return sorted(self.tables[table].read(None, [column])[column].unique().to_pylist())
