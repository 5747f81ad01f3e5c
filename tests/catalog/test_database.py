"""The catalog keeps what was put in, once, and never a part of it."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from catalog_records import demonstration, differences, key_of, plan, structure

import upplied
from upplied.catalog.database import Catalog, open_catalog
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.verbs import adding, ordering
from upplied.errors import CatalogError, InputError


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    return open_catalog(tmp_path / "catalog")


def plans(count: int, run: str = "run", **fields) -> list:
    return [(key_of(at), plan(f"t{at}", at, **fields), {"run_id": run}) for at in range(count)]


def test_it_is_a_public_name():
    assert upplied.open_catalog is open_catalog
    assert "open_catalog" in dir(upplied)
    with pytest.raises(AttributeError):
        _ = upplied.open_catalogue


def test_an_empty_catalog_answers_with_declared_columns(catalog):
    catalog.create()
    assert list(catalog.transfers().columns) == TABLES["transfers"].names
    assert catalog.structures().empty
    assert catalog.demonstrations().empty
    assert set(catalog.settled([key_of(0)], retry_failed=True)) == set()


def test_records_come_back_equal(catalog):
    structures = (
        structure(),
        structure("cloud", 1, triangles=np.empty((0, 3), np.int64), normals=np.ones((60, 3))),
    )
    flown = demonstration()
    record = plan()
    assert catalog.add_structures(structures) == 2
    assert catalog.add_demonstrations([flown]) == 1
    assert catalog.add_plans([(key_of(0), record, {})]) == 1
    again = open_catalog(catalog.location)  # as another process sees it
    assert differences(structures[0], again.structure("boxy")) == []
    assert differences(structures[1], again.structure("cloud")) == []
    assert differences(flown, again.demonstration("flight")) == []
    name = again.transfers()["transfer_id"][0]
    assert differences(record, replace(again.plan(name), surface=again.surface(name))) == []


@pytest.mark.parametrize("most_rows", [0, 100])
def test_the_current_version_of_one_row_is_that_of_the_whole_table(catalog, monkeypatch, most_rows):
    monkeypatch.setattr(ordering, "_MOST_ROWS", most_rows)
    catalog.add_structures([structure(f"s{at}", at) for at in range(3)])
    other = open_catalog(catalog.location)  # holds what it read, and must see what others write
    for act in (
        lambda: None,
        lambda: catalog.add_structures([structure("s1", 1, notes="repainted"), structure("s3", 3)]),
        lambda: catalog.retire_structures(["s2"]),
        lambda: catalog.add_structures([structure("s1", 1)]),
    ):
        act()
        known = ordering.newest_rows(catalog.tables["structures"])
        assert {name: other.newest("structures", name) for name in known} == known
        with pytest.raises(CatalogError, match="structure s9: is not in the catalog"):
            other.newest("structures", "s9")


def test_a_plan_is_kept_in_two_parts_as_in_one(catalog):
    record = plan()
    catalog.add_plans([(key_of(0), catalog.keep_surface(record), {})])
    name = catalog.transfers()["transfer_id"][0]
    assert record.surface is not None
    assert differences(record.surface, catalog.surface(name)) == []


def test_steps_are_tables_as_well(catalog):
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans(plans(3))
    poses = catalog.poses("flight")
    assert list(poses["seq"]) == list(range(50))
    assert np.array_equal(poses[["x_m", "y_m", "z_m"]], demonstration().positions)
    waypoints = catalog.waypoints(key_of(2)[:20])
    assert np.array_equal(waypoints["t_s"], plan("t2", 2).trajectory.t_s)
    assert poses.attrs["units"]["t_ns"] == "ns"


def test_the_same_again_adds_no_row(catalog):
    for _ in range(2):
        catalog.add_structures([structure()])
        catalog.add_demonstrations([demonstration()])
        catalog.add_plans(plans(4))
    assert catalog.add_structures([structure()]) == 0
    assert catalog.add_plans(plans(4, run="tomorrow")) == 0
    for name, count in {
        "structures": 1,
        "demonstrations": 1,
        "poses": 50,
        "transfers": 4,
        "waypoints": 240,
    }.items():
        assert len(catalog.tables[name].read()) == count


def test_a_change_is_a_newer_version_and_the_older_stays(catalog):
    catalog.add_structures([structure()])
    catalog.add_demonstrations([demonstration()])
    catalog.add_structures([structure(seed=1)])
    catalog.add_demonstrations([demonstration(seed=1, count=30)])
    assert differences(structure(seed=1), catalog.structure("boxy")) == []
    assert differences(demonstration(seed=1, count=30), catalog.demonstration("flight")) == []
    assert list(catalog.structures(every=True)["version"]) == [1, 2]
    assert list(catalog.structures()["version"]) == [2]
    first = catalog.demonstrations(every=True).iloc[0].to_dict()
    assert differences(demonstration(), catalog.demonstration_of(first)) == []
    catalog.add_structures([structure()])  # and back again
    assert differences(structure(), catalog.structure("boxy")) == []
    assert list(catalog.structures(every=True)["version"]) == [1, 2, 3]


@pytest.mark.parametrize("changes", [{"kind": "ship"}, {"placement": None}, {"notes": "moved"}])
def test_a_change_of_what_is_said_of_the_same_mesh_shows(catalog, changes):
    catalog.add_structures([structure()])
    assert catalog.add_structures([structure(**changes)]) == 1
    row = catalog.structures().iloc[0].to_dict()
    assert differences(structure(**changes), catalog.structure("boxy")) == []
    assert row["version"] == 2
    for name, value in changes.items():
        assert name == "placement" or row[name] == value
    assert np.isnan(row["lat_deg"]) == (changes.get("placement", 0) is None)


def test_the_same_version_added_by_two_writers_counts_once(catalog):
    catalog.add_structures([structure(placement=None)])
    table = catalog.tables["structures"]
    table.append(table.read())
    assert list(catalog.structures(every=True)["version"]) == [1]


def test_a_mesh_is_kept_once(catalog):
    catalog.add_structures([structure("a"), structure("b"), structure("a", notes="moved")])
    assert len(list(Path(catalog.contents["meshes"].files.root).iterdir())) == 1


def test_retired_structures_leave_the_fleet_and_may_return(catalog):
    catalog.add_structures([structure("a"), structure("b")])
    assert catalog.retire_structures(["a"]) == 1
    assert catalog.retire_structures(["a"]) == 0
    assert list(catalog.structures()["structure_id"]) == ["b"]
    assert differences(structure("a"), catalog.structure("a")) == []  # for old plans
    assert catalog.add_structures([structure("a")]) == 1
    assert list(catalog.structures()["structure_id"]) == ["a", "b"]


def test_retired_demonstrations_keep_their_poses(catalog):
    catalog.add_demonstrations([demonstration()])
    catalog.retire_demonstrations(["flight"])
    assert catalog.demonstrations().empty
    assert differences(demonstration(), catalog.demonstration("flight")) == []


def test_refused_and_failed_plans_are_rows_with_a_reason(catalog):
    catalog.add_plans([(key_of(s), plan(f"t-{s}", status=s), {}) for s in ("ok", "refused", "failed")])
    rows = catalog.transfers().set_index("status")
    assert set(rows.index) == {"ok", "refused", "failed"}
    assert "does not fit" in rows.loc["refused", "reason"]
    with pytest.raises(CatalogError, match="refused: does not fit"):
        catalog.trajectory(rows.loc["refused", "transfer_id"])


def test_a_failure_makes_way_for_a_later_result_and_not_the_other_way(catalog):
    key = key_of("job")
    catalog.add_plans([(key, plan(status="failed"), {})])
    assert set(catalog.settled([key], retry_failed=True)) == set()
    assert catalog.add_plans([(key, plan(status="failed"), {})]) == 0
    assert catalog.add_plans([(key, plan(), {})]) == 1
    assert set(catalog.settled([key, key_of("other")], retry_failed=True)) == {key}
    assert catalog.add_plans([(key, plan(status="failed"), {})]) == 0
    assert list(catalog.transfers(every=True)["status"]) == ["ok"]
    assert differences(plan().trajectory, catalog.plan(key[:20]).trajectory) == []


def test_a_plan_asked_for_again_becomes_current_again(catalog):
    catalog.add_plans([(key_of("old"), plan(seed=1), {})])
    catalog.add_plans([(key_of("new"), plan(seed=2), {})])
    assert catalog.transfers()["key"][0] == key_of("new")
    assert catalog.add_plans([(key_of("old"), plan(seed=1), {})]) == 1
    assert catalog.transfers()["key"][0] == key_of("old")
    assert catalog.add_plans([(key_of("old"), plan(seed=1), {})]) == 0
    assert len(catalog.transfers(every=True)) == 2
    assert differences(plan(seed=1).trajectory, catalog.plan(key_of("old")[:20]).trajectory) == []


def test_racing_writers_of_one_key_are_one_plan(catalog, monkeypatch):
    other = open_catalog(catalog.location)
    monkeypatch.setattr(adding.ordering, "rows_of_keys", lambda table, keys: {})  # neither knows of the other
    for writer in (catalog, other):
        writer.add_plans(plans(3))
    assert len(catalog.tables["transfers"].read()) == 6
    assert len(catalog.transfers()) == len(catalog.transfers(every=True)) == 3
    assert differences(plan("t1", 1).trajectory, catalog.plan(key_of(1)[:20]).trajectory) == []
    assert len(catalog.waypoints(key_of(1)[:20])) == 60


def test_a_writer_stopped_between_points_and_row_leaves_nothing_to_see(catalog, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Catalog, "add_rows", stopped)
        with pytest.raises(KeyboardInterrupt):
            catalog.add_plans(plans(2))
    assert len(catalog.tables["waypoints"].read()) == 120
    assert catalog.transfers().empty
    catalog.add_plans(plans(2))  # the next run: the points of the stopped one are not mixed in
    assert len(catalog.waypoints(key_of(0)[:20])) == 60


def test_points_that_are_not_all_there_are_never_handed_out(catalog):
    catalog.add_plans(plans(1))
    from test_catalog_maintenance import rewrite

    row = catalog.transfer(key_of(0)[:20])
    rewrite(catalog, "waypoints", lambda rows: pd.concat([rows, rows[rows["seq"] == 0]]))
    with pytest.raises(CatalogError, match="61 steps"):
        catalog.trajectory(row["transfer_id"])


def test_hashes_are_looked_up_where_they_are_not_said(catalog):
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    when = datetime(2026, 1, 2, tzinfo=UTC)
    catalog.add_plans([(key_of(0), plan(), {"target_sha256": "said", "planned_at": when})])
    row = catalog.transfer(key_of(0)[:20])
    assert row["source_sha256"] == structure("boxy").sha256
    assert row["demonstration_sha256"] == demonstration().sha256
    assert row["target_sha256"] == "said"
    assert row["planned_at"] == when


@pytest.mark.parametrize("name", ["../up", "a b", "", "x" * 65])
def test_names_that_are_not_safe_are_refused(catalog, name: str):
    with pytest.raises(InputError):
        catalog.add_structures([structure(name)])
    with pytest.raises(InputError):
        catalog.add_plans([(name, plan(), {})])
    with pytest.raises(InputError):
        catalog.structure(name)
    assert not (Path(catalog.location) / "transfers").exists()


def test_unknown_names_are_said(catalog):
    catalog.add_structures([structure()])
    for ask in (catalog.structure, catalog.demonstration, catalog.trajectory, catalog.waypoints):
        with pytest.raises(CatalogError, match="nothing-like-it"):
            ask("nothing-like-it")


def test_a_damaged_mesh_is_noticed(catalog):
    catalog.add_structures([structure()])
    path = next(Path(catalog.contents["meshes"].files.root).iterdir())
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(CatalogError, match=path.stem[:12]):
        catalog.structure("boxy")
