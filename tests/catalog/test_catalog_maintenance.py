"""Verification finds what is wrong; maintenance changes nothing that anybody reads."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import compact, export_tables, history, open_catalog, vacuum, verify
from upplied.catalog.database import Catalog
from upplied.catalog.schema.tables import SCHEMA_VERSION, STEPS, TABLES
from upplied.catalog.store import delta
from upplied.catalog.store.chain import decoded
from upplied.catalog.verbs import maintenance, verification
from upplied.errors import CatalogError, SettingsError
from upplied.records import Cloud

DAY = 86_400


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(4))])
    catalog.add_demonstrations([demonstration()])
    for night in range(3):
        batch = [
            (key_of(night, at), plan(f"t{at}", 10 * night + at), {"run_id": f"n{night}"}) for at in range(4)
        ]
        catalog.add_plans(batch)
    return catalog


@pytest.fixture
def catalog(begun, tmp_path):
    return copied(begun, tmp_path / "catalog")


def findings_in(catalog) -> str:
    return "\n".join(map(str, verify(catalog)))


def rewrite(catalog, name: str, change) -> None:
    """Put other rows in the place of those of a table, behind our back."""
    from deltalake import write_deltalake

    rows = catalog.tables[name].read().to_pandas()
    changed = change(rows)
    if name in STEPS:
        write_steps(catalog.tables[name], changed)
        return
    table = pa.Table.from_pandas(changed, TABLES[name].schema, preserve_index=False)
    write_deltalake(catalog.tables[name].uri, table, mode="overwrite")


def write_steps(table, rows: pd.DataFrame) -> None:
    """Put other steps in the place of those of each commit."""
    for path in Path(table.files.root).iterdir():
        path.unlink()
    for commit, own in rows.groupby("commit_id"):
        steps = pa.Table.from_pandas(own, table.declared.schema, preserve_index=False)
        pq.write_table(steps.drop_columns("commit_id"), table.files.path(f"{commit}.parquet"))


def test_a_sound_catalog_has_no_findings(catalog):
    assert findings_in(catalog) == ""
    assert verify(open_catalog(Path(catalog.location) / "nothing").create()) == []


@pytest.mark.parametrize(
    ("table", "change", "words"),
    [
        ("waypoints", lambda rows: rows.iloc[1:], "59 steps are stored, the row says 60"),
        (
            "waypoints",
            lambda rows: rows.assign(x_m=rows["x_m"].where(rows.index != 7, 0.0)),
            "hash in their row",
        ),
        ("waypoints", lambda rows: rows.assign(seq=rows["seq"].replace(5, 4)), "not numbered"),
        ("waypoints", lambda rows: rows.assign(t_s=-rows["t_s"]), "time does not increase"),
        ("poses", lambda rows: rows.assign(qw=rows["qw"] * 0.5), "poses of flight"),
        ("transfers", lambda rows: rows.assign(status="fine"), "'fine' is not required, one of ok"),
        (
            "transfers",
            lambda rows: rows.assign(frechet_m=-1.0),
            "transfers.frechet_m: '-1.0' is not at least 0",
        ),
        ("transfers", lambda rows: rows.assign(target_id="lost"), "lost is not in structures"),
        ("transfers", lambda rows: rows.assign(settings_sha256="0" * 64), "settings 000000000000"),
        ("structures", lambda rows: rows.assign(n_triangles=7), "other than stated of boxy"),
        ("structures", lambda rows: rows.assign(mesh_sha256="0" * 64), "cannot be read"),
        (
            "demonstrations",
            lambda rows: rows.assign(structure_id=""),
            "demonstrations.structure_id: '' is not",
        ),
    ],
)
def test_what_is_wrong_is_found(catalog, table, change, words):
    rewrite(catalog, table, change)
    assert words in findings_in(catalog)


def test_a_damaged_mesh_is_found(catalog):
    path = next(Path(catalog.contents["meshes"].files.root).iterdir())
    path.write_bytes(path.read_bytes()[:-100])
    assert f"{path}: is damaged; the mesh of" in findings_in(catalog)


@pytest.mark.parametrize("table", ["transfers", "waypoints", "structures"])
def test_a_damaged_file_of_a_table_is_a_finding_that_says_what_to_do(catalog, table):
    stored = catalog.tables[table]
    path = next(Path(stored.files.root if table in STEPS else stored.uri).glob("*.parquet"))
    path.write_bytes(path.read_bytes()[:200])
    findings = verify(open_catalog(catalog.location))
    assert [f for f in findings if path.name in f.found and "from a backup" in f.found], findings
    with pytest.raises(CatalogError, match="from a backup"):
        open_catalog(catalog.location).tables[table].read()


def test_plans_are_looked_at_some_at_a_time_and_told_of_once(catalog, monkeypatch):
    """A row of plans takes kilobytes, and there may be a million."""
    rewrite(catalog, "transfers", lambda rows: rows.assign(status="fine"))
    looked = []
    broken = verification.broken

    def noted(column, values):
        looked.append(len(values))
        return broken(column, values)

    monkeypatch.setattr(verification, "broken", noted)
    monkeypatch.setattr(delta, "ROW_GROUP", 5)
    monkeypatch.setattr(verification, "_ROWS", 5)
    findings = [str(f) for f in verify(catalog)]
    assert max(looked) == 5 and sum("and 7 more" in f and "'fine' is not" in f for f in findings) == 1, (
        findings
    )


def snapshot(catalog) -> list[pd.DataFrame]:
    return [
        catalog.transfers(every=True),
        catalog.waypoints(key_of(1, 1)[:20]),
        catalog.poses("flight"),
        catalog.structures(every=True),
        catalog.transfers(version=2),
    ]


def test_compaction_changes_no_answer_and_older_versions_stay(catalog):
    before = snapshot(catalog)
    merged = compact(catalog)
    assert merged["transfers"] == 3 and merged["waypoints"] == 0
    for left, right in zip(before, snapshot(catalog), strict=True):
        pd.testing.assert_frame_equal(left, right)
    assert sum(compact(catalog).values()) == 0
    assert "maintenance" in set(history(catalog)["operation"])
    assert findings_in(catalog) == ""


def aged(catalog, days: float) -> None:
    """Make every file look this old."""
    then = time.time() - days * DAY
    for path in Path(catalog.location).rglob("*"):
        if path.is_file() and "_delta_log" not in path.parts:
            os.utime(path, (then, then))


def test_vacuum_keeps_the_stated_history(catalog):
    before = snapshot(catalog)
    compact(catalog)
    aged(catalog, 40)
    report = vacuum(catalog, keep_days=30)  # merged just now, so their versions are young
    assert sum(report.files_removed.values()) == 0
    for left, right in zip(before, snapshot(catalog), strict=True):
        pd.testing.assert_frame_equal(left, right)
    with pytest.raises(SettingsError, match="at least"):
        vacuum(catalog, keep_days=0.01)


def test_vacuum_removes_what_stopped_writers_left_and_nothing_young(catalog, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(Catalog, "add_rows", lambda *_: 1 / 0)
        for number in range(2):
            with pytest.raises(ZeroDivisionError):
                catalog.add_plans([(key_of("lost", number), plan("t0", number), {})])
    root = Path(catalog.location)
    rows = catalog.transfers(every=True)["commit_id"].unique()
    steps = root / "steps" / "waypoints"
    old, young = sorted(path for path in steps.iterdir() if path.stem not in rows)
    os.utime(old, (time.time() - 40 * DAY,) * 2)
    leftovers = [
        root / "transfers" / "part-0.parquet#1",
        root / "meshes" / ".x.parquet.draft",
        root / "transfers" / "x.parquet",
    ]
    for path in leftovers:
        path.write_bytes(b"")
    assert vacuum(catalog, keep_days=30).drafts_removed == 0
    assert all(path.exists() for path in leftovers)
    for path in leftovers:
        os.utime(path, (time.time() - 40 * DAY,) * 2)
    assert len(list(steps.iterdir())) == 4  # three nights and what is young: the old one went at first
    assert young.exists() and not old.exists()
    report = vacuum(catalog, keep_days=30)
    assert report.drafts_removed == 2
    assert not any(path.exists() for path in leftovers)
    assert findings_in(catalog) == ""


def test_jobs_of_a_killed_run_go_by_age_and_those_of_a_run_at_work_stay(catalog):
    root = Path(catalog.shards.root)
    for run in ("killed", "long", "young"):
        for name in ("00000.jobs", "00001.jobs"):
            catalog.shards.write(f"{run}/{name}", b"{}")
    old = [root / "killed" / "00000.jobs", root / "killed" / "00001.jobs", root / "long" / "00000.jobs"]
    for path in old:
        os.utime(path, (time.time() - 40 * DAY,) * 2)
    assert vacuum(catalog, keep_days=50).runs_removed == 0
    assert vacuum(catalog, keep_days=30).runs_removed == 1
    assert catalog.shards.names() == ["long", "young"]  # of the long run, one shard was worked on lately
    assert len(list((root / "long").iterdir())) == 2
    assert vacuum(catalog, keep_days=30).runs_removed == 0


def test_vacuum_bounds_the_cache(catalog):
    for number in range(3):
        catalog.cache.put("clouds", key_of(number), Cloud(np.ones((number + 1, 3))))
    assert len(catalog.cache.entries()) == 3
    assert vacuum(catalog, cache_bytes=0).cache_bytes_freed > 0
    assert catalog.cache.entries() == []


def test_two_merges_at_the_same_time_do_not_double_rows(catalog, monkeypatch):
    """The second one finds the files of the first gone, and leaves it at that."""
    other = open_catalog(catalog.location)
    before = snapshot(catalog)
    merge_oldest, met = maintenance._oldest_small, []

    def meanwhile(table, delta, size_bytes):
        if table.uri not in met:
            met.append(table.uri)
            maintenance.merge(other.tables[table.declared.name], size_bytes)  # `delta` does not know of it
        return merge_oldest(table, delta, size_bytes)

    with monkeypatch.context() as patched:
        patched.setattr(maintenance, "_oldest_small", meanwhile)
        compact(catalog)
    for left, right in zip(before, snapshot(open_catalog(catalog.location)), strict=True):
        pd.testing.assert_frame_equal(left, right)
    assert findings_in(catalog) == ""


def test_a_merge_holds_no_more_rows_in_memory_than_it_may(catalog, monkeypatch):
    """Rows that repeat are small in their file only."""
    table = catalog.tables["transfers"]
    per_file = table.read().nbytes / 3
    monkeypatch.setattr(maintenance, "DECODED_BYTES", 2.5 * per_file)
    before = snapshot(catalog)
    assert compact(catalog)["transfers"] == 2
    assert compact(catalog)["transfers"] == 0, "what is large in memory is not merged again"
    for left, right in zip(before, snapshot(catalog), strict=True):
        pd.testing.assert_frame_equal(left, right)


def test_who_reads_slowly_is_not_read_ahead_of(catalog):
    """Else a million plans lie in memory, decoded, before the first of them is written."""
    table = catalog.tables["waypoints"]
    rows = table.read()
    many = rows.take(pa.array(np.resize(np.arange(len(rows)), 400_000)))
    for number in range(2):
        table.keep(many, datetime.now(UTC) + timedelta(seconds=number))
    whole = 2 * many.nbytes
    del many, rows
    before, most = pa.total_allocated_bytes(), 0
    for number, _ in enumerate(table.batches(TABLES["waypoints"].names)):
        if number < 6:
            time.sleep(0.1)
        most = max(most, pa.total_allocated_bytes() - before)
    assert number > 40
    assert most < 0.4 * whole


def test_texts_that_repeat_are_kept_once_and_say_the_same(catalog):
    table, names = catalog.tables["transfers"], TABLES["transfers"].names
    narrow = table.narrow(names)
    assert pa.types.is_dictionary(narrow.schema.field("settings_json").type)
    assert len(narrow["settings_json"].combine_chunks().dictionary) == 1
    assert decoded(narrow).to_pydict() == table.read(None, names).to_pydict()


def test_published_files_hold_the_current_rows(catalog, tmp_path):
    catalog.add_plans([(key_of("no"), plan("t3", status="refused", preset="paper"), {})])
    counts = export_tables(catalog, tmp_path / "reports")
    expected = {
        "transfers": 5, "structures": 5, "demonstrations": 1, "waypoints": 240, "poses": 50, "flights": 0,
        "decisions": 0, "overruled": 0, "settings": 0, "requirements": 0, "edits": 0,
        "flight_photos": 0, "findings": 0,
    }  # fmt: skip
    assert counts == expected
    read = {name: pd.read_parquet(tmp_path / "reports" / f"{name}.parquet") for name in TABLES}
    for name, frame in read.items():
        assert list(frame.columns) == TABLES[name].names
    pd.testing.assert_frame_equal(read["transfers"], catalog.transfers(), check_dtype=False)
    one = read["waypoints"][read["waypoints"]["transfer_id"] == key_of(2, 1)[:20]].reset_index(drop=True)
    pd.testing.assert_frame_equal(one, catalog.waypoints(key_of(2, 1)[:20]), check_dtype=False)
    assert set(read["waypoints"]["transfer_id"]) == set(
        read["transfers"].query("status == 'ok'")["transfer_id"]
    )
    assert {path.name for path in (tmp_path / "reports").glob("[!.]*")} == {
        "tables",
        *(f"{name}.parquet" for name in TABLES),
    }


def test_published_files_say_units_and_version(catalog, tmp_path):
    export_tables(catalog, tmp_path)
    for path in (tmp_path / "waypoints.parquet").rglob("*.parquet"):
        schema = pa.parquet.read_schema(path)
        assert schema.field("t_s").metadata[b"unit"] == b"s"
        assert schema.metadata[b"schema_version"] == str(SCHEMA_VERSION).encode()


def test_publishing_in_pieces_gives_the_same(catalog, tmp_path, monkeypatch):
    from upplied.catalog.verbs import custody, parted, published

    export_tables(catalog, tmp_path / "whole")
    monkeypatch.setattr(custody, "CHUNK", 70)
    monkeypatch.setattr(parted, "_LOT", 3)
    monkeypatch.setattr(published, "_ROW_GROUP", 2)
    export_tables(catalog, tmp_path / "pieces")
    for name in TABLES:
        left, right = (pd.read_parquet(tmp_path / at / f"{name}.parquet") for at in ("whole", "pieces"))
        pd.testing.assert_frame_equal(left, right)


def test_a_publication_that_fails_leaves_what_was_there(catalog, tmp_path):
    export_tables(catalog, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("tables/*/**/*") if path.is_file()}
    assert len(before) > 5
    catalog.add_plans([(key_of("late"), plan("t0", 77), {})])
    rewrite(catalog, "waypoints", lambda rows: pd.concat([rows, rows[rows["seq"] == 0]]))
    with pytest.raises(CatalogError):
        export_tables(open_catalog(catalog.location), tmp_path)
    rewrite(catalog, "waypoints", lambda rows: rows.iloc[:0])
    with pytest.raises(CatalogError, match="catalog verify"):
        export_tables(catalog, tmp_path)
    after = {path: path.read_bytes() for path in tmp_path.rglob("tables/*/**/*") if path.is_file()}
    assert after == before
    assert not list(tmp_path.rglob("*.draft"))
