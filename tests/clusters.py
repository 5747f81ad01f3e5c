"""Clusters of Dask and Ray on the loopback interface, and the fleet of boxes that is planned on them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path

from ports import free_port
from processes import cut_the_power
from random_members import random_member

from upplied.catalog import Catalog, open_catalog
from upplied.fleet import planner
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

COLUMNS = ["transfer_id", "status", "coverage_paper_pct", "frechet_z", "min_clearance_m", "waypoints_sha256"]

RUN = """
import json, sys
from upplied.flows.transfer_fleet import transfer_fleet
if __name__ == "__main__":
    presets, resources = json.loads(sys.argv[2]), json.loads(sys.argv[3])
    state = transfer_fleet(sys.argv[1], "", presets=presets, resources=resources, return_state=True)
    print(state.type.value, state.message, flush=True)
"""
PRESETS = ("baseline", "paper")
LONGEST_S = 1800.0  # that anything may take on a machine that is busy with other work


def boxes(location: Path) -> Catalog:
    """A catalog of a cube with a demonstration, and three boxes."""
    catalog = open_catalog(location)
    cube = member("cube-v1").structure
    catalog.add_structures([cube, *(random_member("box", seed).structure for seed in (1, 2, 3))])
    catalog.add_demonstrations([fly(cube, "sides")])
    return catalog


def rows_of(catalog: Catalog) -> list[dict]:
    """What was planned, without where and when."""
    return catalog.transfers().sort_values("transfer_id")[COLUMNS].to_dict("records")


def start_run(
    catalog: Catalog,
    engine: str,
    address: str,
    environment: dict[str, str],
    resources: Mapping[str, float] | None = None,
    presets: Sequence[str] = PRESETS,
) -> subprocess.Popen[str]:
    """A run over the fleet in a process of its own."""
    values = {"engine": engine, "workers": 2, "address": address, "most_lost": 1.0, **(resources or {})}
    words = [str(catalog.location), json.dumps(list(presets)), json.dumps(values)]
    return subprocess.Popen(
        [sys.executable, "-c", RUN, *words],
        env=environment | {"PREFECT_LOGGING_LEVEL": "WARNING"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def message(run: subprocess.Popen[str]) -> str:
    """What a run prints: the type of its state and its message, and the warnings of its engine."""
    text, _ = run.communicate(timeout=LONGEST_S)
    assert run.returncode == 0, (run.returncode, text)
    return text


def stopped_at_work(catalog: Catalog, run: subprocess.Popen[str]) -> planner.Attempt:
    """A worker's work that has begun and not ended; its process stands still, so that it cannot end."""
    folder = Path(catalog.shards.root)
    deadline = time.monotonic() + LONGEST_S
    while True:
        names = [place.name for place in folder.iterdir()] if folder.is_dir() else []
        for one in (one for name in names for one in planner.attempts(catalog, name) if not one.ended):
            pid = int(one.worker.split("/")[1])
            os.kill(pid, signal.SIGSTOP)
            if one in planner.attempts(catalog, one.shard.split("/")[0]):
                return one
            os.kill(pid, signal.SIGCONT)  # it ended just now
        assert run.poll() is None and time.monotonic() < deadline, run.communicate()[0]
        time.sleep(0.05)


@contextmanager
def dask_cluster(folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A running Dask cluster; its address, and its processes: the scheduler, and two workers."""
    address = f"tcp://127.0.0.1:{(port := free_port())}"
    alone = ["--no-dashboard", "--host", "127.0.0.1"]
    worker = ["dask_worker", address, *alone, "--nthreads", "1", "--no-nanny"]
    programs = [["dask_scheduler", *alone, "--port", str(port)], worker, worker]
    with ExitStack() as stack:
        processes = []
        for number, (program, *options) in enumerate(programs):
            log = stack.enter_context((folder / f"dask-{number}.log").open("wb"))
            begin = [sys.executable, "-m", f"distributed.cli.{program}", *options]
            processes.append(subprocess.Popen(begin, stdout=log, stderr=log, cwd=folder))
        try:
            yield address, processes
        finally:
            for process in processes:
                cut_the_power(process.pid)
                process.wait()


@contextmanager
def ray_cluster(environment: dict[str, str]) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A running Ray cluster of two worker processes; its address, and its head."""
    folder = tempfile.mkdtemp(prefix="ray-")  # a short path: its sockets lie in there
    address = f"127.0.0.1:{free_port()}"
    host, port = address.split(":")
    options = {
        "--node-ip-address": host,
        "--port": port,
        "--min-worker-port": "0",  # any that is free: its usual range may hold the head's own
        "--max-worker-port": "0",
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
        deadline = time.monotonic() + LONGEST_S
        while "Ray runtime started" not in (output := (Path(folder) / "ray.log").read_text()):
            assert head.poll() is None and time.monotonic() < deadline, output
            time.sleep(0.5)
        yield address, head
    finally:
        cut_the_power(head.pid)
        head.wait()
        shutil.rmtree(folder, ignore_errors=True)
