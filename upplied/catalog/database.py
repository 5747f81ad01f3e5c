"""The catalog: what is kept of structures, demonstrations and plans, and the way in and out.

A commit is whole or it is not there. The rows of `waypoints` and `poses` are committed before the
row that names them, and that row says by which commit they came, so nobody ever reads a trajectory
without its points, or with the points of a writer that was stopped half-way.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog import queries, rows
from upplied.catalog.cache import Cache
from upplied.catalog.delta import StoredTable
from upplied.catalog.meshes import MeshStore
from upplied.catalog.queries import When
from upplied.catalog.rows import Row
from upplied.catalog.tables import TABLES
from upplied.checks import check_id
from upplied.errors import CatalogError
from upplied.records import Demonstration, Plan, Structure, SurfaceStates

_SURFACE = "surface"  # the cache's stage for the surface states of plans


def open_catalog(location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> Catalog:
    """Open a catalog; its tables are made when the first row is added.

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
    """A catalog at a location; see `open_catalog`."""

    def __init__(self, location: str | os.PathLike[str], cache: str | os.PathLike[str] | None = None) -> None:
        text = os.fspath(location)
        self.location = text if "://" in text else str(Path(text).expanduser().absolute())
        self.tables = {name: StoredTable(self.location, table) for name, table in TABLES.items()}
        self.meshes = MeshStore(self.location)
        self.cache = Cache(cache if cache is not None else _cache_folder(self.location))

    def __repr__(self) -> str:
        return f"Catalog({self.location!r})"

    # --- asking --------------------------------------------------------------------------------

    def structures(
        self,
        kind: str | None = None,
        site: str | None = None,
        every_version: bool = False,
        as_of: When | None = None,
    ) -> pd.DataFrame:
        """Structures, the current version of each.

        Parameters
        ----------
        kind, site : str, optional
            Only these.
        every_version : bool
            Older and retired versions as well.
        as_of : datetime or str, optional
            As the catalog was at that moment (a text without a zone is UTC).
        """
        return queries.structures(self.tables["structures"], kind, site, every_version, as_of)

    def demonstrations(
        self,
        structure: str | None = None,
        site: str | None = None,
        every_version: bool = False,
        as_of: When | None = None,
    ) -> pd.DataFrame:
        """Demonstrations, the current version of each; parameters as for `structures`."""
        return queries.demonstrations(self.tables["demonstrations"], structure, site, every_version, as_of)

    def transfers(self, **which: Any) -> pd.DataFrame:
        """Plans, by default the newest of each demonstration, target and preset.

        Parameters
        ----------
        **which
            Fields of `upplied.catalog.queries.Which`: kind, site, structure, demonstration, preset,
            status, since, until, as_of, version, every, columns.
        """
        return queries.transfers(self.tables, queries.Which(**which))

    def waypoints(self, transfer_id: str) -> pd.DataFrame:
        """The steps of one planned trajectory, in order."""
        return queries.frame(self._waypoints(self._transfer(transfer_id)))

    def poses(self, demonstration_id: str) -> pd.DataFrame:
        """The steps of the current version of one demonstration, in order."""
        return queries.frame(self._poses(self._newest("demonstrations", demonstration_id)))

    def trajectory(self, transfer_id: str) -> queries.PlannedTrajectory:
        """One planned trajectory as a record that can be asked for its pose at any time."""
        row = self._transfer(transfer_id)
        if not row["n_waypoints"]:
            raise CatalogError(
                f"transfer {transfer_id}", f"has no trajectory: it is {row['status']}: {row['reason']}"
            )
        path = rows.trajectory_of(self._waypoints(row))
        return queries.PlannedTrajectory(path.t_s, path.positions, path.quat_xyzw)

    def structure(self, structure_id: str) -> Structure:
        """The current version of one structure, complete."""
        return self.structure_of(self._newest("structures", structure_id))

    def structure_of(self, row: Row) -> Structure:
        """The structure of one row of `structures`, of any version."""
        return rows.structure_of(row, self.meshes.get(row["mesh_sha256"]))

    def demonstration(self, demonstration_id: str) -> Demonstration:
        """The current version of one demonstration, complete."""
        return self.demonstration_of(self._newest("demonstrations", demonstration_id))

    def demonstration_of(self, row: Row) -> Demonstration:
        """The demonstration of one row of `demonstrations`, of any version."""
        return rows.demonstration_of(row, self._poses(row))

    def plan(self, transfer_id: str) -> Plan:
        """One plan as it was made; the states of the surface only where the cache still has them."""
        row = self._transfer(transfer_id)
        return rows.plan_of(row, self._waypoints(row))

    def surface(self, transfer_id: str) -> SurfaceStates | None:
        """What one plan sees of its target, where the cache still has it."""
        return self.cache.get(_SURFACE, SurfaceStates, transfer_id)

    def known_transfers(self, keys: Iterable[str]) -> set[str]:
        """Those of the keys that have a plan, or an honest refusal; a failure may be tried again."""
        return queries.known_keys(self.tables["transfers"], keys, settled=True)

    # --- adding --------------------------------------------------------------------------------

    def add_structures(self, structures: Sequence[Structure]) -> int:
        """Add structures in one commit; returns how many were new or changed.

        One that says the same as its current version adds nothing. The mesh is kept before the row
        that names it.
        """
        current = {row["structure_id"]: row for row in self._all_newest("structures")}
        new: dict[str, Row] = {}
        for structure in structures:
            check_id(structure.structure_id, "structure id")
            check_id(structure.kind, f"kind of {structure.structure_id}")
            row = rows.structure_row(structure, self.meshes.put(structure))
            if not _says_same(current.get(structure.structure_id), row):
                new[structure.structure_id] = row
        return self._add("structures", list(new.values()))

    def add_demonstrations(self, demonstrations: Sequence[Demonstration]) -> int:
        """Add demonstrations in one commit; returns how many were new or changed."""
        current = {row["demonstration_id"]: row for row in self._all_newest("demonstrations")}
        new: dict[str, Demonstration] = {}
        for item in demonstrations:
            check_id(item.demonstration_id, "demonstration id")
            check_id(item.structure_id, f"structure of {item.demonstration_id}")
            if not _says_same(current.get(item.demonstration_id), rows.demonstration_row(item)):
                new[item.demonstration_id] = item
        if not new:
            return 0
        commit = self._add_steps(
            "poses", lambda commit: [rows.pose_table(item, commit) for item in new.values()]
        )
        return self._add("demonstrations", [rows.demonstration_row(item) for item in new.values()], commit)

    def add_plans(self, plans: Sequence[tuple[str, Plan, Mapping[str, Any]]]) -> int:
        """Add plans in one commit; returns how many were new.

        Parameters
        ----------
        plans : sequence of (key, plan, provenance)
            The key is the hash of everything the plan depends on; one that is known adds nothing
            (only a failure makes way for a later result). For the provenance see
            `upplied.catalog.rows.transfer_row`; hashes it leaves out are those of the current
            versions in the catalog.
        """
        for key, _, _ in plans:
            check_id(key, "key of a plan")
        known = self.known_transfers(key for key, _, _ in plans)
        failed = queries.known_keys(self.tables["transfers"], (key for key, _, _ in plans))
        new = {
            key: (plan, provenance)
            for key, plan, provenance in plans
            if key not in known and not (key in failed and plan.status == "failed")
        }
        if not new:
            return 0
        hashes = self._hashes() if any(_lacks_hashes(said) for _, said in new.values()) else {}
        made = [
            rows.transfer_row(key, plan, {**_hashes_for(plan, hashes), **provenance})
            for key, (plan, provenance) in new.items()
        ]
        flown = {rows.transfer_id(key): plan for key, (plan, _) in sorted(new.items()) if plan.trajectory}
        commit = self._add_steps(
            "waypoints",
            lambda commit: [rows.waypoint_table(name, plan, commit) for name, plan in flown.items()],
        )
        added = self._add("transfers", made, commit)
        for name, plan in flown.items():
            if plan.surface is not None:
                self.cache.put(_SURFACE, name, plan.surface)
        return added

    def retire_structures(self, structure_ids: Sequence[str]) -> int:
        """Take structures out of the fleet; their history stays. Returns how many were taken out."""
        return self._retire("structures", structure_ids)

    def retire_demonstrations(self, demonstration_ids: Sequence[str]) -> int:
        """Take demonstrations out of use; their history stays. Returns how many were taken out."""
        return self._retire("demonstrations", demonstration_ids)

    # --- below ---------------------------------------------------------------------------------

    def _add(self, name: str, made: list[Row], commit: str = "") -> int:
        if made:
            added = {"commit_id": commit or _commit_id(), "added_at": datetime.now(UTC)}
            self.tables[name].append(rows.table_of(TABLES[name], [{**row, **added} for row in made]))
        return len(made)

    def _add_steps(self, name: str, build: Callable[[str], list[pa.Table]]) -> str:
        """Commit steps, and return the commit that the rows naming them must carry."""
        commit = _commit_id()
        steps = build(commit)
        if steps:
            self.tables[name].append(pa.concat_tables(steps))
        return commit

    def _retire(self, name: str, ids: Sequence[str]) -> int:
        found = [self._newest(name, item) for item in dict.fromkeys(ids)]
        poses = [row for row in found if name == "demonstrations"]
        for row in poses:  # a retired version still owns the poses of the commit that brought them
            self._add(name, [{**row, "retired": True}], row["commit_id"])
        return len(poses) or self._add(name, [{**row, "retired": True} for row in found])

    def _transfer(self, transfer_id: str) -> Row:
        check_id(transfer_id, "transfer id")
        found = self.tables["transfers"].read(pc.field("transfer_id") == transfer_id)
        if not len(found):
            raise CatalogError(
                f"transfer {transfer_id}", "is not in the catalog", "", "list them: transfers()"
            )
        return queries.settled_first(rows.rows_of(found))

    def _waypoints(self, row: Row) -> pa.Table:
        return queries.steps(self.tables["waypoints"], "transfer_id", row, row["n_waypoints"])

    def _poses(self, row: Row) -> pa.Table:
        return queries.steps(self.tables["poses"], "demonstration_id", row, row["n_poses"])

    def _newest(self, name: str, value: str) -> Row:
        column = TABLES[name].names[0]
        check_id(value, column.replace("_", " "))
        found = queries.newest_rows(self.tables[name], pc.field(column) == value)
        if not found:
            raise CatalogError(f"{column} {value}", "is not in the catalog", "", f"list them: {name}()")
        return found[0]

    def _all_newest(self, name: str) -> list[Row]:
        return queries.newest_rows(self.tables[name])

    def _hashes(self) -> dict[str, str]:
        found = {}
        for name in ("structures", "demonstrations"):
            for row in self._all_newest(name):
                found[f"{name}/{row[TABLES[name].names[0]]}"] = row["sha256"]
        return found


def _commit_id() -> str:
    """A name that sorts by time and is never given twice."""
    return f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}-{secrets.token_hex(4)}"


def _says_same(current: Row | None, given: Row) -> bool:
    return current is not None and not current["retired"] and rows.same(current, given)


def _lacks_hashes(provenance: Mapping[str, Any]) -> bool:
    return not {"demonstration_sha256", "source_sha256", "target_sha256"} <= set(provenance)


def _hashes_for(plan: Plan, hashes: Mapping[str, str]) -> dict[str, str]:
    return {
        "demonstration_sha256": hashes.get(f"demonstrations/{plan.demonstration_id}", ""),
        "source_sha256": hashes.get(f"structures/{plan.source_id}", ""),
        "target_sha256": hashes.get(f"structures/{plan.target_id}", ""),
    }


def _cache_folder(location: str) -> Path:
    """Beside the tables of a folder; for an object store in the user's cache directory."""
    if "://" not in location:
        return Path(location) / "cache"
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return home / "upplied" / "".join(c if c.isalnum() else "-" for c in location)
