"""What a catalog consists of, and the questions to it: tables, records, rows."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds

from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.steps import PHOTO_COLUMNS, photo_columns
from upplied.catalog.schema.tables import STEPS, TABLES
from upplied.catalog.store.cache import Cache
from upplied.catalog.store.clock import Clock
from upplied.catalog.store.contents import ContentStore
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.identity import Identity
from upplied.catalog.store.labels import FaceLabels
from upplied.catalog.store.looks import StoredLooks
from upplied.catalog.store.places import cache_folder, checked
from upplied.catalog.store.steps import StepTable
from upplied.catalog.store.surfaces import PHOTOS, REMEDY, SUPPOSED, SurfaceStore
from upplied.catalog.verbs import ordering, queries
from upplied.catalog.verbs.current import Current
from upplied.catalog.verbs.frames import When, frame
from upplied.catalog.verbs.queries import PlannedTrajectory, Which
from upplied.checks import check_id, suggested
from upplied.errors import CatalogError
from upplied.records import (
    Bools,
    Demonstration,
    Photos,
    Plan,
    Structure,
    SupposedSurface,
    SurfaceStates,
    Trajectory,
)

if TYPE_CHECKING:
    import pandas as pd

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
        remedy = "delete it and add the structure again"
        self.meshes = ContentStore(self.location, "meshes", Structure, remedy)
        self.surfaces = SurfaceStore(self.location)
        self.supposed_surfaces = ContentStore(self.location, SUPPOSED, SupposedSurface, REMEDY)
        self.plan_photos = ContentStore(self.location, PHOTOS, Photos, REMEDY)
        self.flown_paths = ContentStore(self.location, "flown", Trajectory, "fly the plan again")
        self.labels = ContentStore(self.location, "labels", FaceLabels, "require the zones again")
        self.looks = ContentStore(self.location, "looks", StoredLooks, "add the flight again")
        self._newest = {name: Current(self.tables[name]) for name in ("structures", "demonstrations")}
        self.cache = Cache(cache if cache is not None else cache_folder(self.location))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.location!r})"

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
        wanted = {"structure_id": structure, "site": site}
        return queries.versions(self.tables["demonstrations"], wanted, every, as_of)

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
        kind, site, structure : str, optional
            Of the target.
        demonstration, preset : str, optional
        status : {"ok", "refused", "failed"}, optional
            Of the newest plan: a pair whose newest plan is refused has none that is ok.
        since : datetime or str, optional
            Planned at this moment or later.
        as_of : datetime or str, optional
            As the catalog stood at that moment.
        version : int, optional
            As of a version of the table, as `history` lists them; `vacuum` says how far back.
        every : bool
            Older plans of each pair as well.
        columns : sequence of str, optional
            Only these are read.
        purpose : str
            Of the newest: those of an experiment (``experiment NAME``) or of a gap (``gap FLIGHT``), which
            are never among the others.
        ids : sequence of str, optional
            Only these plans are considered.
        in_force : bool
            The plans that a person released and that are in force, instead of the newest.
        """
        which = Which(
            kind, site, structure, demonstration, preset, status, since, as_of, version, every, columns,
            purpose, ids, in_force,
        )  # fmt: skip
        return queries.transfers(self.tables, which)

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        """The steps of one planned trajectory, in order."""
        return frame(queries.steps(self.tables["waypoints"], self.transfer(transfer_id, OWNER)))

    def poses(self, demonstration_id: str) -> pd.DataFrame:
        """The steps of the current version of one demonstration, in order."""
        return frame(queries.steps(self.tables["poses"], self.newest("demonstrations", demonstration_id)))

    def path_of(self, row: Row) -> PlannedTrajectory:
        """The trajectory of one row of `transfers`, whether it may be flown or not."""
        transfer_id = row["transfer_id"]
        if not row["n_waypoints"]:
            raise CatalogError(
                f"transfer {transfer_id}", f"has no trajectory: it is {row['status']}: {row['reason']}"
            )
        path = plan_rows.trajectory_of(queries.steps(self.tables["waypoints"], row))
        return PlannedTrajectory(path.t_s, path.positions, path.quat_xyzw, path.fov_deg)

    def structure(self, structure_id: str) -> Structure:
        """The current version of one structure, complete."""
        return self.structure_of(self.newest("structures", structure_id))

    def structure_of(self, row: Row) -> Structure:
        """The structure of one row of `structures`, of any version."""
        return rows.structure_of(row, self.meshes.get(row["mesh_sha256"]))

    def demonstration(self, demonstration_id: str) -> Demonstration:
        """The current version of one demonstration, complete."""
        return self.demonstration_of(self.newest("demonstrations", demonstration_id))

    def demonstration_of(self, row: Row) -> Demonstration:
        """The demonstration of one row of `demonstrations`, of any version."""
        return rows.demonstration_of(row, queries.steps(self.tables["poses"], row))

    def plan(self, transfer_id: str) -> Plan:
        """One plan as it was made, but for what it sees of the surface; see `surface`."""
        row = self.transfer(transfer_id)
        plan = plan_rows.plan_of(row, queries.steps(self.tables["waypoints"], row))
        return replace(plan, supposed=self.supposed(transfer_id))

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        """What one plan sees of its target; None where it was not kept."""
        sha256 = self.transfer(transfer_id, ("surface_sha256",))["surface_sha256"]
        if sha256:
            return self.surfaces.get(sha256)
        return self.cache.get("surface", SurfaceStates, transfer_id, nameless=True)  # of version 0.1.0

    def faces_labelled(self, structure: Structure, sha256: str, label: str) -> Bools:
        """Which faces (T,) of a structure have a label of those that are kept under a hash."""
        return self.labels.get(sha256).faces(structure, label)

    def inspected(self, transfer_id: str) -> SurfaceStates | None:
        """What of its source structure the demonstration of a plan was about; None where it was not kept."""
        sha256 = self.transfer(transfer_id, ("inspected_sha256",))["inspected_sha256"]
        return self.surfaces.get(sha256) if sha256 else None

    def photos(self, transfer_id: str) -> pd.DataFrame:
        """The photos of a plan, one a row in the order of flight; none of a plan from a film.

        Columns ``t_s``, ``x_m`` to ``z_m``, ``qx`` to ``qw`` (camera to structure), ``patches`` that it shows
        sharply, ``gsd_mm`` and ``blur_px``, medians over these, and ``overlap_pct`` with the one before.
        """
        import pandas as pd

        sha256 = self.transfer(transfer_id, ("photos_sha256",))["photos_sha256"]
        found = self.plan_photos.get(sha256) if sha256 else None
        columns: dict[str, Any] = {} if found is None else photo_columns(found)
        return pd.DataFrame(columns, columns=list(PHOTO_COLUMNS))

    def supposed(self, transfer_id: str) -> SupposedSurface | None:
        """Surface of a plan's target that nobody scanned, where it is supposed to be; None where none is.

        As the plan was made, or of the target as it is since, where the plan was judged again on that.
        """
        plan = pc.field("transfer_id") == transfer_id
        again = self.tables["decisions"].read(plan & (pc.field("state") == "rechecked"))
        row = self.transfer(transfer_id, ("supposed_sha256",))
        last = max(rows.rows_of(again), key=lambda one: one["commit_version"], default=row)
        sha256 = last["supposed_sha256"]
        return self.supposed_surfaces.get(sha256) if sha256 else None

    def flights(
        self, transfer_id: str | None = None, *, structure: str | None = None, kind: str | None = None
    ) -> pd.DataFrame:
        """Flights of plans, flown and simulated, in the order they were added.

        Parameters
        ----------
        transfer_id, structure : str, optional
            Those of one plan, or round one structure.
        kind : {"flown", "simulated"}, optional
        """
        rows = self._of_plans("flights", transfer_id)
        rows["kind"] = rows["kind"].where(rows["kind"] != "", "simulated")
        if structure is not None:
            rows = rows[rows["target_id"] == structure]
        if kind is not None:
            rows = rows[rows["kind"] == kind]
        return rows.reset_index(drop=True)

    def overruled(self, transfer_id: str | None = None) -> pd.DataFrame:
        """Rules of the gate that a person overruled, in the order they were added; of one plan, or all."""
        return self._of_plans("overruled", transfer_id)

    def _of_plans(self, name: str, transfer_id: str | None) -> pd.DataFrame:
        """Rows of a table that name plans, in the order they were added; of one plan, or all."""
        where = None if transfer_id is None else pc.field("transfer_id") == transfer_id
        return self.by_commit(name, where, ["transfer_id", "commit_version"])

    def by_commit(
        self, name: str, where: ds.Expression | None = None, order: Sequence[str] = ("commit_version",)
    ) -> pd.DataFrame:
        """Rows of a table that fit, in the order they were added."""
        rows = frame(self.tables[name].read(where)).sort_values(list(order), kind="stable")
        return rows.reset_index(drop=True)

    def flown(self, flight_sha256: str) -> Trajectory:
        """The path of one flight, by the hash in its row."""
        return self.flown_paths.get(flight_sha256)

    def transfer(self, transfer_id: str, columns: Sequence[str] | None = None) -> Row:
        """The row of one plan; only the columns that are named."""
        check_id(transfer_id, "transfer id")
        wanted = None if columns is None else list(dict.fromkeys([*columns, *ordering.STANDING]))
        found = self.tables["transfers"].read(pc.field("transfer_id") == transfer_id, wanted)
        if not len(found):
            raise CatalogError(
                f"transfer {transfer_id}",
                "is not in the catalog",
                suggested(transfer_id, self._transfer_ids(), 0),
                "see: upplied catalog transfers",
            )
        return ordering.standing(rows.rows_of(found))

    def newest(self, table: str, name: str) -> Row:
        """The row of the current version of one structure or demonstration, retired or not."""
        column = TABLES[table].names[0]
        check_id(name, column.replace("_", " "))
        found = self._newest[table].row(name)
        if found is None:
            known = self.tables[table].read(None, [column])[column].to_pylist()
            what = f"{table.removesuffix('s')} {name}"
            raise CatalogError(what, "is not in the catalog", suggested(name, set(known)))
        return found

    def find_transfer(self, start: str) -> str:
        """The id of the one plan whose id begins so; a whole id is found at once.

        Raises
        ------
        CatalogError
            If there is none, or more than one.
        """
        check_id(start, "transfer id")
        if len(self.tables["transfers"].read(pc.field("transfer_id") == start, ["transfer_id"])):
            return start
        every = self._transfer_ids()
        matches = [name for name in every if name.startswith(start)]
        if len(matches) == 1:
            return matches[0]
        what = f"transfer {start}"
        if matches:
            raise CatalogError(what, f"may be {len(matches)}: {', '.join(matches[:5])}")
        known = suggested(start, every, 0)
        raise CatalogError(what, "is not in the catalog", known, "see: upplied catalog transfers")

    def _transfer_ids(self) -> list[str]:
        return sorted(
            self.tables["transfers"].read(None, ["transfer_id"])["transfer_id"].unique().to_pylist()
        )

    def settled(
        self, keys: Iterable[str], *, retry_failed: bool = False, run_id: str = ""
    ) -> dict[str, tuple[str, str]]:
        """Those of the keys that need no planning, each with status and reason of its plan.

        A key is settled when the plan of that key is the current one of its demonstration, target and
        preset: one that was followed by another, as by one of other settings, is not.

        Parameters
        ----------
        keys : iterable of str
        retry_failed : bool
            Failures are not settled, but for those of the run `run_id`.
        run_id : str
        """
        wanted = list(dict.fromkeys(keys))
        ids = ordering.ids_of(wanted)
        plans = ordering.settled_plans(self.tables["transfers"], ids, retry_failed, run_id, ["reason"])
        places = pc.index_in(ids, plans["transfer_id"].combine_chunks())
        once: dict[tuple[str, str], tuple[str, str]] = {}  # few, of many plans
        outcomes = [
            once.setdefault(outcome, outcome)
            for outcome in zip(plans["status"].to_pylist(), plans["reason"].to_pylist(), strict=True)
        ]
        return {
            key: outcomes[at] for key, at in zip(wanted, places.to_pylist(), strict=True) if at is not None
        }

    def unsettled(self, keys: pa.Array, *, retry_failed: bool = False) -> Bools:
        """Which of an array of keys are not `settled`, (N,); for as many as a large fleet has."""
        ids = ordering.ids_of(keys)
        plans = ordering.settled_plans(self.tables["transfers"], ids, retry_failed, "", [])
        return ~pc.is_in(ids, plans["transfer_id"].combine_chunks()).to_numpy(zero_copy_only=False)

    def newest_plans(self, columns: Sequence[str]) -> pa.Table:
        """The newest plan of each demonstration, target and preset, and its id; repeated texts are kept once.

        Of retired demonstrations and targets as well.
        """
        read = ["transfer_id", *ordering.SLOT, *ordering.NEWEST, "status", *columns]
        plans = ordering.in_order(self.tables["transfers"].narrow(list(dict.fromkeys(read))), newest=True)
        return plans.filter(pc.equal(plans["purpose"], "")).select(["transfer_id", *columns])

    def create(self) -> Self:
        """Make the catalog where there is none yet; adding does so as well."""
        self.identity.made()
        return self
