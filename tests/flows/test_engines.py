"""The same plans, byte for byte, whichever engine runs the tasks."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from itertools import chain
from pathlib import Path

import pytest
from processes import cut_the_power

from upplied.catalog import Catalog, open_catalog
from upplied.flows.server import free_port, private_server
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]

KEPT = ["transfer_id", "status", "coverage_paper_pct", "frechet_z", "min_clearance_m", "waypoints_sha256"]

RUN = """
import sys
from upplied.flows.transfer_fleet import transfer_fleet
if __name__ == "__main__":
    resources = {"engine": sys.argv[2], "workers": 2, "address": sys.argv[3]}
    presets = ["baseline", "paper"]
    print(transfer_fleet(sys.argv[1], "", presets=presets, resources=resources, return_state=True).message)
"""


def boxes(location: Path) -> Catalog:
    catalog = open_catalog(location)
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in (1, 2, 3))])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


def planned(catalog: Catalog, engine: str, environment: dict[str, str], address: str = "") -> list[dict]:
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(catalog.location), engine, address],
        env=environment | {"PREFECT_LOGGING_LEVEL": "WARNING"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "6 ok, 0 refused, 0 failed, 0 unchanged" in done.stdout, done.stdout + done.stderr
    assert "lost" not in done.stdout + done.stderr
    rows = catalog.transfers().sort_values("transfer_id")
    assert rows["run_id"].nunique() == 1
    assert {where.split("/")[2] for where in rows["planned_on"]} == {engine}, rows["planned_on"].tolist()
    return rows[KEPT].to_dict("records")


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
    code = RUN.replace('"address": sys.argv[3]}', '"address": sys.argv[3], "timeout_s": 0.001}')
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
    assert {where.split("/")[2] for where in rows["planned_on"]} == {"dask"}


@pytest.mark.ci
def test_shards_that_an_engine_loses_are_told_and_too_many_of_them_fail_the_run(tmp_path):
    """A cluster whose processes cannot read the catalog: all is planned by the run itself."""
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    catalog = boxes(tmp_path / "catalog")
    code = RUN.replace("return_state=True).message", "return_state=True)").replace(
        '"address": sys.argv[3]}', '"address": sys.argv[3], "most_lost": float(sys.argv[4])}'
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


@contextmanager
def ray_cluster(environment: dict[str, str]) -> Iterator[str]:
    """A running Ray cluster of two worker processes on the loopback interface; its address."""
    folder = tempfile.mkdtemp(prefix="ray-")  # a short path: its sockets lie in there
    address = f"127.0.0.1:{free_port()}"
    host, port = address.split(":")
    options = {
        "--node-ip-address": host,
        "--port": port,
        "--num-cpus": "2",
        "--object-store-memory": str(100 * 2**20),
        "--include-dashboard": "false",
        "--temp-dir": folder,
    }
    command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block"]
    with (Path(folder) / "ray.log").open("wb") as log:
        head = subprocess.Popen(
            [*command, *chain(*options.items())],
            env=environment,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        deadline = time.monotonic() + 180
        while "Ray runtime started" not in (told := (Path(folder) / "ray.log").read_text()):
            assert head.poll() is None and time.monotonic() < deadline, told
            time.sleep(0.5)
        yield address
    finally:
        cut_the_power(head.pid)
        head.wait()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.parametrize("whose", ["a running cluster", "its own"])
@pytest.mark.ci
def test_ray_gives_the_same_bytes(tmp_path, whose):
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        here = planned(boxes(tmp_path / "here"), "local", server.environment)
        # Addresses as they are given, not the one that the machine has on its network; and a word they share.
        loopback = {
            "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": "x" * 32,
        }
        loopback |= server.environment
        with ray_cluster(loopback) if whose == "a running cluster" else nullcontext("") as address:
            there = planned(boxes(tmp_path / "there"), "ray", loopback, address)
    assert here == there
