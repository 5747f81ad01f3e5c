"""The same plans, byte for byte, whichever engine runs the tasks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext

import pytest
from clusters import (
    LONGEST_S,
    PRESETS,
    boxes,
    dask_cluster,
    message,
    ray_cluster,
    rows_of,
    start_run,
    stopped_at_work,
)
from processes import cut_the_power

from upplied import fleet
from upplied.catalog import Catalog, verify

# Addresses as they are given, not the one that the machine has on its network; and a word they share.
LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "x" * 32}
ALL_PLANNED = "6 ok, 0 refused, 0 failed, 0 unchanged"

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]


def planned(catalog: Catalog, engine: str, environment: dict[str, str], address: str) -> list[dict]:
    text = message(start_run(catalog, engine, address, environment))
    assert ALL_PLANNED in text, text
    # Dask loses its own as it closes.
    ours = [line for line in text.splitlines() if "distributed." not in line]
    assert not [line for line in ours if "lost" in line.lower()], text
    rows = catalog.transfers()
    assert rows["run_id"].nunique() == 1
    where = [place.split("/", 2)[2] for place in rows["planned_on"]]
    assert {place.split(":")[0] for place in where} == {engine}, where
    assert all(place.partition(":")[2] for place in where), "no worker is named"
    return rows_of(catalog)


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> list[dict]:
    """What this machine plans of the boxes."""
    catalog = boxes(tmp_path_factory.mktemp("here"))
    jobs = fleet.decide(catalog, fleet.PlanRequest(PRESETS)).jobs
    fleet.transfer(catalog, jobs, "here", fleet.Resources(2))
    return rows_of(catalog)


@pytest.fixture(scope="module")
def running(tmp_path_factory) -> Iterator[str]:
    """The address of a running Dask cluster, whose processes know this program as an installed package."""
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address=None,
        preload=[f"import os; os.chdir({str(elsewhere)!r})"],
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.parametrize("whose", ["a running cluster", pytest.param("its own", marks=pytest.mark.ci)])
def test_a_worker_of_dask_that_is_killed_is_named_and_another_does_its_work(server, here, tmp_path, whose):
    pytest.importorskip("prefect_dask")
    there = boxes(tmp_path / "there")
    with nullcontext(("", [])) if whose == "its own" else dask_cluster(tmp_path) as (address, _):
        night = start_run(there, "dask", address, server.environment)
        lost = stopped_at_work(there, night)
        cut_the_power(int(lost.worker.split("/")[1]))
        text = message(night)
    assert f"{ALL_PLANNED}. Lost workers: " in text, text
    assert lost.worker in text and "done again: cube-sides-v1 to box-random-" in text
    assert "planned here" not in text, "another worker was there"
    others = {where.split("/", 2)[2] for where in there.transfers()["planned_on"]}
    assert any(f"/{other})" in text for other in others), (text, others)
    assert rows_of(there) == here
    assert not list(there.shards.names())


def test_where_the_scheduler_of_dask_is_killed_the_run_plans_the_rest_itself(server, tmp_path):
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    with dask_cluster(tmp_path) as (address, processes):
        night = start_run(catalog, "dask", address, server.environment)
        stopped_at_work(catalog, night)  # and stays so: its shard cannot end before the scheduler is gone
        cut_the_power(processes[0].pid)
        text = message(night)
    assert ALL_PLANNED in text, text
    assert "shards were lost by the engine and planned here" in text
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 6
    assert verify(catalog) == []


@pytest.mark.parametrize("whose", ["a running cluster", "its own"])
def test_dask_gives_the_same_bytes(server, here, running, tmp_path, whose):
    address = "" if whose == "its own" else running
    assert planned(boxes(tmp_path / "there"), "dask", server.environment, address) == here


def test_a_target_that_hangs_on_a_cluster_is_stopped_and_costs_itself_alone(server, running, tmp_path):
    """Its engine has no limit of time; the processes beside its own have."""
    catalog = boxes(tmp_path / "catalog")
    hasty = {"timeout_s": 0.001, "most_lost": 0.5}
    text = message(start_run(catalog, "dask", running, server.environment, hasty))
    assert "0 ok, 0 refused, 6 failed" in text, text
    rows = catalog.transfers()
    assert rows["reason"].str.contains("took longer than 0.001 s").all()
    assert {where.split("/")[2].split(":")[0] for where in rows["planned_on"]} == {"dask"}


def test_shards_that_an_engine_loses_are_told_and_too_many_of_them_fail_the_run(server, tmp_path):
    """A cluster whose processes cannot plan: all is planned by the run itself."""
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    blind = "import upplied.fleet, upplied.fleet.run as run; run.plan_here = upplied.fleet.plan_here = None"
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, preload_nanny=[], preload=[blind]
    ) as cluster:
        address, nights = cluster.scheduler_address, []
        for preset, most_lost in (("baseline", 1.0), ("paper", 0.5)):
            arguments = catalog, "dask", address, server.environment, {"most_lost": most_lost}
            nights.append(message(start_run(*arguments, presets=(preset,))))
    few, many = nights
    assert "CompletedWithFailures" not in few and "COMPLETED 3 ok" in few, few
    assert "FAILED 3 ok" in many, many
    for text in nights:
        assert "3 of 3 shards were lost by the engine and planned here: TypeError" in text
    rows = catalog.transfers()
    assert len(rows) == 6
    assert {where.split("/")[2] for where in rows["planned_on"]} == {"local"}


@pytest.mark.parametrize("whose", ["a running cluster", "its own"])
@pytest.mark.ci
def test_ray_gives_the_same_bytes(server, here, tmp_path, whose, request):
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    address = "" if whose == "its own" else request.getfixturevalue("running_ray")
    there = boxes(tmp_path / "there")
    assert planned(there, "ray", server.environment | LOOPBACK, address) == here


@pytest.mark.ci
def test_a_worker_of_ray_that_is_killed_is_named_and_another_does_its_work(server, running_ray, tmp_path):
    catalog = boxes(tmp_path / "catalog")
    night = start_run(catalog, "ray", running_ray, server.environment | LOOPBACK)
    lost = stopped_at_work(catalog, night)
    cut_the_power(int(lost.worker.split("/")[1]))
    text = message(night)
    assert f"{ALL_PLANNED}. Lost workers: " in text, text
    assert lost.worker in text and "done again: cube-sides-v1 to box-random-" in text
    assert "planned here" not in text, "Ray had another worker"
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 6
    assert verify(catalog) == []


@pytest.fixture(scope="module")
def running_ray(server) -> Iterator[str]:
    """The address of a running Ray cluster."""
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    with ray_cluster(server.environment | LOOPBACK) as (address, _):
        yield address


def test_where_the_head_of_ray_is_killed_the_run_ends_and_the_next_plans_the_rest(server, tmp_path):
    """Ray ends who waits for a head that is gone: what was kept still is, and nothing is planned twice."""
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    catalog = boxes(tmp_path / "catalog")
    environment = server.environment | LOOPBACK | {"RAY_gcs_rpc_server_reconnect_timeout_s": "5"}
    with ray_cluster(environment) as (address, head):
        night = start_run(catalog, "ray", address, environment)
        stopped_at_work(catalog, night)  # and stays so: its shard cannot end before the head is gone
        cut_the_power(head.pid)
        text, _ = night.communicate(timeout=LONGEST_S)
    assert night.returncode != 0 and "GCS" in text, text
    before = catalog.transfers(every=True)
    assert len(before) < 6
    assert "COMPLETED" in message(start_run(catalog, "local", "", server.environment))
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 6
    assert set(before["key"]) <= set(rows["key"])
    assert verify(catalog) == []
