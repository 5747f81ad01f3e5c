"""The way in: records become rows, steps first, then the rows that own them."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.compute as pc

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

if TYPE_CHECKING:
    from upplied.catalog.reading import Reading

Planned = tuple[str, Plan, Mapping[str, Any]]  # key, plan, provenance


def add_structures(catalog: Reading, structures: Sequence[Structure]) -> int:
    """See `Catalog.add_structures`."""
    current = _current(catalog.create(), "structures")
    new: dict[str, Row] = {}
    for structure in structures:
        check_id(structure.structure_id, "structure id")
        check_id(structure.kind, f"kind of {structure.structure_id}")
        row, stored = (
            rows.structure_row(structure, catalog.meshes.put(structure)),
            current.get(structure.structure_id),
        )
        if stored is not None and row["tells_parts"] is None and stored["sha256"] == row["sha256"]:
            row["tells_parts"] = stored["tells_parts"]
        if not _known("structures", stored, row):
            new[structure.structure_id] = row
    return _add(catalog, "structures", list(new.values()))


def add_demonstrations(catalog: Reading, demonstrations: Sequence[Demonstration]) -> int:
    """See `Catalog.add_demonstrations`."""
    current = _current(catalog.create(), "demonstrations")
    new: dict[str, tuple[Row, Demonstration]] = {}
    for item in demonstrations:
        check_id(item.demonstration_id, "demonstration id")
        check_id(item.structure_id, f"structure of {item.demonstration_id}")
        row = rows.demonstration_row(item)
        if not _known("demonstrations", current.get(item.demonstration_id), row):
            new[item.demonstration_id] = row, item
    commit = _add_steps(catalog, "poses", [rows.pose_table(item) for _, item in new.values()])
    return _add(catalog, "demonstrations", [{**row, "commit_id": commit} for row, _ in new.values()])


def add_plans(catalog: Reading, plans: Sequence[Planned]) -> int:
    """See `Catalog.add_plans`."""
    for key, _, _ in plans:
        check_id(key, "key of a plan")
    table = catalog.create().tables["transfers"]
    stored = ordering.rows_of_keys(table, [key for key, _, _ in plans])
    new = {
        key: (plan, provenance)
        for key, plan, provenance in plans
        if key not in stored or _makes_way(stored[key], plan.status, str(provenance.get("run_id", "")))
    }
    again = ordering.superseded(table, [row for key, row in stored.items() if key not in new])
    new = {key: (keep_surface(catalog, plan), said) for key, (plan, said) in new.items()}
    flown = {
        plan_rows.transfer_id(key): plan for key, (plan, _) in new.items() if plan.trajectory is not None
    }
    steps = [plan_rows.waypoint_table(name, flown[name]) for name in sorted(flown)]
    commit = _add_steps(catalog, "waypoints", steps)
    made = [{**row, "commit_id": commit} for row in _transfer_rows(catalog, new)]
    return _add(catalog, "transfers", made, _repeated(table, again, {"planned_at": catalog.clock.now()}))


def _makes_way(stored: Row, status: str, run_id: str = "", foreign: bool = False) -> bool:
    """Whether a row of the same plan is added: after a failure a result, or another run's failure.

    And after what was imported and not measured here, what was.
    """
    if plan_rows.is_foreign(stored):
        return not foreign
    failed_again = status == "failed" and run_id in ("", stored["run_id"])
    return stored["status"] == "failed" and not failed_again


def keep_surface(catalog: Reading, plan: Plan) -> Plan:
    """See `Catalog.keep_surface`."""
    put = catalog.surfaces.put
    if plan.surface is not None:
        plan = replace(plan, surface=None, surface_sha256=put(plan.surface))
    if plan.inspected is not None:
        plan = replace(plan, inspected=None, inspected_sha256=put(plan.inspected))
    if plan.supposed is not None:
        plan = replace(plan, supposed=None, supposed_sha256=catalog.supposed_surfaces.put(plan.supposed))
    if plan.photos is not None:
        plan = replace(plan, photos=None, photos_sha256=catalog.plan_photos.put(plan.photos))
    return plan


def add_flight(catalog: Reading, row: Mapping[str, Any], path: Trajectory) -> int:
    """See `Catalog.add_flight`."""
    check_id(row["flight_id"], "flight id")
    catalog.transfer(row["transfer_id"], ("transfer_id",))  # one that nobody planned is an error
    return _add(catalog, "flights", [{**row, "flight_sha256": catalog.flown_paths.put(path)}])


def add_rows(catalog: Reading, name: str, made: list[Row]) -> int:
    """Commit rows that stand for themselves."""
    return _add(catalog, name, made)


def add_overruled(catalog: Reading, given: Sequence[Mapping[str, Any]]) -> int:
    """See `Catalog.add_overruled`."""
    made = {}
    for row in given:
        catalog.transfer(row["transfer_id"], ("transfer_id",))
        made[digest(dict(row))] = dict(row)
    known = set(catalog.overruled()["overruled_id"])
    return _add(
        catalog, "overruled", [{**row, "overruled_id": key} for key, row in made.items() if key not in known]
    )


def adopt_plans(catalog: Reading, plans: Sequence[Row], waypoints: Mapping[tuple[str, str], pa.Table]) -> int:
    """Add plans of another catalog as they are, with the steps that they own there."""
    stored = ordering.rows_of_keys(catalog.tables["transfers"], [row["key"] for row in plans])
    new = [
        row
        for row in plans
        if row["key"] not in stored
        or _makes_way(stored[row["key"]], row["status"], foreign=plan_rows.is_foreign(row))
    ]
    owned = [waypoints[row["transfer_id"], row["commit_id"]] for row in new if row["n_waypoints"]]
    commit = _add_steps(catalog, "waypoints", owned)
    undecided = dict.fromkeys(DERIVED)  # what was decided about them elsewhere is not decided here
    return _add(catalog, "transfers", [{**row, **undecided, "commit_id": commit} for row in new])


def retire(catalog: Reading, name: str, ids: Sequence[str]) -> int:
    """Add a version of structures or demonstrations that says they are out of use."""
    found = [catalog.newest(name, item) for item in dict.fromkeys(ids)]
    gone = [row for row in found if not row["retired"]]
    return _add(catalog, name, [], _repeated(catalog.tables[name], gone, {"retired": True}))


def _repeated(table: StoredTable, stored: Sequence[Row], changes: Mapping[str, Any]) -> pa.Table:
    """Stored rows again, with some columns changed; what a newer program wrote into them stays."""
    if not stored:
        return table.declared.schema.empty_table()
    key = table.declared.names[0]
    wanted = {(row[key], row["commit_id"], row["commit_version"]) for row in stored}
    found: dict[Any, Row] = {}
    whole = table.whole(pc.field(key).isin([row[key] for row in stored]))
    for row in rows.rows_of(whole):
        if (name := (row[key], row["commit_id"], row["commit_version"])) in wanted:
            found[name] = {**row, **changes}
    return pa.Table.from_pylist(list(found.values()), whole.schema)


def _transfer_rows(catalog: Reading, new: Mapping[str, tuple[Plan, Mapping[str, Any]]]) -> list[Row]:
    """Rows of new plans; hashes that the provenance leaves out are those of the current versions."""
    hashes: dict[str, str] = {}
    if any(_HASHES.keys() - said.keys() for _, said in new.values()):
        for table, name in (("structures", "structure_id"), ("demonstrations", "demonstration_id")):
            hashes.update(
                (f"{table}/{row[name]}", row["sha256"]) for row in ordering.newest_rows(catalog.tables[table])
            )
    made = []
    for key, (plan, provenance) in new.items():
        found = {
            column: hashes.get(f"{table}/{getattr(plan, name)}", "")
            for column, (table, name) in _HASHES.items()
        }
        made.append(plan_rows.transfer_row(key, plan, {**found, **provenance}))
    return made


_HASHES = {
    "demonstration_sha256": ("demonstrations", "demonstration_id"),
    "source_sha256": ("structures", "source_id"),
    "target_sha256": ("structures", "target_id"),
}


def _current(catalog: Reading, name: str) -> dict[str, Row]:
    return {row[TABLES[name].names[0]]: row for row in ordering.newest_rows(catalog.tables[name])}


def _known(name: str, stored: Row | None, given: Row) -> bool:
    return stored is not None and rows.says_same(TABLES[name], stored, given)


def _add(catalog: Reading, name: str, made: list[Row], more: pa.Table | None = None) -> int:
    """Commit rows; those that own steps carry the commit that brought these already."""
    commit = {"commit_id": new_commit_id(catalog)}
    new = rows.table_of(TABLES[name], [{**commit, **row} for row in made])
    new = new if more is None else pa.concat_tables([new, more], promote_options="default")
    if len(new):
        tidy(catalog.tables[name], catalog.tables[name].append(new))
    return len(new)


def _add_steps(catalog: Reading, name: str, steps: list[pa.Table]) -> str:
    """Keep steps, where there are any; returns the commit that the rows owning them must carry."""
    if not steps:
        return new_commit_id(catalog)
    table = catalog.tables[name]
    assert isinstance(table, StepTable)
    return table.keep(pa.concat_tables(steps), catalog.clock.now())


def new_commit_id(catalog: Reading) -> str:
    """A name that tells the time and is never given twice."""
    return f"{catalog.clock.now():%Y%m%d-%H%M%S-%f}-{secrets.token_hex(4)}"
