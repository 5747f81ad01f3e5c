"""The same plans, byte for byte, whichever engine runs the tasks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from flows.server import private_server
from upplied.catalog import Catalog, open_catalog
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]

KEPT = ["transfer_id", "status", "coverage_paper_pct", "frechet_z", "min_clearance_m", "waypoints_sha256"]

RUN = """
import sys
from flows.transfer_fleet import transfer_fleet
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
    rows = catalog.transfers().sort_values("transfer_id")
    assert rows["run_id"].nunique() == 1
    return rows[KEPT].to_dict("records")


def test_a_running_dask_cluster_gives_the_same_bytes(tmp_path):
    distributed = pytest.importorskip("distributed")
    pytest.importorskip("prefect_dask")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        here = planned(boxes(tmp_path / "here"), "local", server.environment)
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, env=server.environment
        ) as cluster:
            there = planned(boxes(tmp_path / "there"), "dask", server.environment, cluster.scheduler_address)
    assert here == there


def test_ray_gives_the_same_bytes(tmp_path):
    pytest.importorskip("prefect_ray", reason="ray is an optional extra: pip install upplied[ray]")
    with private_server(tmp_path / "prefect") as server:
        server.wait()
        here = planned(boxes(tmp_path / "here"), "local", server.environment)
        there = planned(boxes(tmp_path / "there"), "ray", server.environment)
    assert here == there
