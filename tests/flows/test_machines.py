"""A fleet cut into shards that two machines take from a work pool; they share an object store alone."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import boto3
import pytest
from object_store import object_store
from processes import cut_the_power
from random_members import random_member

from upplied import fleet
from upplied.catalog import Catalog, open_catalog
from upplied.flows.serve import deploy
from upplied.flows.server import Server, start, stop
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

pytestmark = [pytest.mark.slow, pytest.mark.server, pytest.mark.filterwarnings("default")]

COLUMNS = ["transfer_id", "status", "coverage_paper_pct", "frechet_z", "min_clearance_m", "waypoints_sha256"]
TARGETS = range(1, 7)
PRESETS = ("baseline", "paper")

ROOT = Path(__file__).parents[2]

RUN = """
import sys
from upplied.flows.transfer_fleet import transfer_fleet
if __name__ == "__main__":
    resources = {"engine": "pool", "workers": 1, "shard_targets": int(sys.argv[2])}
    presets = ["baseline", "paper"]
    print(transfer_fleet(sys.argv[1], "", presets=presets, resources=resources, return_state=True).message)
"""


@pytest.fixture
def bucket(monkeypatch) -> Iterator[str]:
    """An object store on the loopback interface, which the environment names."""
    with object_store() as address:
        for name, value in {
            "AWS_ACCESS_KEY_ID": "writer",
            "AWS_SECRET_ACCESS_KEY": "secret",
            "AWS_REGION": "us-east-1",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": address,
            "AWS_ALLOW_HTTP": "true",
        }.items():
            monkeypatch.setenv(name, value)
        boto3.client("s3").create_bucket(Bucket="fleet")
        yield "s3://fleet/catalog"


def boxes(location: str | Path, cache: Path, targets: Iterable[int] = TARGETS) -> Catalog:
    catalog = open_catalog(location, cache)
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in targets)])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


@dataclass
class Machine:
    """A worker and what it says."""

    worker: subprocess.Popen[bytes]
    log: Path

    def wait_for(self, text: str, patience_s: float = 900) -> None:
        deadline = time.monotonic() + patience_s
        while text not in self.log.read_text(errors="replace"):
            assert time.monotonic() < deadline, self.log.read_text(errors="replace")
            time.sleep(0.2)

    def shard(self) -> str:
        """Name of the last shard that it began."""
        return re.findall(r"Flow run '(.*?)' - ", self.log.read_text(errors="replace"))[-1]

    def cut_the_power(self) -> None:
        """The worker and all that came of it, at once."""
        cut_the_power(self.worker.pid)
        self.worker.wait()


@contextmanager
def machine(server: Server, home: Path) -> Iterator[Machine]:
    """A worker that takes one shard at a time, with a home and caches of its own."""
    home.mkdir()
    own = {
        "PREFECT_HOME": str(home / "prefect"),
        "PREFECT_API_AUTH_STRING": server.password,
        "UPPLIED_ROOTS": "s3://fleet",
        "XDG_CACHE_HOME": str(home / "cache"),
    }
    command = ("prefect", "worker", "start", "--pool", "planners", "--limit", "1", "--name", home.name)
    with (home / "worker.log").open("wb") as log:
        worker = start(*command, environment=with_store(server) | own, log=log)
    try:
        yield Machine(worker, home / "worker.log")
    finally:
        stop(worker)


@contextmanager
def pool_of(server: Server, place: Path, names: Sequence[str]) -> Iterator[list[Machine]]:
    """Machines on the pool `planners`, once they have announced themselves."""
    with ExitStack() as stack:
        machines = [stack.enter_context(machine(server, place / name)) for name in names]
        for each in machines:
            each.wait_for("started!")
        yield machines


@pytest.fixture(scope="module")
def server(server) -> Server:
    """A server with the pools and deployments."""
    deploy(server.environment | {"UPPLIED_HOME": str(ROOT)})
    return server


def with_store(server: Server) -> dict[str, str]:
    """What a process is told of the server, and of the object store of its test."""
    return server.environment | {k: v for k, v in os.environ.items() if k.startswith("AWS_")}


def test_two_machines_and_an_object_store_give_the_same_bytes_as_one(tmp_path, bucket, server):
    here = boxes(tmp_path / "here", tmp_path / "cache-here", (1, 2))
    fleet.transfer(here, fleet.decide(here, fleet.PlanRequest(PRESETS)).jobs, "here", fleet.Resources(2))
    there = boxes(bucket, tmp_path / "cache-there", (1, 2))
    with pool_of(server, tmp_path, ("one", "two")) as machines:
        assert "4 ok, 0 refused, 0 failed, 0 unchanged" in message_of(start_run(server, bucket, 0))
        taken = [each.log.read_text().count("submitted to infrastructure") for each in machines]
        assert "0 ok, 0 refused, 0 failed, 4 unchanged" in message_of(start_run(server, bucket, 0))
    assert taken == [1, 1], "the fleet was not shared out"
    rows = there.transfers(every=True)
    assert len(rows) == 4
    assert rows["run_id"].nunique() == 1, "the shards do not say which run they are of"
    workers = {where.split("/")[2] for where in rows["planned_on"]}
    assert workers == {"pool:one", "pool:two"}, rows["planned_on"].tolist()
    assert rows_of(here) == rows_of(there)


def test_a_machine_that_is_lost_is_found_by_its_silence_and_its_shard_goes_to_another(
    tmp_path, bucket, server
):
    """Worker and flow of one machine are killed at once: nobody is left there to tell the server."""
    catalog = boxes(bucket, tmp_path / "cache-there")
    quickly = "from upplied.flows.automations import apply, zombies; apply(zombies(90))"  # three heartbeats
    subprocess.run([sys.executable, "-c", quickly], env=server.environment, cwd=ROOT, check=True)
    before = states(server)  # of the tests above
    with pool_of(server, tmp_path, ("one", "two")) as (lost, other):
        night = start_run(server, bucket, 1)
        lost.wait_for("Beginning")
        lost.cut_the_power()
        message = message_of(night)
        runs = [run for run in states(server) if run not in before]
    assert "submitted to infrastructure" in other.log.read_text()
    assert "12 ok, 0 refused, 0 failed, 0 unchanged" in message
    assert "was lost" not in message, "the shard was planned by the run itself, not by the other machine"
    assert [run["name"] for run in runs if run["state"] == "CRASHED"] == [lost.shard()]
    assert sum(run["state"] == "COMPLETED" for run in runs) == 7, (
        runs
    )  # six shards, and the run over the fleet
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 12


def test_where_the_last_machine_leaves_the_run_plans_the_rest_itself(tmp_path, bucket, server):
    catalog = boxes(bucket, tmp_path / "cache-there")
    with pool_of(server, tmp_path, ("one",)) as (only,):
        night = start_run(server, bucket, 1)
        only.wait_for("Finished in state Completed('2 ok")
        stop(only.worker)
        message = message_of(night)
    assert "12 ok, 0 refused, 0 failed, 0 unchanged" in message
    assert "was lost" in message
    rows = catalog.transfers(every=True)
    assert len(rows) == len(rows["key"].unique()) == 12
    assert rows["run_id"].nunique() == 1


def start_run(server: Server, bucket: str, shard_targets: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN, bucket, str(shard_targets)],
        env=with_store(server),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def message_of(run: subprocess.Popen[str]) -> str:
    text, _ = run.communicate(timeout=1800)
    assert run.returncode == 0, text
    return text


def states(server: Server) -> list[dict[str, str]]:
    code = """
import json
from prefect import get_client
with get_client(sync_client=True) as client:
    print(json.dumps([{"id": str(it.id), "name": it.name, "state": it.state.type.value}
                      for it in client.read_flow_runs()]))
"""
    process = subprocess.run(
        [sys.executable, "-c", code], env=server.environment, capture_output=True, check=True
    )
    return [run for run in json.loads(process.stdout) if run["state"] != "SCHEDULED"]


def rows_of(catalog: Catalog) -> list[dict]:
    return catalog.transfers().sort_values("transfer_id")[COLUMNS].to_dict("records")
