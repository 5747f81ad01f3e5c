"""Published tables: one generation at a time, only what changed, never older over newer."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import compact, export_tables, open_catalog, published_tables
from upplied.catalog.database import Catalog
from upplied.catalog.verbs import published
from upplied.cli import main
from upplied.errors import CatalogError
from upplied.outputs.publish import publish

TESTS = str(Path(__file__).parents[1])


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at) for at in range(6))])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan(f"t{at}", at), {"planned_at": night(at % 3)}) for at in range(6)])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def night(month: int) -> pd.Timestamp:
    return pd.Timestamp(2026, 1 + month, 5, tz="UTC")


def stamps(place: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of every table file that a reader finds."""
    current = (place / "tables" / "current").resolve()
    return {
        str(path.relative_to(current)): (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in current.rglob("*.parquet")
        if path.is_file()
    }


def whole(place: Path) -> int:
    """How many plans are published, each with its points."""
    tables = published_tables(place)
    transfers = pd.read_parquet(tables["transfers"])
    points = pd.read_parquet(tables["waypoints"])["transfer_id"].value_counts()
    assert sorted(points.index) == sorted(transfers.query("n_waypoints > 0")["transfer_id"])
    assert (points == 60).all()
    return len(transfers)


def test_any_program_reads_them(catalog, tmp_path):
    import duckdb

    export_tables(catalog, tmp_path / "out")
    transfers = pd.read_parquet(tmp_path / "out" / "transfers.parquet")
    pd.testing.assert_frame_equal(transfers, catalog.transfers(), check_dtype=False)
    one = pd.read_parquet(
        tmp_path / "out" / "waypoints.parquet", filters=[("transfer_id", "==", key_of(3)[:20])]
    )
    pd.testing.assert_frame_equal(one, catalog.waypoints(key_of(3)[:20]), check_dtype=False)
    result = duckdb.sql(
        f"SELECT count(*) FROM '{tmp_path}/out/waypoints.parquet/**/*.parquet' "
        f"JOIN '{tmp_path}/out/transfers.parquet/**/*.parquet' USING (transfer_id)"
    )
    assert result.df().iloc[0, 0] == 360


def test_what_did_not_change_is_not_written_again(catalog, tmp_path, monkeypatch):
    monkeypatch.setattr(published.parted, "_STEPS", 100)
    monkeypatch.setattr(published.parted, "_PLANS", 2)
    place = tmp_path / "out"
    export_tables(catalog, place)
    before = stamps(place)
    assert sum(name.startswith("waypoints.parquet/box/") for name in before) > 2
    export_tables(catalog, place)
    assert stamps(place) == before
    compact(catalog)
    export_tables(catalog, place)
    assert stamps(place) == before
    catalog.add_plans([(key_of("new"), plan("t1", 99), {"planned_at": night(3)})])
    export_tables(catalog, place)
    after = stamps(place)
    assert whole(place) == 6
    new = {name for name in after if before.get(name) != after[name]}
    assert sorted(name.split("/")[0] for name in new) == ["transfers.parquet", "waypoints.parquet"]
    assert {name.rpartition("-")[0] for name in before} == {name.rpartition("-")[0] for name in after}
    pd.testing.assert_frame_equal(
        pd.read_parquet(place / "transfers.parquet").sort_values("transfer_id", ignore_index=True),
        catalog.transfers().sort_values("transfer_id", ignore_index=True),
        check_dtype=False,
    )


def test_a_table_without_a_new_commit_is_not_read_again(catalog, tmp_path, monkeypatch):
    place = tmp_path / "out"
    catalog.set("kind", "box", {"route.clearance_m": 3.0}, "me")
    export_tables(catalog, place)
    with monkeypatch.context() as patched:
        patched.setattr(Catalog, "declared_settings", lambda _: 1 / 0)
        patched.setattr(Catalog, "flights", lambda _: 1 / 0)
        catalog.add_structures([structure("t7", 7)])
        assert export_tables(catalog, place)["settings"] == 1
        patched.setattr(published, "_COLUMNS", "those of a newer program")
        with pytest.raises(ZeroDivisionError):
            export_tables(catalog, place)
    catalog.set("kind", "box", {"route.clearance_m": 4.0}, "me")
    assert export_tables(catalog, place)["settings"] == 2
    assert list(pd.read_parquet(place / "settings.parquet")["value_json"]) == ["3.0", "4.0"]


def test_a_changed_file_is_made_from_the_one_before_and_what_changed(catalog, tmp_path, monkeypatch):
    place = tmp_path / "out"
    export_tables(catalog, place)
    catalog.add_plans([(key_of("new"), plan("t1", 99), {"planned_at": night(3)})])
    catalog.review(key_of(3)[:20], "me")
    catalog.retire_structures(["t5"])
    read, stored = [], published.parted.custody.stored_steps

    def noted(catalog, name, owners):
        read.extend(owners.iloc[:, 0])
        return stored(catalog, name, owners)

    monkeypatch.setattr(published.parted.custody, "stored_steps", noted)
    export_tables(catalog, place)
    assert read == [key_of("new")[:20]]
    assert whole(place) == 5
    anew = tmp_path / "anew"
    export_tables(catalog, anew)
    files = {str(path.relative_to(anew)) for path in anew.glob("tables/g*/**/*.parquet") if path.is_file()}
    assert files == {
        str(path.relative_to(place)).replace("g000002", "g000001")
        for path in place.glob("tables/g000002/**/*.parquet")
        if path.is_file()
    }
    for name in ("transfers", "waypoints"):
        left, right = (pd.read_parquet(at / f"{name}.parquet") for at in (place, anew))
        pd.testing.assert_frame_equal(left, right)
    states = pd.read_parquet(place / "transfers.parquet").set_index("transfer_id")["state"]
    assert states[key_of(3)[:20]] == "reviewed" and (states == "draft").sum() == 4


def test_a_damaged_file_of_before_is_no_source_of_steps(catalog, tmp_path):
    """It is read, compared with the hash in its row, and told of; never published again."""
    place = tmp_path / "out"
    export_tables(catalog, place)
    new = plan("t1", 99)
    catalog.add_plans([(key_of("new"), new, {"planned_at": night(3)})])
    catalog.add_structures([structure("near")])
    export_tables(catalog, place)
    for path in (place / "tables" / "current").resolve().glob("waypoints.parquet/box/*.parquet"):
        rows = pd.read_parquet(path)
        path.unlink()
        rows.assign(x_m=rows["x_m"] + 1).to_parquet(path)
    before = os.readlink(place / "tables" / "current")
    for number in range(6):  # some file that changes has plans that stay
        catalog.add_plans([(key_of("more", number), plan(f"t{number}", number, preset="paper"), {})])
    with pytest.raises(CatalogError, match="hash in their row"):
        export_tables(catalog, place)
    assert os.readlink(place / "tables" / "current") == before


def test_large_tables_are_split_by_target(catalog, tmp_path, monkeypatch):
    monkeypatch.setattr(published.parted, "_STEPS", 10_000)
    export_tables(catalog, tmp_path / "one")
    monkeypatch.setattr(published.parted, "_STEPS", 50)
    monkeypatch.setattr(published.parted, "_PLANS", 1)
    monkeypatch.setattr(published.parted, "_LOT", 2)
    monkeypatch.setattr(published.parted.custody, "CHUNK", 130)
    place = tmp_path / "out"
    export_tables(catalog, place)
    for name in ("waypoints", "transfers"):
        assert len([file for file in stamps(place) if file.startswith(name)]) > 3
        assert len([file for file in stamps(tmp_path / "one") if file.startswith(name)]) == 1
    assert whole(place) == 6
    left, right = (
        pd.read_parquet(at / "waypoints.parquet").sort_values(["transfer_id", "seq"]).reset_index(drop=True)
        for at in (tmp_path / "one", place)
    )
    pd.testing.assert_frame_equal(left, right)


def test_an_older_state_never_replaces_a_newer_one(catalog, tmp_path):
    place = tmp_path / "out"
    shutil.copytree(catalog.location, tmp_path / "backup")
    catalog.add_plans([(key_of("new"), plan("boxy", 99), {})])
    export_tables(catalog, place)
    page = place / "transfers" / "flight--boxy.html"
    page.parent.mkdir()
    page.write_text("as it was")
    before = stamps(place)
    older = open_catalog(tmp_path / "backup")
    for act in (lambda: export_tables(older, place), lambda: publish(older, place, pictures=0)):
        with pytest.raises(CatalogError, match=r"newer publication: .*transfers.*--force"):
            act()
    assert stamps(place) == before
    assert page.read_text() == "as it was"
    export_tables(older, place, force=True)
    assert whole(place) == 6


@pytest.mark.slow
def test_another_catalog_and_an_empty_one_replace_nothing(catalog, tmp_path, capsys):
    place = tmp_path / "out"
    publish(catalog, place, pictures=0)
    files = sorted(place.rglob("*"))
    other = open_catalog(tmp_path / "other").create()
    with pytest.raises(CatalogError, match="publication of another catalog"):
        publish(other, place, pictures=0)
    catalog.retire_structures([f"t{at}" for at in range(6)])
    with pytest.raises(CatalogError, match="does not shrink to nothing"):
        publish(catalog, place, pictures=0)
    with pytest.raises(CatalogError, match="is no catalog"):
        publish(open_catalog(tmp_path / "nothing"), place, pictures=0)
    assert sorted(place.rglob("*")) == files
    assert main(["report", str(place), "--catalog", catalog.location]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["report", str(place), "--catalog", catalog.location, "--force"]) == 0
    assert whole(place) == 0


@pytest.mark.parametrize("folder", ["s3://bucket/reports", "gs://b", "s3:/bucket/reports"])
def test_an_object_store_is_refused(catalog, tmp_path, monkeypatch, folder, capsys):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    for act in (export_tables, publish):
        with pytest.raises(CatalogError, match="is no folder"):
            act(catalog, folder)
    assert main(["report", folder, "--catalog", catalog.location]) == 2
    assert "is no folder" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def test_a_publication_of_an_earlier_version_is_taken_over(catalog, tmp_path):
    place = tmp_path / "out"
    place.mkdir()
    (place / "notes.txt").write_text("somebody's")
    for name in ("transfers", "waypoints"):
        (place / f"{name}.parquet").write_bytes(b"of an earlier version")
    (place / ".waypoints.0123abcd.draft").write_bytes(b"left")
    export_tables(catalog, place)
    assert whole(place) == 6
    assert len(pd.read_parquet(place / "transfers.parquet")) == 6
    assert (place / "notes.txt").exists()


PUBLISHER = """
import sys; sys.path.insert(0, sys.argv[1])
from upplied.catalog import export_tables, open_catalog
catalog = open_catalog(sys.argv[2])
print("ready", flush=True)
while True:
    export_tables(catalog, sys.argv[3])
"""


@pytest.mark.ci
def test_a_publisher_that_is_killed_leaves_one_generation_whole(catalog, tmp_path):
    place, rng = tmp_path / "out", random.Random(0)
    export_tables(catalog, place)
    seen = 6
    for number in range(3):
        catalog.add_plans([(key_of("more", number), plan("boxy", number, preset="paper"), {})])
        catalog.add_plans([(key_of("next", number), plan(f"t{number % 6}", 50 + number), {})])
        run = [sys.executable, "-c", PUBLISHER, TESTS, catalog.location, str(place)]
        process = subprocess.Popen(run, stdout=subprocess.PIPE)
        assert process.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0.0, 0.12))
        process.kill()
        process.wait()
        now = whole(place)
        assert now >= seen
        seen = now
    assert export_tables(catalog, place)["transfers"] == 7
    assert whole(place) == 7
    assert not [path for path in place.rglob("*") if path.name.endswith((".draft", ".partial"))]
    assert len([path for path in (place / "tables").iterdir() if path.is_dir()]) <= 3


@pytest.mark.ci
def test_readers_and_publishers_at_once_see_one_generation(catalog, tmp_path):
    place = tmp_path / "out"
    export_tables(catalog, place)
    run = [sys.executable, "-c", PUBLISHER, TESTS, catalog.location, str(place)]
    processes = [subprocess.Popen(run, stdout=subprocess.PIPE) for _ in range(2)]
    try:
        for process in processes:
            assert process.stdout.readline() == b"ready\n"
        for number in range(5):
            catalog.add_plans([(key_of("next", number), plan(f"t{number % 6}", 50 + number), {})])
            assert whole(place) == 6
            assert all(process.poll() is None for process in processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.ci
def test_publishers_take_turns(catalog, tmp_path):
    place = tmp_path / "out"
    with ThreadPoolExecutor(4) as threads:
        results = list(threads.map(lambda _: export_tables(open_catalog(catalog.location), place), range(8)))
    assert all(counts == results[0] for counts in results)
    assert whole(place) == 6
    assert os.readlink(place / "tables" / "current") == "g000001"


def test_what_is_published_says_of_which_catalog_and_when(catalog, tmp_path):
    import json

    export_tables(catalog, tmp_path / "out")
    manifest = json.loads((tmp_path / "out" / "tables" / "current" / "published.json").read_text())
    assert manifest["catalog"] == catalog.identity.id
    assert manifest["versions"]["transfers"] == catalog.tables["transfers"].delta().version()
    assert manifest["rows"]["waypoints"] == 360
    with pytest.raises(CatalogError, match="nothing is published"):
        published_tables(tmp_path / "nowhere")


def published_files(place: Path) -> dict[str, pd.DataFrame]:
    """Every table file that a reader finds, by its name, and its rows."""
    root = (place / "tables" / "current").resolve()
    return {str(path.relative_to(root)): pd.read_parquet(path) for path in root.rglob("*.parquet")}


def assert_as_anew(catalog: Catalog, place: Path, anew: Path) -> None:
    """What is published in a place, over what was there, is what a first publication gives, file by file."""
    counts = export_tables(catalog, place)
    assert counts == export_tables(catalog, anew)
    left, right = published_files(place), published_files(anew)
    assert left.keys() == right.keys()
    for name, rows in left.items():
        pd.testing.assert_frame_equal(rows, right[name])


@pytest.fixture(scope="module")
def many(tmp_path_factory) -> Catalog:
    """A catalog whose tables are many files, if these are small."""
    catalog = open_catalog(tmp_path_factory.mktemp("many"))
    catalog.add_structures([structure("boxy"), *(structure(f"t{at}", at % 3) for at in range(24))])
    catalog.add_demonstrations([demonstration(), demonstration("other")])
    catalog.add_plans([(key_of(at), plan(f"t{at}", at % 3), {"planned_at": night(0)}) for at in range(24)])
    return catalog


def test_what_changed_since_is_published_as_all_of_it_would_be(many, tmp_path, monkeypatch):
    monkeypatch.setattr(published.parted, "_PLANS", 3)
    monkeypatch.setattr(published.parted, "_STEPS", 100)
    catalog, place = copied(many, tmp_path / "catalog"), tmp_path / "out"
    first = [key_of(at)[:20] for at in range(24)]

    def add(key: str, target: str, number: int, month: int = 1, **about: str) -> None:
        catalog.add_plans([(key_of(key), plan(target, number), {"planned_at": night(month), **about})])

    changes = {
        "another plan": lambda: add("again", "t1", 7),
        "a structure and its plan": lambda: (
            catalog.add_structures([structure("t2", 5)]),
            add("new", "t2", 5),
        ),
        "a release": lambda: catalog.release(first[3], "me", force=["verdict"]),
        "a newer plan than the one in force": lambda: add("later", "t3", 8),
        "one in force and one reviewed": lambda: (
            catalog.release(first[4], "me", force=["verdict"]),
            catalog.review(first[5], "me"),
        ),
        "a recall": lambda: catalog.reject(first[4], "me"),
        "a structure that is retired": lambda: catalog.retire_structures(["t6"]),
        "a plan for comparison": lambda: add("beside", "t7", 9, purpose="experiment one"),
        "a plan without a path": lambda: catalog.add_plans(
            [(key_of("none"), replace(plan("t8", 1), status="refused", trajectory=None), {})]
        ),
        "merged files": lambda: compact(catalog),
        "nothing": lambda: None,
    }
    counts, foremost = [], Catalog.foremost

    def noted(self, columns, ids=None):
        counts.append(None if ids is None else len(ids))
        return foremost(self, columns, ids)

    export_tables(catalog, place)
    assert sum(name.startswith(("transfers", "waypoints")) for name in stamps(place)) > 12
    for number, (what, change) in enumerate(changes.items()):
        change()
        counts.clear()
        before = stamps(place)
        with monkeypatch.context() as patched:
            patched.setattr(Catalog, "foremost", noted)
            export_tables(catalog, place)
        assert len(counts) == (what not in ("merged files", "nothing")), what
        assert all(count is not None and count <= 6 for count in counts), f"{what}: all plans were read"
        new = {name for name, stamp in stamps(place).items() if before.get(name) != stamp}
        assert sum(name.startswith(("transfers", "waypoints")) for name in new) <= 5, what
        assert_as_anew(catalog, place, tmp_path / f"anew-{number}")
    catalog.add_demonstrations([demonstration("other", 1)])
    for number in range(30):
        add(f"grown {number}", "t9", number % 3, demonstration_sha256=str(number))
    catalog.add_plans([(key_of("x", at), plan(f"t{at}", 2, preset="paper"), {}) for at in range(20)])
    assert_as_anew(catalog, place, tmp_path / "grown")


def test_what_was_published_of_another_history_is_published_anew(many, tmp_path, monkeypatch):
    monkeypatch.setattr(published.parted, "_PLANS", 3)
    monkeypatch.setattr(published.parted, "_STEPS", 100)
    catalog, place = copied(many, tmp_path / "catalog"), tmp_path / "out"
    shutil.copytree(catalog.location, tmp_path / "backup")
    catalog.add_plans([(key_of("lost"), plan("t1", 7), {"planned_at": night(1)})])
    export_tables(catalog, place)
    restored = open_catalog(tmp_path / "backup")
    for number in range(3):  # it comes further than what was published
        restored.add_plans([(key_of("other", number), plan(f"t{number + 4}", 7), {"planned_at": night(1)})])
    assert_as_anew(restored, place, tmp_path / "anew")


@pytest.mark.parametrize("damage", ["gone", "unreadable"])
def test_a_file_of_before_that_is_no_good_is_made_again(many, tmp_path, monkeypatch, damage):
    monkeypatch.setattr(published.parted, "_PLANS", 3)
    catalog, place = copied(many, tmp_path / "catalog"), tmp_path / "out"
    export_tables(catalog, place)
    for path in (place / "tables" / "current").resolve().glob("transfers.parquet/*/*.parquet"):
        if "t1" in set(pd.read_parquet(path)["target_id"]):
            path.unlink()
            if damage == "unreadable":
                path.write_bytes(b"PAR1 and no more")
    if damage == "unreadable":
        catalog.add_plans([(key_of("again"), plan("t1", 7), {"planned_at": night(1)})])
    assert_as_anew(catalog, place, tmp_path / "anew")
