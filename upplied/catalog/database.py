"""The catalog: what is kept of structures, demonstrations and plans, and the way in and out.

A commit is whole or it is not there. The rows of `waypoints` and `poses` are committed before the
row that names them, and that row says by which commit they came, so nobody ever reads a trajectory
without its points, or with the points of a writer that was stopped half-way.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.cache import Cache
from upplied.catalog.store.clock import Clock
from upplied.catalog.store.contents import ContentStore
from upplied.catalog.store.current import Current
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.identity import Identity
from upplied.catalog.store.looks import StoredLooks
from upplied.catalog.store.meshes import MeshStore
from upplied.catalog.store.places import cache_folder, checked
from upplied.catalog.store.surfaces import SurfaceStore
from upplied.catalog.verbs import adding, belonging, decisions, looks, queries, required
from upplied.catalog.verbs.adding import Planned
from upplied.catalog.verbs.leaving import ASKED, check_leaves
from upplied.catalog.verbs.queries import PlannedTrajectory, When, Which
from upplied.checks import check_id, suggested
from upplied.errors import CatalogError
from upplied.records import Demonstration, Plan, Structure, SurfaceStates, Trajectory

if TYPE_CHECKING:
    import pandas as pd

#: What of a plan's row says which waypoints are its own.
_OWNER = ("transfer_id", "commit_id", "n_waypoints", "waypoints_sha256", "status", "reason", "planned_at")


def open_catalog(location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> Catalog:
    """Open a catalog; a new one is made when the first row is added, and asking before is an error.

    Parameters
    ----------
    location : path or str
        A folder, or the URI of an object store (``s3://bucket/prefix``). Credentials and endpoint of
        a store are read from the environment (``AWS_ACCESS_KEY_ID``, ``AWS_ENDPOINT_URL``, ...) only.
    cache : path, optional
        Folder of the cache; by default ``cache/`` in the catalog's folder, and for an object store
        a folder in the user's cache directory.

    Examples
    --------
    >>> catalog = open_catalog("catalog")              # doctest: +SKIP
    >>> catalog.transfers(kind="airliner").head()      # doctest: +SKIP
    """
    return Catalog(location, cache)


class Catalog:
    """A catalog at a location; see `open_catalog`.

    Every question is answered with a DataFrame whose units are in ``frame.attrs["units"]``, or with
    a record. A moment may be a datetime or a text such as ``2026-11-21T02:00Z`` (UTC where no zone
    is said); `as_of` asks how the catalog stood then.
    """

    def __init__(self, location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> None:
        self.location = checked(os.fspath(location))
        self.clock = Clock(self.location)
        self.identity = Identity(self.location, list(TABLES))
        self.tables = {
            name: StoredTable(self.location, table, self.identity) for name, table in TABLES.items()
        }
        self.meshes = MeshStore(self.location)
        self.surfaces = SurfaceStore(self.location)
        self.flown_paths = ContentStore(self.location, "flown", Trajectory, "fly the plan again")
        self.looks = ContentStore(self.location, "looks", StoredLooks, "add the flight again")
        self._current = {name: Current(self.tables[name]) for name in ("structures", "demonstrations")}
        self.cache = Cache(cache if cache is not None else cache_folder(self.location))

    def __repr__(self) -> str:
        return f"Catalog({self.location!r})"

    # --- asking: tables ------------------------------------------------------------------------

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
        in_force : bool
            The plans that a person released and that are in force, instead of the newest.
        """
        which = Which(
            kind, site, structure, demonstration, preset, status, since, as_of, version, every, columns,
            purpose, in_force,
        )  # fmt: skip
        return queries.transfers(self.tables, which)

    def in_force(self, *, structure: str | None = None, kind: str | None = None) -> pd.DataFrame:
        """The plans in force, as `transfers` has them, with two columns more.

        `newer_draft` is the newest plan of the same pair and preset where that is another one, and
        `target_changed` tells that the structure is not as it was when the plan was last judged.
        """
        return decisions.in_force(self, structure=structure, kind=kind)

    def recalled(self, *, structure: str | None = None) -> pd.DataFrame:
        """Plans that were recalled and in whose place nobody released another."""
        return decisions.recalled(self, structure)

    def decisions(self, transfer_id: str | None = None) -> pd.DataFrame:
        """What was decided about plans, in the order of commits; about one, or all."""
        return decisions.decisions(self, transfer_id)

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        """The steps of one planned trajectory, in order."""
        return queries.frame(self._waypoints(self.transfer(transfer_id, _OWNER)))

    def poses(self, demonstration_id: str) -> pd.DataFrame:
        """The steps of the current version of one demonstration, in order."""
        return queries.frame(self._poses(self.newest("demonstrations", demonstration_id)))

    # --- asking: records -----------------------------------------------------------------------

    def trajectory(self, transfer_id: str, force: Collection[str] = ()) -> PlannedTrajectory:
        """One planned trajectory, to be flown; it can be asked for its pose at any time.

        Plans that may not be flown are looked at through `plan` and `waypoints`.

        Parameters
        ----------
        transfer_id : str
        force : collection of str
            Rules that are overruled: ``preset``, ``verdict``, ``rejected``, ``recalled``, ``superseded``
            (docs/checks.md).

        Raises
        ------
        CatalogError
            If the transfer is not known, or has no trajectory because it was refused or failed, or its
            steps are not those that were planned.
        RefusedError
            If it is for comparison, falls short of its floors, was rejected or
            recalled, or another took its place.
        """
        row = self.transfer(transfer_id, [*_OWNER, *ASKED])
        path = self.path_of(row)
        check_leaves(self, row, force)
        return path

    def path_of(self, row: Row) -> PlannedTrajectory:
        """The trajectory of one row of `transfers`, whether it may be flown or not."""
        transfer_id = row["transfer_id"]
        if not row["n_waypoints"]:
            raise CatalogError(
                f"transfer {transfer_id}", f"has no trajectory: it is {row['status']}: {row['reason']}"
            )
        path = plan_rows.trajectory_of(self._waypoints(row))
        return PlannedTrajectory(path.t_s, path.positions, path.quat_xyzw)

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
        return rows.demonstration_of(row, self._poses(row))

    def plan(self, transfer_id: str) -> Plan:
        """One plan as it was made, but for what it sees of the surface; see `surface`."""
        row = self.transfer(transfer_id)
        return plan_rows.plan_of(row, self._waypoints(row))

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        """What one plan sees of its target; None where it was not kept."""
        sha256 = self.transfer(transfer_id, ("surface_sha256",))["surface_sha256"]
        if sha256:
            return self.surfaces.get(sha256)
        return self.cache.get("surface", SurfaceStates, transfer_id, nameless=True)  # of version 0.1.0

    def inspected(self, transfer_id: str) -> SurfaceStates | None:
        """What of its source structure the demonstration of a plan was about; None where it was not kept."""
        sha256 = self.transfer(transfer_id, ("inspected_sha256",))["inspected_sha256"]
        return self.surfaces.get(sha256) if sha256 else None

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
        return queries.flights(self.tables["flights"], transfer_id, structure, kind)

    def looks_at(self, structure_id: str, place_m: Sequence[float], kind: str = "") -> pd.DataFrame:
        """How each flight round a structure saw the patch nearest to a place (m, structure frame).

        One row per flight in the order of flying: when, whether it saw the patch, and the nearest look at it
        (distance, incidence, speed); `patch_off_m` says how far the patch is from the place.
        """
        return looks.looks_at(self, structure_id, place_m, kind)

    def overruled(self, transfer_id: str | None = None) -> pd.DataFrame:
        """Rules of the gate that a person overruled, in the order they were added; of one plan, or all."""
        return queries.of_plans(self.tables["overruled"], transfer_id)

    def flown(self, flight_sha256: str) -> Trajectory:
        """The path of one flight, by the hash in its row."""
        return self.flown_paths.get(flight_sha256)

    def transfer(self, transfer_id: str, columns: Sequence[str] | None = None) -> Row:
        """The row of one plan; only the columns that are named."""
        check_id(transfer_id, "transfer id")
        wanted = None if columns is None else list(dict.fromkeys([*columns, *queries.STANDING]))
        found = self.tables["transfers"].read(pc.field("transfer_id") == transfer_id, wanted)
        if not len(found):
            raise CatalogError(
                f"transfer {transfer_id}",
                "is not in the catalog",
                suggested(transfer_id, self._transfer_ids(), 0),
                "see: upplied catalog transfers",
            )
        return queries.standing(rows.rows_of(found))

    def newest(self, table: str, name: str) -> Row:
        """The row of the current version of one structure or demonstration, retired or not."""
        column = TABLES[table].names[0]
        check_id(name, column.replace("_", " "))
        found = self._current[table].row(name)
        if found is None:
            known = self.tables[table].read(None, [column])[column].to_pylist()
            what = f"{table.removesuffix('s')} {name}"
            raise CatalogError(what, "is not in the catalog", suggested(name, set(known)))
        return found

    def demonstration_row(self, demonstration_id: str) -> Row:
        """The row of the current version of one demonstration."""
        return self.newest("demonstrations", demonstration_id)

    def find_transfer(self, start: str) -> str:
        """The id of the one plan whose id begins so; a whole id is found at once.

        Raises
        ------
        CatalogError
            If there is none, or more than one.
        """
        check_id(start, "transfer id")
        table = self.tables["transfers"]
        if len(table.read(pc.field("transfer_id") == start, ["transfer_id"])):
            return start
        found = [name for name in self._transfer_ids() if name.startswith(start)]
        if len(found) == 1:
            return found[0]
        if found:
            raise CatalogError(f"transfer {start}", f"may be {len(found)}: {', '.join(found[:5])}")
        raise CatalogError(
            f"transfer {start}", "is not in the catalog", suggested(start, self._transfer_ids(), 0)
        )

    def _transfer_ids(self) -> list[str]:
        known = self.tables["transfers"].read(None, ["transfer_id"])["transfer_id"].unique()
        return sorted(known.to_pylist())

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
        return queries.settled(self.tables["transfers"], keys, retry_failed, run_id)

    def known_transfers(self, keys: Iterable[str]) -> set[str]:
        """Those of the keys that are `settled` by a plan or an honest refusal."""
        return set(self.settled(keys, retry_failed=True))

    # --- adding --------------------------------------------------------------------------------

    def create(self) -> Catalog:
        """Make the catalog where there is none yet; adding does so as well."""
        self.identity.made()
        return self

    def add_structures(self, structures: Sequence[Structure]) -> int:
        """Add structures in one commit; returns how many were new or changed.

        One that says the same as its current version adds nothing. The mesh is kept before the row
        that names it.
        """
        return adding.add_structures(self, structures)

    def add_demonstrations(self, demonstrations: Sequence[Demonstration]) -> int:
        """Add demonstrations in one commit; returns how many were new or changed."""
        return adding.add_demonstrations(self, demonstrations)

    def add_plans(self, plans: Sequence[Planned]) -> int:
        """Add plans in one commit; returns how many rows came of it.

        Parameters
        ----------
        plans : sequence of (key, plan, provenance)
            The key is the hash of everything the plan depends on; one that is known adds nothing,
            with two exceptions: a failure makes way for a later result and for the failure of another
            run, and a plan that had been followed by another of its pair becomes current again. For the
            provenance see `upplied.catalog.schema.plan_rows.transfer_row`; hashes it leaves out are those of
            the current versions in the catalog.
        """
        return adding.add_plans(self, plans)

    def keep_surface(self, plan: Plan) -> Plan:
        """Keep what a plan sees of its target; returns the plan with the hash of it, still to be added.

        A process that plans does so, and sends the rest to the one that commits.
        """
        return adding.keep_surface(self, plan)

    def add_flight(self, row: Mapping[str, Any], path: Trajectory) -> int:
        """Add one flight of a plan: a row of `flights` without its commit and hash, and what was flown."""
        return adding.add_flight(self, row, path)

    def add_overruled(self, given: Sequence[Mapping[str, Any]]) -> int:
        """Keep which rules of the gate a person overruled; what is known already adds nothing.

        Parameters
        ----------
        given : sequence of mappings
            Rows of `overruled`, without their id and commit.
        """
        return adding.add_overruled(self, given)

    def retire_structures(self, structure_ids: Sequence[str]) -> int:
        """Take structures out of the fleet; their history stays. Returns how many were taken out."""
        return adding.retire(self, "structures", structure_ids)

    def retire_demonstrations(self, demonstration_ids: Sequence[str]) -> int:
        """Take demonstrations out of use; their history stays. Returns how many were taken out."""
        return adding.retire(self, "demonstrations", demonstration_ids)

    # --- settings of things --------------------------------------------------------------------

    def set(self, scope: str, owner: str, values: Mapping[str, Any], by: str, note: str = "") -> int:
        """Say settings of a kind or a structure, which its plans are then made with.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner : str
            The kind, or the id of the structure.
        values : mapping
            Setting to value, as ``{"route.clearance_m": 3.0}``; None takes it back.
        by : str
            Who says so.
        note : str
        """
        return belonging.say(self, scope, owner, values, by, note)

    def said_settings(self) -> pd.DataFrame:
        """What was ever said of settings of kinds and structures, in the order of commits."""
        found = queries.frame(self.tables["settings"].read()).sort_values("commit_version", kind="stable")
        return found.reset_index(drop=True)

    def settings_of(self, structure_id: str) -> pd.DataFrame:
        """Every setting that plans of a structure are made with, its value and where that comes from."""
        return belonging.settings_of(self, structure_id)

    def require(
        self,
        scope: str,
        owner: str,
        name: str,
        zones: Sequence[Mapping[str, Any]],
        by: str,
        note: str = "",
    ) -> int:
        """Say which zones of a structure, or of all of a kind, must be seen: the next version of a set.

        Parameters
        ----------
        scope : {"kind", "structure"}
        owner : str
            The kind, or the id of the structure.
        name : str
            Of the set.
        zones : sequence of mapping
            Each with `zone` (its name), `where` (landmarks, part_0, "box X Y Z X Y Z", m) and what is
            asked: `gsd_mm`, `incidence_deg`, `max_age_days`. None takes the set back.
        by : str
            Who asks.
        note : str
        """
        return required.require(self, scope, owner, name, zones, by, note)

    def requirements(self, every: bool = False) -> pd.DataFrame:
        """Sets of requirements, the newest version of each; with `every`, older and taken back ones too."""
        return required.requirements(self, every)

    # --- deciding ------------------------------------------------------------------------------

    def review(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that somebody looked at a plan and found nothing against it; the name of the decision."""
        return decisions.review(self, transfer_id, by, note)

    def reject(self, transfer_id: str, by: str, note: str = "") -> str:
        """Say that a plan must not be flown; where it was in force, none is then."""
        return decisions.reject(self, transfer_id, by, note)

    def release(
        self, transfer_id: str, by: str, note: str = "", force: Sequence[str] = (), after: str | None = None
    ) -> str:
        """Put a plan in force for its demonstration and target, until a person releases another.

        Parameters
        ----------
        transfer_id : str
        by : str
            Who releases it.
        note : str
        force : sequence of str
            Rules that are overruled: preset, verdict, rejected, recalled, changed.
        after : str, optional
            The last decision about the pair that the person knew of; none: the last there is now.

        Returns
        -------
        str
            The name of the decision.

        Raises
        ------
        RefusedError
            If the plan has no path, is an experiment, breaks a rule that is not overruled, or somebody
            else decided about the pair meanwhile.
        """
        return decisions.release(self, transfer_id, by, note, force, after)

    # --- below ---------------------------------------------------------------------------------

    def _waypoints(self, row: Row) -> pa.Table:
        return queries.steps(self.tables["waypoints"], row)

    def _poses(self, row: Row) -> pa.Table:
        return queries.steps(self.tables["poses"], row)
