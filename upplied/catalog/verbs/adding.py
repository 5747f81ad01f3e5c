"""The way in: records become rows, steps first, then the rows that own them."""

import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from upplied.catalog.reading import Reading
from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.plan_rows import is_foreign
from upplied.catalog.schema.rows import Row
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.delta import StepTable, StoredTable
from upplied.catalog.verbs import ordering
from upplied.catalog.verbs.maintenance import tidy
from upplied.checks import check_id
from upplied.config import digest
from upplied.records import Bools, Demonstration, Plan, Structure, Trajectory

Planned = tuple[str, Plan, Mapping[str, Any]]  # key, plan, provenance


class Adding(Reading):
    """A catalog that takes records in; see `upplied.catalog.Catalog`."""

    def add_structures(self, structures: Sequence[Structure]) -> int:
        """Add structures in one commit, meshes first; returns how many were new or changed."""
        current = ordering.newest_rows(self.create().tables["structures"])
        new: dict[str, Row] = {}
        for structure in structures:
            check_id(structure.structure_id, "structure id")
            check_id(structure.kind, f"kind of {structure.structure_id}")
            # The mesh without its name: structures may share one.
            mesh = Structure("", "", structure.vertices, structure.triangles, structure.normals)
            row = rows.structure_row(structure, self.contents["meshes"].put(mesh))
            stored = current.get(structure.structure_id)
            if stored is not None and row["tells_parts"] is None and stored["sha256"] == row["sha256"]:
                row["tells_parts"] = stored["tells_parts"]
            if stored is None or not rows.says_same(TABLES["structures"], stored, row):
                new[structure.structure_id] = row
        return self.add_rows("structures", list(new.values()))

    def add_demonstrations(self, demonstrations: Sequence[Demonstration]) -> int:
        """Add demonstrations in one commit; returns how many were new or changed."""
        current = ordering.newest_rows(self.create().tables["demonstrations"])
        new: dict[str, tuple[Row, Demonstration]] = {}
        for item in demonstrations:
            check_id(item.demonstration_id, "demonstration id")
            check_id(item.structure_id, f"structure of {item.demonstration_id}")
            row, stored = rows.demonstration_row(item), current.get(item.demonstration_id)
            if stored is None or not rows.says_same(TABLES["demonstrations"], stored, row):
                new[item.demonstration_id] = row, item
        commit = self._add_steps("poses", rows.pose_table(*(item for _, item in new.values())))
        return self.add_rows("demonstrations", [{**row, "commit_id": commit} for row, _ in new.values()])

    def add_plans(self, plans: Sequence[Planned]) -> int:
        """Add plans in one commit; returns how many rows came of it.

        Each is key, plan and provenance (`upplied.catalog.schema.plan_rows.transfer_row`; hashes it leaves
        out are those of the current versions). The key is the hash of everything the plan depends on; one
        that is known adds nothing, but that a failure makes way for a later result and for the failure of
        another run, and that a plan which another of its pair had followed becomes current again.
        """
        keys = [check_id(key, "key of a plan") for key, _, _ in plans]
        table = self.create().tables["transfers"]
        stored = ordering.rows_of_keys(table, keys)
        new = {
            key: (plan, provenance)
            for key, plan, provenance in plans
            if _makes_way(stored.get(key), plan.status, str(provenance.get("run_id", "")))
        }
        again = ordering.superseded(table, [row for key, row in stored.items() if key not in new])
        new = {key: (self.keep_surface(plan), provenance) for key, (plan, provenance) in new.items()}
        named = {plan_rows.transfer_id(key): plan for key, (plan, _) in sorted(new.items())}
        commit = self._add_steps("waypoints", plan_rows.waypoint_table(named))
        own = [{**row, "commit_id": commit} for row in self._transfer_rows(new)]
        return self.add_rows("transfers", own, _repeated(table, again, {"planned_at": self.clock.now()}))

    def keep_surface(self, plan: Plan) -> Plan:
        """Store what a plan sees of its target; the plan with the hash of it, still to be added."""
        for name in ("surface", "inspected", "supposed", "photos"):
            store: Any = self.contents.get(name, self.surfaces)
            if (record := getattr(plan, name)) is not None:
                plan = replace(plan, **{name: None, f"{name}_sha256": store.put(record)})
        return plan

    def add_flight(self, row: Mapping[str, Any], path: Trajectory) -> int:
        """Add one flight of a plan: a row of `flights` without its commit and hash, and what was flown."""
        check_id(row["flight_id"], "flight id")
        self.transfer(row["transfer_id"], ("transfer_id",))  # one that nobody planned is an error
        return self.add_rows("flights", [{**row, "flight_sha256": self.contents["flown"].put(path)}])

    def add_overruled(self, overruled: Sequence[Mapping[str, Any]]) -> int:
        """Keep which rules of the gate a person overruled, as rows without id and commit, unless known."""
        for row in overruled:
            self.transfer(row["transfer_id"], ("transfer_id",))
        known, rules = set(self.overruled()["overruled_id"]), {digest(dict(row)): row for row in overruled}
        new = [{**row, "overruled_id": key} for key, row in rules.items() if key not in known]
        return self.add_rows("overruled", new)

    def retire_structures(self, structure_ids: Sequence[str]) -> int:
        """Take structures out of the fleet; their history stays. Returns how many were taken out."""
        return self._retire("structures", structure_ids)

    def retire_demonstrations(self, demonstration_ids: Sequence[str]) -> int:
        """Take demonstrations out of use; their history stays. Returns how many were taken out."""
        return self._retire("demonstrations", demonstration_ids)

    def _retire(self, name: str, ids: Sequence[str]) -> int:
        newest = [self.newest(name, item) for item in dict.fromkeys(ids)]
        in_use = [row for row in newest if not row["retired"]]
        return self.add_rows(name, [], _repeated(self.tables[name], in_use, {"retired": True}))

    def adopt_plans(self, plans: Sequence[Row], waypoints: Mapping[tuple[str, str], pa.Table]) -> int:
        """Add plans of another catalog as they are, with the steps that they own there."""
        stored = ordering.rows_of_keys(self.tables["transfers"], [row["key"] for row in plans])
        new = [row for row in plans if _makes_way(stored.get(row["key"]), row["status"], "", is_foreign(row))]
        owned = [waypoints[row["transfer_id"], row["commit_id"]] for row in new if row["n_waypoints"]]
        commit = self._add_steps("waypoints", *owned)
        undecided = dict.fromkeys(ordering.DERIVED)  # here, whatever was decided elsewhere
        return self.add_rows("transfers", [{**row, **undecided, "commit_id": commit} for row in new])

    def add_rows(self, name: str, new: list[Row], more: pa.Table | None = None) -> int:
        """Commit rows, and `more` as they are; how many. Rows that own steps carry the commit of these."""
        commit = {"commit_id": self.new_commit_id()}
        table = rows.table_of(TABLES[name], [{**commit, **row} for row in new])
        table = table if more is None else pa.concat_tables([table, more], promote_options="default")
        if len(table):
            tidy(self.tables[name], self.tables[name].append(table))
        return len(table)

    def new_commit_id(self) -> str:
        """A name that tells the time and is never given twice."""
        return f"{self.clock.now():%Y%m%d-%H%M%S-%f}-{secrets.token_hex(4)}"

    def _transfer_rows(self, new: Mapping[str, tuple[Plan, Mapping[str, Any]]]) -> list[Row]:
        """Rows of new plans; hashes that the provenance leaves out are those of the current versions."""
        hashes: dict[str, str] = {}
        if any(_HASHES.keys() - provenance.keys() for _, provenance in new.values()):
            for table in ("structures", "demonstrations"):
                newest = ordering.newest_rows(self.tables[table])
                hashes |= {f"{table}/{name}": row["sha256"] for name, row in newest.items()}
        transfers = []
        for key, (plan, provenance) in new.items():
            named = {column: f"{table}/{getattr(plan, name)}" for column, (table, name) in _HASHES.items()}
            known = {column: hashes.get(name, "") for column, name in named.items()}
            transfers.append(plan_rows.transfer_row(key, plan, {**known, **provenance}))
        return transfers

    def settled(
        self, keys: Iterable[str], *, retry_failed: bool = False, run_id: str = ""
    ) -> dict[str, tuple[str, str]]:
        """Those of the keys that need no planning, each with status and reason of its plan.

        A key is settled when its plan is the current one of its demonstration, target and preset. With
        `retry_failed` failures are not settled, but for those of the run `run_id`.
        """
        ids = ordering.ids_of(names := list(dict.fromkeys(keys)))
        plans = ordering.settled_plans(self.tables["transfers"], ids, retry_failed, run_id, ["reason"])
        once: dict[tuple[str, str], tuple[str, str]] = {}  # few, of many plans
        columns = (plans[name].to_pylist() for name in ("status", "reason"))
        outcomes = [once.setdefault(outcome, outcome) for outcome in zip(*columns, strict=True)]
        places = zip(names, pc.index_in(ids, plans["transfer_id"].combine_chunks()).to_pylist(), strict=True)
        return {key: outcomes[at] for key, at in places if at is not None}

    def unsettled(self, keys: pa.Array, *, retry_failed: bool = False) -> Bools:
        """Which of an array of keys are not `settled`, (N,); for as many as a large fleet has."""
        ids = ordering.ids_of(keys)
        plans = ordering.settled_plans(self.tables["transfers"], ids, retry_failed, "", [])
        return ~pc.is_in(ids, plans["transfer_id"].combine_chunks()).to_numpy(zero_copy_only=False)

    def newest_plans(self, columns: Sequence[str]) -> pa.Table:
        """Columns of the newest plan of each demonstration, target and preset, retired or not; and its id."""
        read = list(dict.fromkeys([*ordering.ORDERED, *columns]))
        plans = ordering.in_order(self.tables["transfers"].narrow(read), newest=True)
        return plans.filter(pc.equal(plans["purpose"], "")).select(["transfer_id", *columns])

    def _add_steps(self, name: str, *steps: pa.Table) -> str:
        """Keep steps, where there are any; returns the commit that the rows owning them must carry."""
        if not any(map(len, steps)):
            return self.new_commit_id()
        table = self.tables[name]
        assert isinstance(table, StepTable)
        return table.keep(pa.concat_tables(steps), self.clock.now())


def _makes_way(stored: Row | None, status: str, run_id: str = "", foreign: bool = False) -> bool:
    """Whether a plan's row is added: a result or another run's failure to a failure, a plan to an import."""
    if stored is None:
        return True
    if is_foreign(stored):
        return not foreign
    return stored["status"] == "failed" and not (status == "failed" and run_id in ("", stored["run_id"]))


def _repeated(table: StoredTable, stored: Sequence[Row], changes: Mapping[str, Any]) -> pa.Table:
    """Stored rows again, with some columns changed; what a newer program wrote into them stays."""
    if not stored:
        return table.declared.schema.empty_table()
    key = table.declared.names[0]
    keys = {(row[key], row["commit_id"], row["commit_version"]) for row in stored}
    whole = table.whole(pc.field(key).isin([row[key] for row in stored]))
    newer = {(row[key], row["commit_id"], row["commit_version"]): row for row in whole.to_pylist()}
    again = [{**row, **changes} for name, row in newer.items() if name in keys]
    return pa.Table.from_pylist(again, whole.schema)


_HASHES = {
    "demonstration_sha256": ("demonstrations", "demonstration_id"),
    "source_sha256": ("structures", "source_id"),
    "target_sha256": ("structures", "target_id"),
}
