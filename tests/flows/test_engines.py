"""The same plans, byte for byte, whichever engine runs the tasks."""

from __future__ import annotations

import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
from clusters import RUN, boxes, dask_cluster, first_attempt, kept, message, ray_cluster, start_run
from processes import cut_the_power

from upplied import fleet
from upplied.catalog import Catalog, verify
from upplied.fleet import manifest
from upplied.flows.server import private_server

# Addresses as they are given, not the one that the machine has on its network; and a word they share.
LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "x" * 32}

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]


def planned(catalog: Catalog, engine: str, environment: dict[str, str], address: str = "") -> list[dict]:
    told = message(start_run(catalog, engine, address, environment))
    assert "6 ok, 0 refused, 0 failed, 0 unchanged" in told, told
    ours = [
        line for line in told.splitlines() if "distributed." not in line
    ]  # Dask loses its own as it closes
    assert not [line for line in ours if "lost" in line.lower()], told
    rows = catalog.transfers()
    assert rows["run_id"].nunique() == 1
    where = [place.split("/", 2)[2] for place in rows["planned_on"]]
    assert {place.split(":")[0] for place in where} == {engine}, where
    assert engine == "local" or all(place.partition(":")[2] for place in where), "no worker is named"
    return kept(catalog)


@pytest.mark.ci
def test_a_worker_of_dask_that_is_killed_is_named_and_another_does_its_work(tmp_path):
    pytest.importorskip("prefect_dask")
    fleet.transfer(
        here := boxes(tmp_path / "here"),
        fleet.decide(here, fleet.PlanRequest(("baseline", "paper"))).jobs,
        "here",
        fleet.Resources(1),
    )
    there = boxes(tmp_path / "there")
    with private_server(tmp_path / "prefect") as server, dask_cluster(tmp_path) as (address, processes):
        server.wait()
        night = start_run(there, "dask", address, server.environment)
        lost = first_attempt(there, night)
        (victim,) = [each for each in processes if each.pid == int(lost.worker.split("/")[1])]
        cut_the_power(victim.pid)
        told = message(night)
    assert "6 ok, 0 refused, 0 failed, 0 unchanged. Lost workers: " in told, told
    assert lost.worker in told and "done again: cube-sides-v1 to box-random-" in told
    assert "planned here" not in told, "another worker was there"
    others = {where.split("/", 2)[2] for where in there.transfers()["planned_on"]}
    assert any(f"/{other})" in told for other in others), (told, others)
    assert kept(here) == kept(there)
    assert not list(Path(there.location, manifest.FOLDER).iterdir())


@pytest.mark.ci
def test_where_the_scheduler_of_dask_is_killed_the_run_plans_the_rest_itself(tmp_path):
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    with private_server(tmp_path / "prefect") as server, dask_cluster(tmp_path) as (address, processes):
        server.wait()
        night = start_run(catalog, "dask", address, server.environment)
        first_attempt(catalog, night)
        cut_the_power(processes[0].pid)
        told = message(night)
    assert "6 ok, 0 refused, 0 failed, 0 unchanged" in told, told
    assert "shards were lost by the engine and planned here" in told
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 6
    assert verify(catalog) == []


@pytest.mark.parametrize("whose", ["a running cluster", "its own"])
@pytest.mark.ci
def test_dask_gives_the_same_bytes(tmp_path, whose):
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        here = planned(boxes(tmp_path / "here"), "local", server.environment)
        # Processes that know this program as an installed package, and nothing of the clone.
        with (
            nullcontext()
            if whose == "its own"
            else distributed.LocalCluster(
                n_workers=2,
                threads_per_worker=1,
                dashboard_address=None,
                preload=[f"import os; os.chdir({str(tmp_path)!r})"],
            )
        ) as cluster:
            address = "" if cluster is None else cluster.scheduler_address
            there = planned(boxes(tmp_path / "there"), "dask", server.environment, address)
    assert here == there


def test_a_target_that_hangs_on_a_cluster_is_stopped_and_costs_itself_alone(tmp_path):
    """Its engine has no limit of time; the processes beside its own have."""
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    code = RUN.replace('"most_lost": 1.0}', '"timeout_s": 0.001}')
    with (
        private_server(tmp_path / "prefect") as server,
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
    ):
        server.wait()
        done = subprocess.run(
            [sys.executable, "-c", code, str(catalog.location), "dask", cluster.scheduler_address],
            env=server.environment,
            capture_output=True,
            text=True,
            check=False,
        )
    assert "0 ok, 0 refused, 6 failed" in done.stdout, done.stdout + done.stderr
    rows = catalog.transfers()
    assert rows["reason"].str.contains("took longer than 0.001 s").all()
    assert {where.split("/")[2].split(":")[0] for where in rows["planned_on"]} == {"dask"}


@pytest.mark.ci
def test_shards_that_an_engine_loses_are_told_and_too_many_of_them_fail_the_run(tmp_path):
    """A cluster whose processes cannot read the catalog: all is planned by the run itself."""
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    code = RUN.replace("return_state=True).message", "return_state=True)").replace(
        '"most_lost": 1.0', '"most_lost": float(sys.argv[4])'
    )
    blind = "import upplied.fleet, upplied.fleet.run as run; run.plan_here = upplied.fleet.plan_here = None"
    told = {}
    with (
        private_server(tmp_path / "prefect") as server,
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, preload_nanny=[], preload=[blind]
        ) as cluster,
    ):
        server.wait()
        for share in ("1", "0.5"):
            preset = "baseline" if share == "1" else "paper"
            done = subprocess.run(
                [
                    sys.executable,
                    "-c",
                    code.replace('["baseline", "paper"]', f'["{preset}"]'),
                    str(catalog.location),
                    "dask",
                    cluster.scheduler_address,
                    share,
                ],
                env=server.environment,
                capture_output=True,
                text=True,
                check=False,
            )
            told[share] = done.stdout + done.stderr
    assert "Completed('3 ok" in told["1"].replace('"', "'"), told
    assert "Failed('3 ok" in told["0.5"].replace('"', "'"), told
    for said in told.values():
        assert "3 of 3 shards were lost by the engine and planned here: TypeError" in said
    rows = catalog.transfers()
    assert len(rows) == 6
    assert {where.split("/")[2] for where in rows["planned_on"]} == {"local"}


@pytest.mark.parametrize("whose", ["a running cluster", "its own"])
@pytest.mark.ci
def test_ray_gives_the_same_bytes(tmp_path, whose):
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        here = planned(boxes(tmp_path / "here"), "local", server.environment)
        variables = server.environment | LOOPBACK
        cluster = ray_cluster(variables) if whose == "a running cluster" else nullcontext("")
        with cluster as address:
            there = planned(boxes(tmp_path / "there"), "ray", variables, address)
    assert here == there


@pytest.mark.ci
def test_a_worker_of_ray_that_is_killed_is_named_and_another_does_its_work(tmp_path):
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    catalog = boxes(tmp_path / "catalog")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        variables = server.environment | LOOPBACK
        with ray_cluster(variables) as address:
            night = start_run(catalog, "ray", address, variables)
            lost = first_attempt(catalog, night)
            cut_the_power(int(lost.worker.split("/")[1]))
            told = message(night)
    assert "6 ok, 0 refused, 0 failed, 0 unchanged. Lost workers: " in told, told
    assert lost.worker in told and "done again: cube-sides-v1 to box-random-" in told
    assert "planned here" not in told, "Ray had another worker"
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 6
    assert verify(catalog) == []
