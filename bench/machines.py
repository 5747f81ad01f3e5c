"""A large fleet on several machines: peaks of memory of deciding, planning and publishing, GiB a process.

    python bench/machines.py [--targets 2000 10000] [--demonstrations 10] [--machines 3]

Each step runs in processes of its own on one catalog, with the stand-in plans of `bench/scale.py`; machines
share the catalog alone and read their shards from beside it, as those of a work pool do. What matters is the
column of each step from one size to the next: a peak that grows with the fleet is a bound on its size.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import scale

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.fleet import manifest
from upplied.fleet.workers import Limits
from upplied.flows.pool import shard_targets

RUN = "bench"


def main() -> None:
    """Print the table, or do one step of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--targets", type=int, nargs="+", default=[2000, 10_000])
    parser.add_argument("--demonstrations", type=int, default=10)
    parser.add_argument("--machines", type=int, default=3)
    parser.add_argument("--step", nargs="+", default=[], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        name, location, *rest = options.step
        print(json.dumps(STEPS[name](open_catalog(location), *rest)))
        return
    scale.line(
        "pairs", "decide GiB", "machine GiB", "planner GiB", "publish GiB", "decide s", "publish s", "files"
    )
    for targets in options.targets:
        measure(targets, options.demonstrations, options.machines)


def measure(targets: int, demonstrations: int, machines: int) -> None:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as folder:
        catalog = scale.fleet_of(Path(folder) / "catalog", targets)
        flight = catalog.demonstration(catalog.demonstrations()["demonstration_id"].iloc[0])
        flights = [
            replace(flight, demonstration_id=f"flight-{n}", sha256=f"{n:064x}")
            for n in range(1, demonstrations)
        ]
        catalog.add_demonstrations(flights)
        location = str(catalog.location)
        decided = json.loads(started("decide", location, str(machines)).communicate()[0])
        running = [started("plan", location, str(n), str(machines)) for n in range(machines)]
        planned = [json.loads(process.communicate()[0]) for process in running]
        published = json.loads(started("publish", location, f"{folder}/reports").communicate()[0])
        assert sum(item["ok"] for item in planned) == decided["pairs"] == targets * demonstrations
        scale.line(
            decided["pairs"],
            f"{decided['gib']:.2f}",
            f"{max(item['gib'] for item in planned):.2f}",
            f"{max(item['planner_gib'] for item in planned):.2f}",
            f"{published['gib']:.2f}",
            f"{decided['cpu_s']:.1f}",
            f"{published['cpu_s']:.1f}",
            sum(1 for _ in Path(location).rglob("*.parquet")),
        )


def started(step: str, *words: str) -> subprocess.Popen[str]:
    """A step in a process of its own."""
    return subprocess.Popen(
        [sys.executable, __file__, "--step", step, *words], stdout=subprocess.PIPE, text=True
    )


def decide(catalog: Catalog, machines: str) -> dict[str, float]:
    """What the run over the fleet does before anything is planned."""
    jobs = fleet.decide(catalog, scale.REQUEST).jobs
    size = shard_targets(len({job.target_id for job in jobs}), int(machines))
    manifest.write_shards(catalog, RUN, fleet.bundles(jobs, size))
    return {"pairs": len(jobs), **used()}


def plan(catalog: Catalog, number: str, of: str) -> dict[str, float]:
    """What one machine does: every so many shards."""
    scale.clock()
    names = sorted(path.name for path in Path(catalog.location, manifest.FOLDER, RUN).iterdir())
    done = fleet.Result()
    for name in names[int(number) :: int(of)]:
        jobs = manifest.read_shard(str(catalog.location), f"{RUN}/{name}")
        with fleet.Run(catalog, jobs, RUN, fleet.Resources(1, Limits()), engine="pool") as run:
            for index in range(len(run.shards)):
                run.plan(index)
        done.include(run.result)
    return {"ok": done.ok, "planner_gib": scale.gib(resource.RUSAGE_CHILDREN), **used()}


def publish(catalog: Catalog, folder: str) -> dict[str, float]:
    """What the run over the fleet does at its end."""
    fleet.publish(catalog, folder)
    return used()


def used() -> dict[str, float]:
    """Peak of resident memory and CPU of this process so far."""
    return {"gib": scale.gib(resource.RUSAGE_SELF), "cpu_s": time.process_time()}


STEPS = {"decide": decide, "plan": plan, "publish": publish}

if __name__ == "__main__":
    main()
