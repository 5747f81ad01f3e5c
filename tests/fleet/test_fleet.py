"""The jobs of a fleet by their laws: nothing twice, nothing missing, the same by any number of hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh
from random_members import random_member

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.errors import InputError
from upplied.fleet import reading
from upplied.fleet.run import SHARDS_EACH, shards
from upplied.outputs.logs import write_log
from upplied.planning.plan import transfer_key
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

REQUEST = fleet.PlanRequest(("baseline", "paper"))
PLANNED = ["transfer_id", "status", "coverage_paper_pct", "frechet_z", "min_clearance_m", "waypoints_sha256"]


def boxes(location: Path, seeds: Sequence[int] = (1, 2, 3)) -> Catalog:
    """A catalog with a demonstration round a cube and three boxes to carry it to."""
    catalog = open_catalog(location)
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in seeds)])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


@pytest.fixture(scope="module")
def planned(tmp_path_factory) -> Catalog:
    catalog = boxes(tmp_path_factory.mktemp("fleet") / "catalog")
    decision = fleet.decide(catalog, REQUEST)
    fleet.transfer(catalog, decision.jobs, "first", fleet.Resources(2))
    return catalog


def jobs_for(count: int, demonstrations: int = 1) -> list[fleet.Job]:
    settings = settings_for("paper")
    return [
        fleet.Job(f"d{d}", "s", f"t{t:05d}", "box", settings, f"{d}-{t}", "new pair", ("", "", ""))
        for d in range(demonstrations)
        for t in range(count)
    ]


@pytest.mark.ci
def test_every_demonstration_goes_to_every_other_structure_of_its_kind(planned):
    plans = planned.transfers()
    assert set(plans["target_id"]) == {"box-random-1", "box-random-2", "box-random-3"}
    assert len(plans) == 6
    assert (plans["status"] == "ok").all(), plans["reason"].tolist()


def test_every_plan_says_what_it_was_made_from(planned):
    for row in planned.transfers().itertuples():
        demonstration = planned.demonstration(row.demonstration_id)
        source, target = planned.structure(row.source_id), planned.structure(row.target_id)
        assert row.key == transfer_key(demonstration, source, target, settings_for(row.preset))
        assert (row.demonstration_sha256, row.source_sha256, row.target_sha256) == (
            demonstration.sha256,
            source.sha256,
            target.sha256,
        )
        assert row.run_id == "first"
        assert row.planning_s > 0


def test_a_second_run_finds_nothing_to_do(planned):
    decision = fleet.decide(planned, REQUEST)
    assert (decision.jobs, decision.unchanged) == ([], 6)
    assert fleet.transfer(planned, decision.jobs, "second").total == 0


@pytest.mark.ci
def test_what_is_kept_does_not_depend_on_the_number_of_workers(planned, tmp_path):
    alone = boxes(tmp_path / "catalog")
    fleet.transfer(alone, fleet.decide(alone, REQUEST).jobs, "alone", fleet.Resources(1))
    first, second = (
        catalog.transfers().sort_values("transfer_id")[PLANNED].reset_index(drop=True)
        for catalog in (planned, alone)
    )
    assert first.equals(second)


@pytest.mark.parametrize(
    ("plan_request", "why", "count"),
    [
        (fleet.PlanRequest(("paper",), {"viewpoints": {"shared": 0.4}}), "settings changed", 3),
        (fleet.PlanRequest(("recommended",)), "new pair", 3),
        (fleet.PlanRequest(("paper",), targets=("cube-v1",)), "new pair", 1),  # itself, where it is asked for
    ],
)
def test_a_decision_says_why(planned, plan_request, why, count):
    decision = fleet.decide(planned, plan_request)
    assert decision.reasons == {why: count}


@pytest.mark.slow
def test_a_changed_structure_is_planned_again_and_a_retired_one_no_more(tmp_path):
    catalog = boxes(tmp_path / "catalog", (1,))
    fleet.transfer(
        catalog, fleet.decide(catalog, fleet.PlanRequest(("paper",))).jobs, "first", fleet.Resources(1)
    )
    old = catalog.structure("box-random-1")
    catalog.add_structures([replace(old, vertices=old.vertices * 1.01, sha256="")])
    decision = fleet.decide(catalog, fleet.PlanRequest(("paper",)))
    assert decision.reasons == {"target changed": 1}
    catalog.retire_structures(["box-random-1"])
    assert fleet.decide(catalog, fleet.PlanRequest(("paper",))).jobs == []


@pytest.mark.parametrize(
    "plan_request", [fleet.PlanRequest(demonstrations=("nobody",)), fleet.PlanRequest(targets=("nothing",))]
)
def test_unknown_names_are_refused_with_the_known_ones(planned, plan_request):
    with pytest.raises(InputError, match=r"not in the catalog.*(cube-sides|box-random-1)"):
        fleet.decide(planned, plan_request)


@pytest.mark.parametrize(("targets", "demonstrations"), [(0, 0), (3, 1), (3, 5), (40, 2), (1300, 1)])
def test_shards_hold_every_job_once(targets, demonstrations):
    jobs = jobs_for(targets, demonstrations)
    groups = shards(jobs, workers=2)
    assert sorted(job.key for shard in groups for job in shard) == sorted(job.key for job in jobs)
    assert shards(list(reversed(jobs)), workers=2) == groups


def test_bundles_for_machines_keep_what_shares_a_target_together():
    jobs = jobs_for(130, 3)
    bundles = fleet.shards(list(reversed(jobs)), 1, 64)
    assert [len(bundle) for bundle in bundles] == [129, 129, 132]  # 64 targets at most, and evenly
    assert [job.key for bundle in bundles for job in bundle] == [
        job.key for job in sorted(jobs, key=by_target)
    ]


def by_target(job):
    return job.target_id, job.demonstration_id


@pytest.mark.parametrize(
    ("targets", "demonstrations", "tasks"),
    [(3, 1, 3), (7, 1, 7), (3, 40, 16), (40, 3, 16), (1000, 1, 16), (10_000, 1, 157)],
)
def test_a_fleet_is_a_few_tasks_a_worker_and_none_is_a_tenth_larger_than_another(
    targets, demonstrations, tasks
):
    """A task of an engine costs as much as the plan of a small target."""
    groups = shards(jobs_for(targets, demonstrations), 2)
    assert len(groups) == tasks <= max(2 * SHARDS_EACH, targets / 60)
    sizes = [len({job.target_id for job in shard}) if targets >= 8 else len(shard) for shard in groups]
    assert max(sizes) <= min(sizes) + 1
    if targets >= 8:
        assert sum(sizes) == targets, "a target is in two shards, which would lay it out twice"


@pytest.mark.ci
def test_a_bad_file_stops_itself_alone(tmp_path):
    cube = member("cube-v1").structure
    trimesh.Trimesh(cube.vertices, cube.triangles).export(tmp_path / "good.stl")
    (tmp_path / "bad.stl").write_bytes(b"solid nothing")
    entry = (
        '[[structure]]\nid = "NAME"\nkind = "box"\npath = "NAME.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
    )
    (tmp_path / "structures.toml").write_text(entry.replace("NAME", "bad") + entry.replace("NAME", "good"))
    (tmp_path / "broken.mcap").write_bytes(b"not a log at all")
    write_log(tmp_path / "good.mcap", fly(cube, "sides"), cube)

    catalog = open_catalog(tmp_path / "catalog")
    bad, good = fleet.ingest_structures(catalog, tmp_path / "structures.toml", 1)
    assert (bad.status, good.status) == ("failed", "added")
    assert "bad.stl" in bad.reason
    assert catalog.structures()["structure_id"].tolist() == ["good"]
    catalog.add_structures([random_member("box", 1).structure])
    pruned = fleet.ingest_structures(catalog, tmp_path / "structures.toml", 1, prune=True)
    assert [item.status for item in pruned] == ["failed", "unchanged", "retired"]
    assert catalog.structures()["structure_id"].tolist() == ["good"]
    catalog.add_structures([cube])
    broken, flown = fleet.ingest_demonstrations(catalog, [tmp_path], 1)
    assert (broken.status, flown.status) == ("failed", "added")
    assert "broken.mcap" in broken.reason
    assert "Traceback" not in broken.reason
    assert [item.status for item in fleet.ingest_demonstrations(catalog, [tmp_path], 1)] == [
        "failed",
        "unchanged",
    ]


@pytest.mark.ci
def test_two_logs_of_one_name_do_not_hide_each_other(tmp_path):
    cube = member("cube-v1").structure
    for name, seed in (("first", 0), ("second", 1)):
        write_log(tmp_path / f"{name}.mcap", fly(cube, "sides", seed), cube)
    catalog = open_catalog(tmp_path / "catalog").create()
    catalog.add_structures([cube])
    first, second = fleet.ingest_demonstrations(catalog, [tmp_path], 1)
    assert (first.status, second.status) == ("added", "failed")
    assert "first.mcap" in second.reason


@pytest.mark.ci
def test_what_is_unchanged_is_known_by_its_bytes_and_not_parsed(tmp_path, monkeypatch):
    cube = member("cube-v1").structure
    entry = (
        '[[structure]]\nid = "NAME"\nkind = "box"\npath = "NAME.stl"\nunits = "m"\nup = "z"\nforward = "x"\n'
    )
    for name in ("one", "two"):
        trimesh.Trimesh(cube.vertices, cube.triangles).export(tmp_path / f"{name}.stl")
    manifest = tmp_path / "structures.toml"
    manifest.write_text(entry.replace("NAME", "one") + entry.replace("NAME", "two"))
    write_log(tmp_path / "good.mcap", fly(cube, "sides"), cube)
    catalog = open_catalog(tmp_path / "catalog")
    fleet.ingest_structures(catalog, manifest, 1)
    catalog.add_structures([cube])
    fleet.ingest_demonstrations(catalog, [tmp_path], 1)

    parsed = []

    def run(self, function, item):
        parsed.append(item)
        return function(item)

    def status(items):
        return [item.status for item in items]

    monkeypatch.setattr(reading.Workers, "run", run)
    assert status(fleet.ingest_structures(catalog, manifest)) == ["unchanged"] * 2
    assert status(fleet.ingest_demonstrations(catalog, [tmp_path])) == ["unchanged"]
    assert parsed == []

    # Another axis, and then a nominal size that the mesh does not have: read again, that one alone.
    for change in ('up = "y"\nforward = "x"', 'up = "y"\nforward = "x"\nnominal_length_m = 400'):
        manifest.write_text(
            entry.replace("NAME", "one")
            + entry.replace("NAME", "two").replace('up = "z"\nforward = "x"', change)
        )
        parsed.clear()
        fleet.ingest_structures(catalog, manifest)
        assert [item.structure_id for item in parsed] == ["two"]
    manifest.write_text(entry.replace("NAME", "one"))
    trimesh.Trimesh(cube.vertices * 1.5, cube.triangles).export(tmp_path / "one.stl")
    assert status(fleet.ingest_structures(catalog, manifest)) == ["added"]
    (tmp_path / "good.toml").write_text('[inspection]\noperator = "somebody else"\n')
    assert status(fleet.ingest_demonstrations(catalog, [tmp_path])) == ["added"]
