"""The way in: records become rows, steps first, then the rows that own them."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.reading import Reading
from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.delta import StoredTable
from upplied.catalog.store.merging import tidy
from upplied.catalog.store.steps import StepTable
from upplied.catalog.verbs import ordering
from upplied.catalog.verbs.standing import DERIVED
from upplied.checks import check_id
from upplied.config import digest
from upplied.records import Demonstration, Plan, Structure, Trajectory

Planned = tuple[str, Plan, Mapping[str, Any]]  # key, plan, provenance


class Adding(Reading):
    """A catalog that takes records in; see `upplied.catalog.Catalog`."""

    def add_structures(self, structures: Sequence[Structure]) -> int:
        """Add structures in one commit; returns how many were new or changed.

        One that says the same as its current version adds nothing. The mesh is kept before the row
        that names it.
        """
        current = self.create()._current("structures")
        new: dict[str, Row] = {}
        for structure in structures:
            check_id(structure.structure_id, "structure id")
            check_id(structure.kind, f"kind of {structure.structure_id}")
            # The mesh without its name: structures may share one.
            mesh = Structure("", "", structure.vertices, structure.triangles, structure.normals)
            row = rows.structure_row(structure, self.meshes.put(mesh))
            stored = current.get(structure.structure_id)
            if stored is not None and row["tells_parts"] is None and stored["sha256"] == row["sha256"]:
                row["tells_parts"] = stored["tells_parts"]
            if not _known("structures", stored, row):
                new[structure.structure_id] = row
        return self.add_rows("structures", list(new.values()))

    def add_demonstrations(self, demonstrations: Sequence[Demonstration]) -> int:
        """Add demonstrations in one commit; returns how many were new or changed."""
        current = self.create()._current("demonstrations")
        new: dict[str, tuple[Row, Demonstration]] = {}
        for item in demonstrations:
            check_id(item.demonstration_id, "demonstration id")
            check_id(item.structure_id, f"structure of {item.demonstration_id}")
            row = rows.demonstration_row(item)
            if not _known("demonstrations", current.get(item.demonstration_id), row):
                new[item.demonstration_id] = row, item
        commit = self._add_steps("poses", [rows.pose_table(item) for _, item in new.values()])
        return self.add_rows("demonstrations", [{**row, "commit_id": commit} for row, _ in new.values()])

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
        for key, _, _ in plans:
            check_id(key, "key of a plan")
        table = self.create().tables["transfers"]
        stored = ordering.rows_of_keys(table, [key for key, _, _ in plans])
        new = {
            key: (plan, provenance)
            for key, plan, provenance in plans
            if key not in stored or _makes_way(stored[key], plan.status, str(provenance.get("run_id", "")))
        }
        again = ordering.superseded(table, [row for key, row in stored.items() if key not in new])
        new = {key: (self.keep_surface(plan), provenance) for key, (plan, provenance) in new.items()}
        flown = {
            plan_rows.transfer_id(key): plan for key, (plan, _) in new.items() if plan.trajectory is not None
        }
        steps = [plan_rows.waypoint_table(name, flown[name]) for name in sorted(flown)]
        commit = self._add_steps("waypoints", steps)
        own = [{**row, "commit_id": commit} for row in self._transfer_rows(new)]
        return self.add_rows("transfers", own, _repeated(table, again, {"planned_at": self.clock.now()}))

    def keep_surface(self, plan: Plan) -> Plan:
        """Keep what a plan sees of its target; returns the plan with the hash of it, still to be added.

        A process that plans does so, and sends the rest to the one that commits.
        """
        put = self.surfaces.put
        if plan.surface is not None:
            plan = replace(plan, surface=None, surface_sha256=put(plan.surface))
        if plan.inspected is not None:
            plan = replace(plan, inspected=None, inspected_sha256=put(plan.inspected))
        if plan.supposed is not None:
            plan = replace(plan, supposed=None, supposed_sha256=self.supposed_surfaces.put(plan.supposed))
        if plan.photos is not None:
            plan = replace(plan, photos=None, photos_sha256=self.plan_photos.put(plan.photos))
        return plan

    def add_flight(self, row: Mapping[str, Any], path: Trajectory) -> int:
        """Add one flight of a plan: a row of `flights` without its commit and hash, and what was flown."""
        check_id(row["flight_id"], "flight id")
        self.transfer(row["transfer_id"], ("transfer_id",))  # one that nobody planned is an error
        return self.add_rows("flights", [{**row, "flight_sha256": self.flown_paths.put(path)}])

    def add_overruled(self, given: Sequence[Mapping[str, Any]]) -> int:
        """Keep which rules of the gate a person overruled; what is known already adds nothing.

        Parameters
        ----------
        given : sequence of mappings
            Rows of `overruled`, without their id and commit.
        """
        rules = {}
        for row in given:
            self.transfer(row["transfer_id"], ("transfer_id",))
            rules[digest(dict(row))] = dict(row)
        known = set(self.overruled()["overruled_id"])
        return self.add_rows(
            "overruled", [{**row, "overruled_id": key} for key, row in rules.items() if key not in known]
        )

    def retire_structures(self, structure_ids: Sequence[str]) -> int:
        """Take structures out of the fleet; their history stays. Returns how many were taken out."""
        return self._retire("structures", structure_ids)

    def retire_demonstrations(self, demonstration_ids: Sequence[str]) -> int:
        """Take demonstrations out of use; their history stays. Returns how many were taken out."""
        return self._retire("demonstrations", demonstration_ids)

    def adopt_plans(self, plans: Sequence[Row], waypoints: Mapping[tuple[str, str], pa.Table]) -> int:
        """Add plans of another catalog as they are, with the steps that they own there."""
        stored = ordering.rows_of_keys(self.tables["transfers"], [row["key"] for row in plans])
        new = [
            row
            for row in plans
            if row["key"] not in stored
            or _makes_way(stored[row["key"]], row["status"], foreign=plan_rows.is_foreign(row))
        ]
        owned = [waypoints[row["transfer_id"], row["commit_id"]] for row in new if row["n_waypoints"]]
        commit = self._add_steps("waypoints", owned)
        undecided = dict.fromkeys(DERIVED)  # what was decided about them elsewhere is not decided here
        return self.add_rows("transfers", [{**row, **undecided, "commit_id": commit} for row in new])

    def add_rows(self, name: str, new: list[Row], more: pa.Table | None = None) -> int:
        """Commit rows of a table, and rows as they are besides; the number of rows added.

        Rows that own steps carry the commit that brought these already.
        """
        commit = {"commit_id": self.new_commit_id()}
        table = rows.table_of(TABLES[name], [{**commit, **row} for row in new])
        table = table if more is None else pa.concat_tables([table, more], promote_options="default")
        if len(table):
            tidy(self.tables[name], self.tables[name].append(table))
        return len(table)

    def new_commit_id(self) -> str:
        """A name that tells the time and is never given twice."""
        return f"{self.clock.now():%Y%m%d-%H%M%S-%f}-{secrets.token_hex(4)}"

    def _retire(self, name: str, ids: Sequence[str]) -> int:
        """Add a version of structures or demonstrations that says they are out of use."""
        newest = [self.newest(name, item) for item in dict.fromkeys(ids)]
        gone = [row for row in newest if not row["retired"]]
        return self.add_rows(name, [], _repeated(self.tables[name], gone, {"retired": True}))

    def _transfer_rows(self, new: Mapping[str, tuple[Plan, Mapping[str, Any]]]) -> list[Row]:
        """Rows of new plans; hashes that the provenance leaves out are those of the current versions."""
        hashes: dict[str, str] = {}
        if any(_HASHES.keys() - provenance.keys() for _, provenance in new.values()):
            for table, name in (("structures", "structure_id"), ("demonstrations", "demonstration_id")):
                hashes.update(
                    (f"{table}/{row[name]}", row["sha256"])
                    for row in ordering.newest_rows(self.tables[table])
                )
        transfers = []
        for key, (plan, provenance) in new.items():
            known = {
                column: hashes.get(f"{table}/{getattr(plan, name)}", "")
                for column, (table, name) in _HASHES.items()
            }
            transfers.append(plan_rows.transfer_row(key, plan, {**known, **provenance}))
        return transfers

    def _current(self, name: str) -> dict[str, Row]:
        return {row[TABLES[name].names[0]]: row for row in ordering.newest_rows(self.tables[name])}

    def _add_steps(self, name: str, steps: list[pa.Table]) -> str:
        """Keep steps, where there are any; returns the commit that the rows owning them must carry."""
        if not steps:
            return self.new_commit_id()
        table = self.tables[name]
        assert isinstance(table, StepTable)
        return table.keep(pa.concat_tables(steps), self.clock.now())


def _makes_way(stored: Row, status: str, run_id: str = "", foreign: bool = False) -> bool:
    """Whether a row of the same plan is added: after a failure a result, or another run's failure.

    And after what was imported and not measured here, what was.
    """
    if plan_rows.is_foreign(stored):
        return not foreign
    failed_again = status == "failed" and run_id in ("", stored["run_id"])
    return stored["status"] == "failed" and not failed_again


def _repeated(table: StoredTable, stored: Sequence[Row], changes: Mapping[str, Any]) -> pa.Table:
    """Stored rows again, with some columns changed; what a newer program wrote into them stays."""
    if not stored:
        return table.declared.schema.empty_table()
    key = table.declared.names[0]
    wanted = {(row[key], row["commit_id"], row["commit_version"]) for row in stored}
    newer: dict[Any, Row] = {}
    whole = table.whole(pc.field(key).isin([row[key] for row in stored]))
    for row in rows.rows_of(whole):
        if (name := (row[key], row["commit_id"], row["commit_version"])) in wanted:
            newer[name] = {**row, **changes}
    return pa.Table.from_pylist(list(newer.values()), whole.schema)


def _known(name: str, stored: Row | None, given: Row) -> bool:
    return stored is not None and rows.says_same(TABLES[name], stored, given)


_HASHES = {
    "demonstration_sha256": ("demonstrations", "demonstration_id"),
    "source_sha256": ("structures", "source_id"),
    "target_sha256": ("structures", "target_id"),
}
