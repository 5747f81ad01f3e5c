"""What a run keeps, when, and where it was planned; what a shard that is started twice does."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh
from random_members import random_member

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.errors import CatalogError, InputError
from upplied.fleet import planner, reading, run
from upplied.fleet.planner import Outcome
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

REQUEST = fleet.PlanRequest(("baseline",))


@pytest.fixture
def catalog(tmp_path) -> Catalog:
    catalog = open_catalog(tmp_path / "catalog")
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in (1, 2, 3))])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


@pytest.fixture
def attempts(monkeypatch) -> list[str]:
    """The targets that were planned, in this process."""
    planned: list[str] = []

    def attempt(workers: object, job: fleet.Job, plan: Callable[[fleet.Job], Outcome]) -> Outcome:
        planned.append(job.target_id)
        return plan(job)

    monkeypatch.setattr(run, "attempt", attempt)
    return planned


@pytest.mark.slow
def test_every_plan_says_where_it_was_made(catalog):
    fleet.transfer(catalog, fleet.decide(catalog, REQUEST).jobs, "night", fleet.Resources(2))
    places = {tuple(where.split("/")) for where in catalog.transfers()["planned_on"]}
    assert {(host, engine) for host, _, engine in places} == {(socket.gethostname(), "local")}
    assert str(os.getpid()) not in {process for _, process, _ in places}, "the run's own process planned"


@pytest.mark.slow
def test_a_shard_that_is_started_twice_is_planned_once(catalog, attempts):
    planner.prepare(str(catalog.location))
    jobs = fleet.decide(catalog, REQUEST).jobs
    first = fleet.plan_here(str(catalog.location), jobs[:2], "night", "ray")
    again = fleet.plan_here(str(catalog.location), jobs, "night", "ray")
    assert (first.ok, again.ok) == (2, 1)
    assert attempts == [job.target_id for job in jobs]
    assert {where.split("/")[2] for where in catalog.transfers()["planned_on"]} == {"ray"}


@pytest.mark.ci
def test_a_failure_of_an_older_run_is_not_what_came_of_this_one(catalog):
    """The machine that was to try again was lost before it planned."""
    jobs = fleet.decide(catalog, REQUEST).jobs
    hasty = fleet.Resources(1, fleet.Limits(timeout_s=0.001))
    assert fleet.transfer(catalog, jobs, "last night", hasty).failed == 3
    again = fleet.decide(catalog, replace(REQUEST, retry_failed=True)).jobs
    assert [job.key for job in again] == [job.key for job in jobs]
    result, missing = fleet.known_outcomes(catalog, again, "tonight")
    assert (result.total, missing) == (0, again)
    result, missing = fleet.known_outcomes(catalog, again, "last night")
    assert (result.failed, missing) == (3, [])


@pytest.mark.slow
def test_settings_that_are_back_are_planned_again_on_any_engine(catalog, attempts):
    """Their plans are there, and yet those of the settings between are current."""
    planner.prepare(str(catalog.location))
    first, second = REQUEST, replace(REQUEST, changes={"viewpoints": {"shared": 0.5}})
    for night, plan_request in enumerate((first, second, first)):
        jobs = fleet.decide(catalog, plan_request).jobs
        fleet.plan_here(str(catalog.location), jobs, f"night {night}", "dask")
    assert fleet.decide(catalog, first).jobs == []
    assert len(fleet.decide(catalog, second).jobs) == 3


@pytest.mark.ci
def test_what_changed_since_the_decision_is_not_planned_as_what_it_was(catalog):
    jobs = fleet.decide(catalog, REQUEST).jobs
    old = catalog.structure("box-random-2")
    catalog.add_structures([replace(old, vertices=old.vertices * 1.1, sha256="")])
    result = fleet.transfer(catalog, jobs, "night", fleet.Resources(1))
    assert (result.ok, result.superseded, str(result)) == (2, 1, "2 ok, 0 refused, 0 failed, 1 superseded")
    assert set(catalog.transfers(every=True)["target_id"]) == {"box-random-1", "box-random-3"}
    assert fleet.decide(catalog, REQUEST).reasons == {"new pair": 1}


@pytest.mark.ci
def test_what_was_planned_is_kept_before_the_run_ends(catalog, monkeypatch):
    """A killed run loses no more than `EVERY_S` of work."""
    monkeypatch.setattr(run, "EVERY_S", 0.0)
    rows = []
    jobs = fleet.decide(catalog, REQUEST).jobs
    fleet.transfer(
        catalog, jobs, "night", fleet.Resources(1), lambda _: rows.append(len(catalog.transfers(every=True)))
    )
    assert rows == [1, 2, 3]


@pytest.mark.slow
def test_what_was_read_is_kept_before_all_is_read(tmp_path, monkeypatch):
    """A batch that cannot be kept takes none of those before it along."""
    text = ""
    for number in range(5):
        box = random_member("box", number).structure
        trimesh.Trimesh(box.vertices, box.triangles).export(tmp_path / f"s{number}.stl")
        text += f'[[structure]]\nid = "s{number}"\nkind = "box"\npath = "s{number}.stl"\n'
        text += 'units = "m"\nup = "z"\nforward = "x"\n'
    (tmp_path / "structures.toml").write_text(text)
    catalog = open_catalog(tmp_path / "catalog")
    monkeypatch.setattr(reading, "BATCH", 2)
    add, batches = catalog.add_structures, []

    def full(structures: list) -> int:
        batches.append(len(structures))
        if len(batches) == 3:
            raise CatalogError("structures", "No space left on device")
        return add(structures)

    monkeypatch.setattr(catalog, "add_structures", full)
    with pytest.raises(CatalogError, match="No space"):
        fleet.ingest_structures(catalog, tmp_path / "structures.toml", 1)
    assert batches == [2, 2, 1]
    assert catalog.structures()["structure_id"].tolist() == ["s0", "s1", "s2", "s3"]


def test_the_shards_of_a_run_are_read_as_they_were_written_and_nothing_else_is(catalog, tmp_path):
    jobs = fleet.decide(
        catalog, fleet.PlanRequest(("baseline", "paper"), {"viewpoints": {"shared": 0.4}})
    ).jobs
    # Settings of one preset, as those of a kind or a structure are: each job keeps its own.
    own = settings_for("baseline", viewpoints={"shared": 0.6})
    jobs = [replace(jobs[0], settings=own), *jobs[1:]]
    groups = fleet.shards(jobs, 1, 2)
    names = planner.write_shards(catalog, "night-1", groups)
    assert [tuple(planner.read_shard(str(catalog.location), name)) for name in names] == groups
    assert max(len(name) for name in names) < 100, "it was to be told where shards lie, not what is in them"
    for wrong in ("night-1/../../structures", "../x/00000.jobs", "night-1/00009.jobs", "", "night-1"):
        with pytest.raises((CatalogError, InputError)):
            planner.read_shard(str(catalog.location), wrong)
    path = Path(catalog.shards.path(names[0]))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(CatalogError, match="cannot be read"):
        planner.read_shard(str(catalog.location), names[0])
    planner.remove_shards(catalog, "night-1")
    planner.remove_shards(catalog, "night-1")
    assert not path.parent.exists()


def test_who_works_on_a_shard_lies_beside_it_and_whoever_was_lost_did_not_end(catalog):
    jobs = fleet.decide(catalog, REQUEST).jobs
    first, second = planner.write_shards(catalog, "night-1", [(jobs[0],), (jobs[1],)])
    here = f"{socket.gethostname()}/{os.getpid()}"
    lost = planner.attempt(str(catalog.location), first, "dask:10.0.0.7:40123")
    lost.__enter__()  # and never left: its process is gone
    with (
        pytest.raises(CatalogError, match="full"),
        planner.attempt(str(catalog.location), second, "pool:planner-1"),
    ):
        raise CatalogError("structures", "full")
    with planner.attempt(str(catalog.location), first, "dask:10.0.0.8:40123"):
        pass
    Path(catalog.shards.path("night-1/00000.torn.json")).write_bytes(b'{"shard": ')
    attempts = planner.attempts(catalog, "night-1")
    assert [(one.shard, one.worker, one.ended) for one in attempts] == [
        (first, f"{here}/dask:10.0.0.7:40123", False),
        (first, f"{here}/dask:10.0.0.8:40123", True),
        (second, f"{here}/pool:planner-1", True),
    ]
    assert planner.attempts(catalog, "night-2") == []
    planner.remove_shards(catalog, "night-1")
    assert planner.attempts(catalog, "night-1") == []
