"""What was decided, flown and stored is not rewritten unseen; what is not what was released stays here."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import Catalog, compact, export_dataset, import_dataset, open_catalog, verify
from upplied.catalog.schema.steps import unlike
from upplied.catalog.schema.tables import TABLES
from upplied.catalog.store.chain import breaks
from upplied.catalog.verbs.custody import chain_heads
from upplied.errors import CatalogError, RefusedError, SettingsError
from upplied.outputs.missions import MissionOptions
from upplied.outputs.render import undecided

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
import custody as bench

FIRST = key_of("first")[:20]


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure(), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of("first"), replace(plan("target"), flyable=True), {})])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Catalog:
    """A catalog with something in every table and folder, which is only read."""
    place = tmp_path_factory.mktemp("filled")
    bench.write_catalog(place)
    return open_catalog(place)


def rules(catalog: Catalog, name: str = FIRST) -> list[str]:
    rows = catalog.transfers(every=True).set_index("transfer_id", drop=False)
    return [breach.rule for breach in undecided(catalog, rows.loc[name].to_dict())]


def rewritten(catalog: Catalog, name: str, change) -> Catalog:
    """The catalog after somebody wrote the rows of a table anew, as a program that knows Delta does."""
    rows = catalog.tables[name].whole().to_pylist()
    schema = catalog.tables[name].whole().schema
    for path in Path(catalog.tables[name].uri).glob("*.parquet"):
        rows_there = [
            row
            for row in rows
            if row[schema.names[0]] in set(pq.read_table(path)[schema.names[0]].to_pylist())
        ]
        pq.write_table(pa.Table.from_pylist([change(dict(row)) for row in rows_there], schema), path)
    return open_catalog(catalog.location)


# --- every byte and every field ----------------------------------------------------------------


@pytest.mark.slow
def test_rewritten_bytes_and_fields_are_found(tmp_path):
    counts, missed = bench.run(8, 1, tmp_path)
    assert missed == [] and counts["bytes"] == counts["fields"] == 4


@pytest.mark.parametrize("name", [name for name, table in TABLES.items() if "row_sha256" in table.names])
def test_each_field_of_a_row_is_part_of_its_hash(filled, name):
    """Whatever the file's own hash says: rows are compared as they are read."""
    table, rng = TABLES[name], random.Random(0)
    rows = filled.tables[name].whole()
    assert list(breaks(table, [rows])) == []
    for at, field in enumerate(rows.schema):
        values = rows[field.name].to_pylist()
        values[-1] = bench.another(values[-1], field.type, rng)
        other = rows.set_column(at, field, pa.array(values, field.type))
        assert list(breaks(table, [other])), field.name


def test_plans_with_added_passes_stand_beside_plans_that_store_no_origin(catalog):
    path = plan("target").trajectory
    added = np.arange(len(path)) > len(path) // 2
    passes = replace(plan("target"), added=added, preset="recommended")
    catalog.add_plans([(key_of("passes"), passes, {}), (key_of("other"), replace(passes, added=None), {})])
    assert verify(catalog) == []
    steps = catalog.tables["waypoints"].whole()
    steps = steps.sort_by([(name, "ascending") for name in ("transfer_id", "commit_id", "seq")])
    rows = catalog.transfers(every=True)
    names = zip(rows["transfer_id"], rows["commit_id"], strict=True)
    hashes = dict(zip(names, zip(rows["n_waypoints"], rows["waypoints_sha256"], strict=True), strict=True))
    assert list(unlike("waypoints", steps, hashes)) == []
    at, column = steps.schema.get_field_index("origin"), steps["origin"].to_pylist()
    column[column.index("added")] = "demonstrated"
    (fault,) = unlike("waypoints", steps.set_column(at, "origin", pa.array(column)), hashes)
    assert fault == (key_of("passes")[:20], "the steps do not match the hash in their row")


def test_rows_of_a_chain_that_are_taken_away_or_put_in_are_told(catalog):
    for at in range(4):
        catalog.review(FIRST, f"Ada {at}")
    table, rows = TABLES["decisions"], catalog.tables["decisions"].whole().sort_by("commit_version")
    assert list(breaks(table, [rows])) == [] == list(breaks(table, [rows.take([3, 1, 0, 2])]))
    (gap,) = breaks(table, [rows.take([0, 2, 3])])
    assert gap == (
        rows["decision_id"][2].as_py(),
        "follows a row that is not there: one was taken away or changed",
    )
    (twice,) = breaks(table, [pa.concat_tables([rows, rows.slice(3)])])
    assert "one of them was put in" in twice[1]
    (first,) = breaks(table, [rows.slice(1)])
    assert "taken away" in first[1]


def test_a_head_that_was_noted_tells_that_the_end_was_taken_away(catalog):
    catalog.review(FIRST, "Ada")
    catalog.reject(FIRST, "Ada", "too near")
    head = chain_heads(catalog)["decisions"]
    assert verify(catalog, [head[:20]]) == []
    catalog.release(FIRST, "Grace", force=["rejected"])
    assert verify(catalog, [head]) == [] and chain_heads(catalog)["decisions"] != head
    (lost,) = verify(catalog, ["0" * 20])
    assert "no row has this hash" in lost.found
    with pytest.raises(SettingsError, match="at least 12 digits"):
        verify(catalog, ["0"])


@pytest.mark.ci
def test_chains_hold_with_many_writers_and_after_merging(catalog):
    for at in range(20):
        open_catalog(catalog.location).review(FIRST, f"Ada {at}")
    compact(catalog)
    catalog.review(FIRST, "Grace")
    assert verify(open_catalog(catalog.location)) == []
    assert len(catalog.decisions()) == 21


def test_rows_that_a_log_no_longer_names_are_missed(catalog):
    from deltalake import DeltaTable

    catalog.add_plans([(key_of("second"), plan("target", 2), {})])
    DeltaTable(catalog.tables["transfers"].uri).delete("preset = 'recommended'")
    findings = [str(each) for each in verify(open_catalog(catalog.location))]
    assert any("transfers: has 0 rows, and 2 were added" in each for each in findings), findings


@pytest.mark.parametrize(("table", "column"), [("decisions", "by"), ("flights", "min_clearance_m")])
def test_a_rewritten_name_or_clearance_is_no_longer_read_as_true(filled, tmp_path, table, column):
    other = "Mallory" if column == "by" else 9.9
    changed = rewritten(copied(filled, tmp_path), table, lambda row: {**row, column: other})
    findings = [str(each) for each in verify(changed)]
    assert any(re.match(rf"{table} \S+: does not match its hash", each) for each in findings), findings
    if table == "decisions":
        assert all("its release does not match its hash" in words for words in changed.in_force()["altered"])


# --- what was released ---------------------------------------------------------------------------


def moved(row: dict) -> dict:
    return {**row, "x_m": row["x_m"] + 1.0}


def test_waypoints_that_were_moved_with_their_row_are_not_what_was_released(catalog):
    """The hash in the row follows the moved waypoints: only the release still knows the true one."""
    from upplied.catalog.schema.steps import pose_arrays, poses_sha256

    catalog.release(FIRST, "Grace")
    assert rules(catalog) == [] and list(catalog.in_force()["altered"]) == [""]
    for path in Path(catalog.location, "steps", "waypoints").glob("*.parquet"):
        table = pq.read_table(path)
        pq.write_table(pa.Table.from_pylist([moved(row) for row in table.to_pylist()], table.schema), path)
    steps = open_catalog(catalog.location).tables["waypoints"].read().sort_by("seq")
    flags = steps["is_viewpoint"].to_numpy(zero_copy_only=False)
    sha256 = poses_sha256(steps["t_s"].to_numpy(), *pose_arrays(steps), flags)
    changed = rewritten(catalog, "transfers", lambda row: {**row, "waypoints_sha256": sha256})
    assert changed.path_of(changed.transfer(FIRST)) is not None  # the steps fit their row
    assert rules(changed) == ["altered"]
    (words,) = changed.in_force()["altered"]
    assert words == "its waypoints are not those that were released"
    with pytest.raises(RefusedError, match=r"altered: its waypoints.*force=\[\"altered\"\]"):
        changed.trajectory(FIRST)


def test_a_row_that_was_rewritten_is_not_what_was_released(catalog):
    catalog.release(FIRST, "Grace")
    changed = rewritten(catalog, "transfers", lambda row: {**row, "min_clearance_m": 9.0})
    assert rules(changed) == ["altered"]
    assert list(changed.in_force()["altered"]) == ["its row differs from the one that was released"]


def test_a_row_that_was_rewritten_is_not_released(catalog):
    changed = rewritten(catalog, "transfers", lambda row: {**row, "min_clearance_m": 9.0})
    with pytest.raises(RefusedError, match="its row does not match its hash"):
        changed.release(FIRST, "Grace")


def test_a_released_plan_that_becomes_current_again_is_still_what_was_released(catalog):
    catalog.release(FIRST, "Grace")
    catalog.add_plans([(key_of("second"), plan("target", 2), {})])
    catalog.add_plans([(key_of("first"), replace(plan("target"), flyable=True), {})])  # asked for again
    assert list(catalog.transfers()["transfer_id"]) == [FIRST] and rules(catalog) == []
    assert list(catalog.in_force()["altered"]) == [""]


def test_what_nobody_released_as_it_is_leaves_as_a_draft_alone():
    for rule in ("released", "foreign", "altered"):
        with pytest.raises(SettingsError, match="Use --draft"):
            MissionOptions(force=(rule,))
        assert rule in MissionOptions(draft=True).overruled


# --- plans of others -----------------------------------------------------------------------------


@pytest.fixture
def imported(catalog, tmp_path) -> Catalog:
    export_dataset(catalog, tmp_path / "set", "boxes-v1", [FIRST], "CC0-1.0")
    there = open_catalog(tmp_path / "there")
    import_dataset(there, tmp_path / "set")
    return there


def test_an_imported_plan_settles_nothing_and_is_not_released_or_flown(imported):
    assert imported.settled([key_of("first")]) == {}
    assert imported.unsettled(pa.array([key_of("first")])).all()
    for force in ([], ["preset", "verdict", "changed"]):
        with pytest.raises(RefusedError, match=r"not measured here.*import it again with --verify"):
            imported.release(FIRST, "Grace", force=force)
    assert rules(imported) == ["released", "foreign"]
    with pytest.raises(RefusedError, match="foreign: it was imported and not measured here"):
        imported.trajectory(FIRST)
    assert len(imported.in_force()) == 0


def test_planned_or_measured_here_it_counts(imported, tmp_path):
    """The same key, planned here: its row takes the place of the imported one, with its own waypoints."""
    assert imported.add_plans([(key_of("first"), replace(plan("target", 5), flyable=True), {})]) == 1
    assert set(imported.settled([key_of("first")])) == {key_of("first")}
    assert imported.transfer(FIRST)["imported_from"] == ""
    imported.release(FIRST, "Grace")
    assert rules(imported) == [] and verify(imported) == []
    assert import_dataset(imported, tmp_path / "set")["transfers"] == 0  # and the import not of that


def test_an_imported_plan_that_is_measured_again_counts(imported, tmp_path):
    measured = import_dataset(imported, tmp_path / "set", measured=lambda _, plan: plan.measures)
    assert measured["transfers"] == 1
    assert set(imported.settled([key_of("first")])) == {key_of("first")}
    imported.release(FIRST, "Grace")
    assert rules(imported) == []


def listed(folder: Path, change) -> None:
    about = json.loads((folder / "dataset.json").read_text())
    change(about["files"])
    (folder / "dataset.json").write_text(json.dumps(about))


@pytest.mark.parametrize("how", ["missing", "unlisted", "fifo", "fifo unlisted", "link"])
@pytest.mark.parametrize("kind", ["samples", "surfaces", "meshes"])
def test_only_files_that_were_checked_are_read(catalog, tmp_path, how, kind):
    folder = tmp_path / "set"
    export_dataset(catalog, folder, "boxes-v1", [FIRST], "CC0-1.0")
    path = next((folder / kind).iterdir())
    name = str(path.relative_to(folder))
    if how == "link":
        shutil.move(path, tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    elif how != "unlisted":
        path.unlink()
    if "fifo" in how:
        os.mkfifo(path)
    if how in ("unlisted", "missing", "fifo unlisted"):
        listed(folder, lambda files: files.pop(name))
    there = open_catalog(tmp_path / "there")
    if kind == "surfaces" and how != "link" and how != "fifo":
        import_dataset(there, folder)  # a dataset may come without what its plans see
        assert there.surface(FIRST) is None
        return
    with pytest.raises(CatalogError, match=r"missing|not listed|outside"):
        import_dataset(there, folder)


def test_a_dataset_json_that_is_no_file_or_no_table_of_files_is_an_error(catalog, tmp_path):
    folder = tmp_path / "set"
    export_dataset(catalog, folder, "boxes-v1", [FIRST], "CC0-1.0")
    for content in ("[]", "{", '{"schema_version": 3, "files": [1]}', "[" * 100_000):
        (folder / "dataset.json").write_text(content)
        with pytest.raises(CatalogError, match="cannot be read"):
            import_dataset(open_catalog(tmp_path / "there"), folder)
    (folder / "dataset.json").unlink()
    os.mkfifo(folder / "dataset.json")
    with pytest.raises(CatalogError, match="no file"):
        import_dataset(open_catalog(tmp_path / "there"), folder)


# --- catalogs of before ----------------------------------------------------------------------------


@pytest.fixture
def older(tmp_path) -> Catalog:
    """A catalog of version 0.2.0 with a release, a review and a flight."""
    place = Path(__file__).parent / "released" / "0.2.0" / "catalog"
    return open_catalog(shutil.copytree(place, tmp_path / "older"))


def test_what_was_there_before_there_were_hashes_is_part_of_the_chain(older):
    assert verify(older) == [] and rules(older) == []
    older.review(FIRST, "Ada")
    older.review(FIRST, "Ada")
    assert verify(older) == []
    changed = rewritten(older, "decisions", lambda row: {**row, "by": row["by"].replace("Grace", "Mallory")})
    findings = [str(each) for each in verify(changed)]
    assert any("follows a row that is not there" in each for each in findings), findings


def test_a_hash_that_was_taken_off_is_told(older):
    older.add_structures([structure("third", 3)])
    changed = rewritten(older, "structures", lambda row: {**row, "row_sha256": None, "site": "elsewhere"})
    findings = [str(each) for each in verify(changed)]
    assert any("third: has no hash" in each for each in findings), findings
    assert not any("boxy: has no hash" in each for each in findings)


def test_every_table_of_one_place_is_a_chain():
    chained = {name for name, table in TABLES.items() if table.is_chained}
    assert chained == {
        *("decisions", "flights", "overruled", "settings", "requirements", "edits"),
        *("flight_photos", "findings"),
    }
