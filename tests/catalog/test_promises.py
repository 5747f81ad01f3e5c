"""What a commit promises: on the disk before it is acknowledged, in pieces, of inputs that still are so."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from catalog_records import copied, demonstration, key_of, plan, structure

from upplied import fleet
from upplied.catalog import history, open_catalog, verify
from upplied.catalog.database import Catalog
from upplied.fleet import planner, reading


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Catalog:
    catalog = open_catalog(tmp_path_factory.mktemp("begun"))
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    return catalog


@pytest.fixture
def catalog(begun, tmp_path) -> Catalog:
    return copied(begun, tmp_path / "catalog")


@pytest.fixture
def synced(monkeypatch) -> list[tuple[str, int]]:
    """Files and folders that were brought to the disk, each with the log entries that stood there then."""
    if not Path("/proc/self/fd").exists():
        pytest.skip("needs /proc to tell which file is brought to the disk")
    syncs: list[tuple[str, int]] = []
    fsync = os.fsync

    def noted(handle: int) -> None:
        name = os.readlink(f"/proc/self/fd/{handle}")
        place = next((at for at in (Path(name), *Path(name).parents) if (at / "_delta_log").is_dir()), None)
        syncs.append((name, len(list(place.glob("_delta_log/*.json"))) if place else 0))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", noted)
    return syncs


ADD = {
    "transfers": lambda c: c.add_plans([(key_of(1), plan("target", 1), {})]),
    "structures": lambda c: c.add_structures([structure("more", 3)]),
    "demonstrations": lambda c: c.add_demonstrations([demonstration("more", 3)]),
}


@pytest.mark.parametrize("table", ADD)
def test_data_are_on_the_disk_before_their_commit_and_the_commit_before_it_is_acknowledged(
    catalog, synced, table
):
    catalog.add_plans([(key_of(0), plan("target"), {})])
    place = Path(catalog.location, table)
    steps = {"transfers": "steps/waypoints", "demonstrations": "steps/poses"}.get(table)
    stepped = Path(catalog.location, steps) if steps else place
    files, entries = set(place.glob("*.parquet")), set(place.glob("_delta_log/*.json"))
    before = set(stepped.glob("*.parquet"))
    synced.clear()
    ADD[table](catalog)
    (file,) = set(place.glob("*.parquet")) - files
    (entry,) = set(place.glob("_delta_log/*.json")) - entries
    names = [Path(name) for name, _ in synced]
    drafts = [logged for path, logged in synced if Path(path).name.startswith(f".{file.name}.")]
    assert drafts == [len(entries)], "the bytes of the data were not brought to the disk before the commit"
    first = next(logged for path, logged in synced if Path(path) == place)
    assert first == len(entries), "the name of the data file was not brought to the disk before the commit"
    assert entry in names, "the commit was not brought to the disk"
    assert entry.parent in names, "the name of the commit was not brought to the disk"
    if steps:
        (points,) = set(stepped.glob("*.parquet")) - before
        bytes_at = next(at for at, path in enumerate(names) if path.name.startswith(f".{points.name}."))
        assert bytes_at < names.index(stepped) < names.index(place), "the steps came after their row"


@pytest.mark.parametrize("folder", ["meshes", "surfaces", "samples"])
def test_what_rows_name_is_on_the_disk(catalog, synced, folder):
    catalog.add_structures([structure("more", 5)])
    catalog.add_plans([(key_of(5), plan("target", 5), {})])
    assert any(f"/{folder}/." in name for name, _ in synced)
    assert any(Path(name).name == folder for name, _ in synced)


@pytest.mark.parametrize("changed", ["boxy", "target", "flight"])
def test_a_job_whose_inputs_changed_is_not_planned(catalog, monkeypatch, changed):
    """What would come of it would carry the hashes of other inputs."""
    (job,) = fleet.decide(catalog, fleet.PlanRequest(("baseline",))).jobs
    if changed == "flight":
        catalog.add_demonstrations([demonstration(seed=9)])
    else:
        catalog.add_structures([structure(changed, 9)])
    monkeypatch.setattr(planner, "_catalog", open_catalog(catalog.location))
    monkeypatch.setattr(planner, "plan_transfer", lambda *_: plan("target"))
    for known in (planner._structure, planner._demonstration):
        known.cache_clear()
    try:
        assert planner.plan_job(job).plan.status == "superseded"
    finally:
        for known in (planner._structure, planner._demonstration):
            known.cache_clear()


def test_files_are_taken_in_a_batch_at_a_time(monkeypatch):
    """What was read so far is kept where the rest is stopped."""
    monkeypatch.setattr(reading, "BATCH", 2)
    commits: list[list[str]] = []
    items = [(f"f{at}", structure(f"s{at}", at)) for at in range(5)]
    reads = iter([*items[:3], ("bad", "bad: is no mesh"), *items[3:]])
    items_stored = reading.stored(
        reads,
        {},
        lambda it: it.structure_id,
        lambda items: commits.append([item.structure_id for item in items]),
        lambda _: None,
    )
    assert commits == [["s0", "s1"], ["s2", "s3"], ["s4"]]
    assert [item.status for item in items_stored].count("added") == 5


@pytest.mark.parametrize("kind", ["structures", "demonstrations"])
def test_as_it_is_set_little_is_lost_where_ingest_is_stopped(kind):
    """What waits for its commit is bounded, however many files there are."""
    reads = (
        (f"f{at}", structure(f"s{at}") if kind == "structures" else demonstration()) for at in range(260)
    )
    name = (lambda it: it.structure_id) if kind == "structures" else (lambda it: f"d{next(names)}")
    names, commits = iter(range(260)), []
    reading.stored(reads, {}, name, lambda items: commits.append(len(items)), lambda _: None)
    assert sum(commits) == 260
    assert max(commits) <= 100


def test_files_are_not_read_far_ahead_of_what_is_kept():
    """Else a large fleet is held in memory, and lost where the first commit fails."""
    handed: list[int] = []

    class Counted(list):
        def __iter__(self):
            for item in range(len(self)):
                handed.append(item)
                yield item

    items = reading.each(str, Counted(range(300)), str, 1, lambda _: reading.Ingested("", "unchanged"))
    next(items)
    items.close()
    assert 1 <= len(handed) <= 100


@pytest.mark.ci
def test_small_files_are_merged_while_they_come(catalog):
    for number in range(40):
        catalog.add_plans([(key_of(number), plan(f"t{number}", number), {})])
    for thread in threading.enumerate():
        if thread.name.startswith("tidy"):
            thread.join(60)
    assert catalog.tables["transfers"].delta().get_add_actions().num_rows < 30
    assert "maintenance" in set(history(catalog)["operation"])
    assert len(catalog.transfers(every=True)) == 40
    assert len(catalog.transfers(version=20, every=True)) > 15
    assert [finding for finding in verify(catalog) if "is not in" not in finding.found] == []
    assert catalog.settled([key_of(number) for number in range(40)]).keys() == {
        key_of(number) for number in range(40)
    }
