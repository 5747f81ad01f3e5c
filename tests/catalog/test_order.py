"""What is newest is what was added last, whatever the clocks of those who wrote said."""

from __future__ import annotations

import multiprocessing
import os
import random
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from catalog_records import demonstration, key_of, plan, structure
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from upplied.catalog import (
    compact,
    export_dataset,
    history,
    import_dataset,
    open_catalog,
    vacuum,
    verify,
)
from upplied.catalog.database import Catalog
from upplied.catalog.schema import plan_rows
from upplied.catalog.store import opening

MINUTE = 60.0
SKEWS = (0.0, 10 * MINUTE, -10 * MINUTE, 400 * 86_400.0, -400 * 86_400.0)


def skewed(monkeypatch):
    """Sets the clock of this machine wrong, s; the disk keeps its own."""
    off = [0.0]
    real = time.time

    class Wrong(datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.fromtimestamp(real() + off[0], tz)

    for module in (plan_rows, opening):
        monkeypatch.setattr(module, "datetime", Wrong)
    monkeypatch.setattr(time, "time", lambda: real() + off[0])

    def to(seconds: float) -> None:
        off[0] = seconds

    return to


@pytest.fixture
def skew(monkeypatch):
    return skewed(monkeypatch)


def filled(place: Path) -> Catalog:
    catalog = open_catalog(place)
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    return catalog


@dataclass
class Model:
    """What a catalog should say, kept by somebody who has no clock."""

    plans: list[str] = field(default_factory=list)  # keys, in the order they became current
    notes: str = 'said "so" | <b>'
    retired: bool = False
    states: list[tuple[datetime, str, int, bool]] = field(default_factory=list)

    def current(self) -> str:
        return self.plans[-1] if self.plans else ""


STEPS = st.lists(
    st.tuples(st.sampled_from(["plan", "back", "failed", "notes", "retire"]), st.sampled_from(SKEWS)),
    min_size=1,
    max_size=8,
)


@pytest.mark.ci
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(steps=STEPS, merged=st.booleans())
def test_order_is_that_of_commits_under_any_clocks(tmp_path_factory, steps, merged):
    place = tmp_path_factory.mktemp("skewed")
    with pytest.MonkeyPatch.context() as patch:
        set_clock = skewed(patch)
        catalog, model = filled(place), Model()
        for number, (what, off) in enumerate(steps):
            set_clock(off)
            writer = open_catalog(place)  # another machine each time
            if what == "notes":
                model.notes, model.retired = f"note {number}", False
                assert writer.add_structures([structure("target", 1, notes=model.notes)]) == 1
            elif what == "retire":
                assert writer.retire_structures(["target"]) == int(not model.retired)
                model.retired = True
            elif what == "back" and model.plans:
                key = model.plans[0]
                failed = writer.transfer(key[:20])["status"] == "failed"
                added = writer.add_plans([(key, plan("target", 0), {})])
                assert added == int(failed or model.current() != key)
                model.plans.append(key)
            elif what == "failed":
                assert writer.add_plans([(key_of(number), plan("target", status="failed"), {})]) == 1
                model.plans.append(key_of(number))
            else:
                assert writer.add_plans([(key_of(number), plan("target", number), {})]) == 1
                model.plans.append(key_of(number))
            set_clock(0)
            time.sleep(0.003)  # moments are told apart by microseconds, commits by more
            model.states.append((datetime.now(UTC), model.current(), len(model.plans), model.retired))
            check(open_catalog(place), model)
        if merged:
            compact(catalog)
            check(open_catalog(place), model)
        for moment, current, _, retired in model.states:
            then = catalog.transfers(as_of=moment, columns=["key"])
            assert list(then["key"]) == ([] if retired or not current else [current])
        assert verify(catalog) == []


def check(catalog: Catalog, model: Model) -> None:
    rows = catalog.structures(every=True)
    row = rows[rows["structure_id"] == "target"].iloc[-1]
    assert (row["notes"], bool(row["retired"])) == (model.notes, model.retired)
    assert catalog.newest("structures", "target")["notes"] == model.notes
    current = [] if model.retired or not model.plans else [model.current()]
    assert list(catalog.transfers(columns=["key"])["key"]) == current


def test_the_disk_tells_the_time_not_the_writer(tmp_path, skew):
    catalog = filled(tmp_path)
    for off in SKEWS:
        skew(off)
        open_catalog(tmp_path).add_plans([(key_of(off), plan("target", 1), {})])
    skew(0)
    rows = catalog.transfers(every=True)
    assert rows["added_at"].is_monotonic_increasing
    assert (rows["added_at"] - datetime.now(UTC)).abs().max() < timedelta(minutes=5)
    assert rows["commit_version"].is_monotonic_increasing
    assert (rows["planned_at"] - datetime.now(UTC)).abs().max() > timedelta(
        days=300
    )  # told as the writer had it


def test_an_import_is_no_earlier_than_it_was(tmp_path):
    origin = filled(tmp_path / "from")
    origin.add_plans([(key_of(0), plan("target"), {})])
    export_dataset(origin, tmp_path / "set", "a-v1", origin.transfers(), "CC0-1.0")
    other = open_catalog(tmp_path / "to").create()
    before = datetime.now(UTC)
    time.sleep(0.01)
    import_dataset(other, tmp_path / "set")
    assert len(other.transfers()) == 1
    for rows in (other.transfers(as_of=before, every=True), other.structures(as_of=before)):
        assert rows.empty
    assert list(other.transfers()["planned_at"]) == list(origin.transfers()["planned_at"])


def test_boundaries_of_moments(tmp_path):
    """As of a moment means: with what was added at that very moment; changed since it means: after it."""
    catalog = filled(tmp_path)
    catalog.add_plans([(key_of(0), plan("target"), {})])
    catalog.add_structures([structure("target", 5)])
    row = catalog.transfers().iloc[0]
    step = timedelta(microseconds=1)
    assert len(catalog.transfers(as_of=row["added_at"])) == 1
    assert len(catalog.transfers(as_of=row["added_at"] - step)) == 0
    versions = catalog.structures(every=True)
    last = versions["added_at"].max()
    assert len(catalog.structures(as_of=last, every=True)) == len(versions)
    assert len(catalog.structures(as_of=last - step, every=True)) == len(versions) - 1


def test_a_version_knows_what_was_retired_then(tmp_path):
    catalog = filled(tmp_path)
    catalog.add_plans([(key_of(0), plan("target"), {})])
    version = int(history(catalog).query("table == 'transfers'")["version"].max())
    catalog.retire_structures(["target"])
    assert len(catalog.transfers(version=version)) == 1
    catalog.add_plans([(key_of(1), plan("boxy", 1), {})])
    assert list(catalog.transfers(version=version + 1)["target_id"]) == ["boxy"]


def test_a_version_knows_which_site_a_structure_stood_at_then(tmp_path):
    catalog = filled(tmp_path)
    catalog.add_plans([(key_of(0), plan("target"), {})])
    version = int(history(catalog).query("table == 'transfers'")["version"].max())
    catalog.add_structures([structure("target", 1, site="yard 7")])
    for site, then in (("hangar 3, Zürich", 1), ("yard 7", 0)):
        assert len(catalog.transfers(version=version, site=site)) == then
        assert len(catalog.transfers(site=site)) == 1 - then


def numbered(place: str, seed: int, count: int) -> None:
    catalog, rng = open_catalog(place), random.Random(seed)
    for number in range(count):
        catalog.add_structures([structure("target", seed, notes=f"{seed}-{number}-{rng.random()}")])


@pytest.mark.ci
def test_writers_at_once_get_numbers_of_their_own(tmp_path):
    catalog = filled(tmp_path)
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=numbered, args=(str(tmp_path), seed, 6)) for seed in range(2)]
    for process in writers:
        process.start()
    for process in writers:
        process.join(120)
        assert process.exitcode == 0
    rows = catalog.tables["structures"].read().to_pandas().query("structure_id == 'target'")
    rows = rows.sort_values("commit_version")
    assert rows["commit_version"].is_unique
    assert rows["added_at"].is_monotonic_increasing
    assert len(rows) == 1 + 2 * 6
    files = {path.name for path in (tmp_path / "structures").glob("*.parquet")}
    log = "".join(path.read_text() for path in (tmp_path / "structures" / "_delta_log").glob("*.json"))
    assert {name for name in files if name not in log} == set()  # none is left of those who lost


def test_points_of_a_writer_at_work_are_not_taken_for_a_stopped_ones(tmp_path, skew):
    """Its clock may be a year late: what counts is when the points came."""
    catalog = filled(tmp_path)
    skew(-400 * 86_400.0)
    late = open_catalog(tmp_path)
    commit = late._add_steps("waypoints", plan_rows.waypoint_table({key_of(0)[:20]: plan("target")}))
    skew(0)
    points = tmp_path / "steps" / "waypoints" / f"{commit}.parquet"
    assert vacuum(catalog, 1 / 24).orphan_commits["waypoints"] == 0 and points.exists()
    before = (datetime.now(UTC) - timedelta(hours=2)).timestamp()
    for path in points.parent.iterdir():
        os.utime(path, (before, before))
    assert vacuum(catalog, 1 / 24).orphan_commits["waypoints"] == 1
    assert not points.exists() and verify(catalog) == []
