"""Small files are merged beside those who write: seldom, by size, and never a row twice or lost."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied.catalog import open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.catalog.verbs import maintenance


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


def settle() -> None:
    for thread in threading.enumerate():
        if thread.name.startswith("tidy"):
            thread.join(60)


def merges(catalog: Catalog) -> list[list[str]]:
    """The files that each merge took away, oldest first."""
    removals = []
    for entry in sorted(Path(catalog.location, "settings", "_delta_log").glob("*.json")):
        actions = [json.loads(line) for line in entry.read_text().splitlines()]
        gone = [action["remove"]["path"] for action in actions if "remove" in action]
        removals += [gone] if gone else []
    return removals


@pytest.mark.ci
def test_a_row_is_written_again_as_often_as_its_file_grows_sixteenfold(catalog):
    for number in range(48):
        catalog.set("kind", "box", {"route.clearance_m": 2.0 + number}, "me")
        settle()
    taken = merges(catalog)
    assert [len(files) for files in taken] == [16, 16]
    assert len({name for files in taken for name in files}) == 32, "a merged file was merged with small ones"
    assert len(catalog.declared_settings()) == 48
    assert catalog.declared_settings()["commit_version"].is_unique
    assert len(catalog.tables["settings"].delta().file_uris()) == 18
    assert verify(catalog) == []


def test_nobody_who_writes_waits_for_a_merge(catalog, monkeypatch):
    free, begun = threading.Event(), threading.Event()
    merged = maintenance._merged

    def slow(*arguments):
        begun.set()
        assert free.wait(60)
        return merged(*arguments)

    monkeypatch.setattr(maintenance, "_merged", slow)
    try:
        for number in range(20):
            catalog.set("kind", "box", {"route.clearance_m": 2.0 + number}, "me")
        assert begun.wait(60)
        assert len(catalog.declared_settings()) == 20
        assert merges(catalog) == []
    finally:
        free.set()
        settle()
    assert [len(files) for files in merges(catalog)] == [16]
    assert len(catalog.declared_settings()) == 20


def test_large_files_are_left_to_maintenance(catalog, monkeypatch):
    monkeypatch.setattr(maintenance, "_TIDIED_BYTES", 1)
    for number in range(20):
        catalog.set("kind", "box", {"route.clearance_m": 2.0 + number}, "me")
    settle()
    assert merges(catalog) == []


def test_what_hinders_a_merge_hinders_nobody_who_writes(catalog, monkeypatch, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(maintenance, "_merged", full)
    for number in range(20):
        catalog.set("kind", "box", {"route.clearance_m": 2.0 + number}, "me")
    settle()
    assert len(catalog.declared_settings()) == 20
    assert "were not merged" in caplog.text


def test_a_plan_that_others_added_is_known_at_once_and_merged_ones_too(catalog):
    other = open_catalog(catalog.location)
    assert catalog.add_plans([(key_of(1), plan("target", 1), {})]) == 1
    assert other.add_plans([(key_of(1), plan("target", 1), {})]) == 0
    assert other.add_plans([(key_of(2), plan("boxy", 2), {})]) == 1
    assert maintenance.merge(other.tables["transfers"], 1 << 20) == 2
    for again in (catalog, other, open_catalog(catalog.location)):
        assert again.add_plans([(key_of(at), plan(("", "target", "boxy")[at], at), {}) for at in (1, 2)]) == 0
    assert len(catalog.transfers(every=True)) == 2
