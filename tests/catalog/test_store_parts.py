"""The store's small parts by themselves: files, statistics, messages, locks, notes of versions."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest
from catalog_records import key_of, plan
from deltalake.exceptions import DeltaError, SchemaMismatchError

from upplied.catalog import open_catalog
from upplied.catalog.schema.tables import in_schema
from upplied.catalog.store import files
from upplied.catalog.store.chain import statistics
from upplied.catalog.store.files import FileStore, explained, locked, remedy_of, turn
from upplied.catalog.store.opening import Heads, opened
from upplied.errors import CatalogError
from upplied.files import replace_file, sync_path


def test_statistics_are_ranges_and_nulls() -> None:
    when = datetime(2026, 1, 2, 3, 4, 5, 678_900, UTC)
    rows = pa.table(
        {
            "id": pa.array(["b", "a", None]),
            "number": pa.array([3, 1, 2], pa.int64()),
            "at": pa.array([when, when, when], pa.timestamp("us", "UTC")),
            "some": pa.array([1.0, None, None]),
            "none": pa.array([None, None, None], pa.float64()),
            "nan": pa.array([float("nan")] * 3),
            "long": pa.array(["x" * 65] * 3),
            "short": pa.array(["x" * 64] * 3),
        }
    )
    ranges = json.loads(statistics(rows))
    assert ranges["numRecords"] == 3
    low, high = ranges["minValues"], ranges["maxValues"]
    assert (low["id"], high["id"]) == ("a", "b") and (low["number"], high["number"]) == (1, 3)
    assert (low["some"], high["some"]) == (1.0, 1.0) and high["short"] == "x" * 64
    assert low["at"].startswith("2026-01-02T03:04:05.678") and high["at"].startswith(
        "2026-01-02T03:04:05.679"
    )
    assert low.keys() == high.keys() == {"id", "number", "at", "some", "short"}
    assert ranges["nullCount"] == {name: rows[name].null_count for name in rows.column_names}


def test_files_are_skipped_by_the_columns_that_rows_are_looked_for_by_alone(tmp_path) -> None:
    catalog = open_catalog(tmp_path)
    for name in ("first", "second", "third"):
        catalog.add_plans([(key_of(name), plan(name), {})])
    rows = catalog.tables["transfers"].dataset()
    last = catalog.tables["transfers"].delta().version()
    assert len(list(rows.get_fragments())) == 3
    for where in (pc.field("commit_version") >= last, pc.field("target_id") == "third"):
        assert len(list(rows.get_fragments(where))) == 1, where
    stated = pa.table(catalog.tables["transfers"].delta().get_add_actions(flatten=True)).column_names
    assert "min.coverage_seen_pct" not in stated and "min.commit_version" in stated


def test_what_the_storage_raises_is_told_in_words() -> None:
    def fails(error: Exception) -> None:
        def act() -> None:
            raise error

        explained("file:/place", act, KeyError)

    assert explained("place", lambda: 3) == 3
    with pytest.raises(CatalogError, match="it is so"):
        fails(CatalogError("x", "it is so"))
    with pytest.raises(KeyError):
        fails(KeyError("asked for"))
    with pytest.raises(CatalogError, match="has other columns: a and b") as caught:
        fails(SchemaMismatchError("a and b\nmore"))
    assert "Use a newer version" in str(caught.value)
    for error in (DeltaError("broken"), OSError("broken"), pa.ArrowInvalid("broken\nat line 7")):
        with pytest.raises(CatalogError, match="broken") as caught:
            fails(error)
        assert "line 7" not in str(caught.value)
    with pytest.raises(CatalogError) as caught:
        fails(OSError("y" * 400))
    assert "y" * 300 in str(caught.value) and "y" * 301 not in str(caught.value)
    with pytest.raises(ValueError, match="a fault of ours"):
        fails(ValueError("a fault of ours"))


def test_remedies_of_a_disk() -> None:
    for message in ("No space left on device", "something (os error 28)", "File too large"):
        assert remedy_of("/place", message) == "free some space; nothing was changed"
    for message in ("Permission denied", "permission denied", "Read-only file system", "read-only"):
        assert (
            remedy_of("/place", message) == "ask for the right to read and write there; nothing was changed"
        )
    assert remedy_of("/place", "odd") == ""


def test_remedies_of_a_store_name_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in list(os.environ):
        if name.startswith("AWS_"):
            monkeypatch.delenv(name)
    all_of_them = "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION"
    own = "the store's own (AWS_ENDPOINT_URL is not set)"
    uri = "s3://bucket/some/folder"
    assert remedy_of(uri, "No space") == (
        f"bucket bucket was requested at {own}; not set in the environment: {all_of_them}; "
        "nothing was changed"
    )
    monkeypatch.setenv("AWS_DEFAULT_REGION", "north")
    assert "AWS_REGION" not in remedy_of(uri, "")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "very secret")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://me:pass@store:9000")
    remedy = remedy_of(uri, "")
    assert remedy == (
        "bucket bucket was requested at http://store:9000; not set in the environment: AWS_ALLOW_HTTP=true "
        "(the endpoint is http); nothing was changed"
    )
    monkeypatch.setenv("AWS_ALLOW_HTTP", "True")
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", "https://first")
    assert remedy_of(uri, "") == "bucket bucket was requested at https://first; nothing was changed"


def test_one_at_a_time_holds_a_folder(tmp_path: Path) -> None:
    order: list[str] = []

    def other() -> None:
        with locked(tmp_path / "place"):
            order.append("other")

    with locked(tmp_path / "place"):
        waiting = threading.Thread(target=other)
        waiting.start()
        until(lambda: "lock of .lock" in {thread.name for thread in threading.enumerate()})
        order.append("first")
    waiting.join()
    assert order == ["first", "other"]


def test_a_folder_that_is_held_for_long_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "PATIENCE_S", 0.05)
    with (
        locked(tmp_path / "place"),
        pytest.raises(CatalogError, match="been publishing there"),
        locked(tmp_path / "place"),
    ):
        raise AssertionError
    monkeypatch.setattr(files, "PATIENCE_S", 60.0)
    with locked(tmp_path / "place"):
        assert is_held(tmp_path / "place" / ".lock")
    (tmp_path / "file").write_text("")
    with pytest.raises(CatalogError, match="cannot be written"), locked(tmp_path / "file"):
        raise AssertionError


def is_held(path: Path) -> bool:
    with path.open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def until(condition: Callable[[], bool]) -> None:
    for _ in range(6000):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("it never came")


def test_a_writer_that_comes_back_overtakes_nobody_who_waits(tmp_path: Path) -> None:
    path, order = tmp_path / "heads" / "table.turn", list[str]()

    def other() -> None:
        with turn(path):
            order.append("other")

    with turn(path):
        order.append("first")
        waiting = threading.Thread(target=other)
        waiting.start()
        until(lambda: is_held(path.with_suffix(".next")))
    with turn(path):
        order.append("first again")
    waiting.join()
    assert order == ["first", "other", "first again"]
    assert not is_held(path) and not is_held(path.with_suffix(".next"))


def test_nobody_waits_for_ever_for_a_writer_that_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table.turn"
    with path.open("ab") as stopped:
        fcntl.flock(stopped, fcntl.LOCK_EX)
        with monkeypatch.context() as patched:
            patched.setattr(files, "_TURN_S", 0.05)
            with turn(path):
                assert is_held(path)  # by the other one, and the work goes on
    until(lambda: not is_held(path) and not is_held(path.with_suffix(".next")))
    with turn(tmp_path / "file" / "table.turn"):
        (tmp_path / "plain").write_text("")
    with turn(tmp_path / "plain" / "table.turn"):  # where nothing can be locked, nobody waits
        pass


def test_files_appear_whole_and_once(tmp_path: Path) -> None:
    store = FileStore(f"{tmp_path}/a/b/")
    assert store.local and store.names() == [] and not store.has("x") and not store.has_folder("")
    assert not store.touched("x")
    store.write("x", b"one")
    store.write("y", b"two", lasting=False)
    assert store.path("x") == f"{tmp_path}/a/b/x" and store.names() == ["x", "y"]
    assert store.read("x") == b"one" and store.has("x") and store.has_folder("")
    assert not store.has_folder("x") and not store.has_folder("z")
    store.create("x", b"other")
    store.create("z", b"three")
    assert store.read("x") == b"one" and store.read("z") == b"three" and store.names() == ["x", "y", "z"]
    store.remove("y")
    store.remove("y")
    assert store.names() == ["x", "z"]
    (tmp_path / "a" / "b" / "inner").mkdir()
    assert not store.has_folder("inner")
    (tmp_path / "a" / "b" / "inner" / "file").write_text("")
    assert store.has_folder("inner")
    store.remove_folder("inner")
    store.remove_folder("inner")
    assert not (tmp_path / "a" / "b" / "inner").exists()
    assert not FileStore("s3://bucket/place").local


def test_files_that_nobody_used_are_known_by_their_stamps(tmp_path: Path) -> None:
    store = FileStore(str(tmp_path))
    store.write("old", b"")
    store.write("new", b"")
    long_ago = time.time() - 1000
    os.utime(tmp_path / "old", (long_ago, long_ago))
    moment = datetime.now(UTC) - timedelta(seconds=500)
    assert store.older(moment) == ["old"]
    assert store.touched("old") and store.older(moment) == []
    assert store.older(datetime.now(UTC) + timedelta(seconds=500)) == ["new", "old"]


def test_a_file_is_replaced_in_one_step_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, synced = tmp_path / "in" / "file", []
    replace_file(place, b"first")
    monkeypatch.setattr("os.fsync", lambda handle: synced.append(handle))
    replace_file(place, b"second")
    assert place.read_bytes() == b"second" and len(synced) == 2  # its bytes, and its name
    replace_file(place, b"third", lasting=False)
    assert place.read_bytes() == b"third" and len(synced) == 2
    sync_path(tmp_path)
    assert len(synced) == 3

    def full(source: object, to: object) -> None:
        raise OSError("No space")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(place, b"fourth")
    assert place.read_bytes() == b"third" and [path.name for path in place.parent.iterdir()] == ["file"]


def test_the_newest_version_is_noted_once(tmp_path: Path) -> None:
    heads = Heads(str(tmp_path), "transfers")
    assert heads.seen() == -1
    for version in (3, 7, 5):
        heads.note(version)
    assert heads.seen() == 7
    assert os.listdir(tmp_path / "heads") == [f"transfers-{7:020}"]
    (tmp_path / "heads" / f"transfers-{9:019}").touch()
    (tmp_path / "heads" / f"others-{9:020}").touch()
    assert Heads(str(tmp_path), "transfers").seen() == 7
    other = Heads(str(tmp_path), "transfers")
    other.note(8)
    assert heads.seen() == 8 and not (tmp_path / "heads" / f"transfers-{7:020}").exists()
    (tmp_path / "heads" / f"transfers-{8:020}").unlink()
    heads.note(7)  # noted before
    assert heads.seen() == -1


def test_rows_come_in_the_columns_asked_for() -> None:
    table = pa.table({"b": pa.array([1, 2], pa.int32()), "x": pa.array(["p", "q"])})
    schema = pa.schema([("a", pa.string()), ("b", pa.int64())])
    rows = in_schema(table, schema)
    assert rows.schema == schema and rows.to_pydict() == {"a": [None, None], "b": [1, 2]}


def test_a_place_without_a_table_is_none(tmp_path: Path) -> None:
    assert opened(str(tmp_path / "nothing")) is None
    (tmp_path / "empty" / "_delta_log").mkdir(parents=True)
    assert opened(str(tmp_path / "empty")) is None
    (tmp_path / "odd" / "_delta_log").mkdir(parents=True)
    (tmp_path / "odd" / "_delta_log" / "note.txt").touch()
    assert opened(str(tmp_path / "odd")) is None
    (tmp_path / "odd" / "_delta_log" / f"{0:020}.json").write_text("no json")
    with pytest.raises(DeltaError):
        opened(str(tmp_path / "odd"))


def test_an_object_store_answers_as_a_disk_does(tmp_path: Path) -> None:
    """By the way of pyarrow's file systems, with a folder under its URI."""
    store = FileStore(f"file://{tmp_path}/")
    assert not store.local and store.root == f"file://{tmp_path}" and store.names() == []
    store.write("x", b"one")
    store.write("y", b"two", lasting=False)
    store.create("x", b"other")
    store.create("z", b"three")
    assert store.names() == ["x", "y", "z"] and store.read("x") == b"one" and store.read("z") == b"three"
    assert store.has("x") and not store.has("w") and store.touched("x") and not store.touched("w")
    store.remove("y")
    store.remove("y")
    assert store.names() == ["x", "z"]
    long_ago = time.time() - 1000
    os.utime(tmp_path / "x", (long_ago, long_ago))
    assert store.older(datetime.now(UTC) - timedelta(seconds=500)) == ["x"]
    assert store.older(datetime.now(UTC) + timedelta(seconds=500)) == ["x", "z"]
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "file").write_text("")
    assert store.has_folder("inner") and not store.has_folder("x") and not store.has("inner")
    store.remove_folder("inner")
    assert not (tmp_path / "inner").exists()
    assert FileStore(f"file://{tmp_path}/nowhere").names() == []
    assert FileStore(f"file://{tmp_path}/nowhere").older(datetime.now(UTC)) == []
