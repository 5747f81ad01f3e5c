"""What a fleet costs besides planning: overhead, memory and cost per target from 100 to 10 000 targets.

    python bench/scale.py [--targets 100 1000 10000] [--flow 1000]

Everything is real (structures and plans in a catalog, worker processes, caches, the flow with its Prefect
server) but the planning, which is cut down to one cloud and a scaled path of 60 poses: the rest would drown
in it, and ten thousand targets would take hours. Overhead is the CPU that is spent outside of planning, per
target, start-up of the processes included, and is told as a share of targets that take one second, as those
of `recommended` do.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from random_members import random_member  # noqa: E402

from upplied import fleet, open_catalog  # noqa: E402
from upplied.catalog import Catalog  # noqa: E402
from upplied.config import Settings  # noqa: E402
from upplied.fleet import planner, run  # noqa: E402
from upplied.fleet.planner import Outcome  # noqa: E402
from upplied.flows.server import Server  # noqa: E402
from upplied.planning.correspondence.memo import Memo  # noqa: E402
from upplied.planning.surface.lattice import voxel_cloud  # noqa: E402
from upplied.records import Cloud, Demonstration, Plan, Structure, Trajectory  # noqa: E402
from upplied.samples.fleet import member  # noqa: E402
from upplied.samples.pilot import fly  # noqa: E402

WORKERS = 2
POSES = 60
SHAPES = 100  # different boxes; the structures beyond have the shape of one of them, and their own hash
CHANGES = {"clouds": {"voxel_points": 60, "raw_points": 1000}}
REQUEST = fleet.PlanRequest(("baseline",), CHANGES)
TARGET_S = 1.0
COLUMNS = (
    "CPU ms each",
    "planning",
    "overhead",
    "wall ms each",
    "parent GiB",
    "worker GiB",
    "overhead at 1 s",
)

FLOW = """
import json, sys
sys.path.insert(0, sys.argv[4])
import scale
from upplied.flows.transfer_fleet import transfer_fleet
if __name__ == "__main__":
    scale.clock()
    changes, workers = json.loads(sys.argv[2]), int(sys.argv[3])
    state = transfer_fleet(sys.argv[1], "", presets=["baseline"], changes=changes,
                           resources={"workers": workers}, return_state=True)
    print(state.message, file=sys.stderr)
"""


def clocked(job: fleet.Job) -> Outcome:
    """What a worker does with a job, but for `scaled`; its time is the processor's, not the clock's."""
    began = time.process_time()
    with patch.object(planner, "plan_transfer", scaled):
        outcome = planner.plan_job(job)
    return replace(outcome, seconds=time.process_time() - began)


def scaled(
    demonstration: Demonstration,
    source: Structure,
    target: Structure,
    settings: Settings,
    memo: Memo,
    *_: None,
) -> Plan:
    """Stands for planning: a cloud of the target, kept in the cache, and the path scaled box by box."""
    cloud = memo("clouds", Cloud, target.sha256, lambda: voxel_cloud(target, settings.clouds))
    low, size = (f(source.vertices, axis=0) for f in (np.min, np.ptp))
    path = (demonstration.positions - low) / size * np.ptp(cloud.points, axis=0) + target.vertices.min(axis=0)
    t_s = (demonstration.t_ns - demonstration.t_ns[0]) * 1e-9
    return Plan(
        demonstration.demonstration_id,
        source.structure_id,
        target.structure_id,
        target.kind,
        settings.preset,
        "ok",
        trajectory=Trajectory(t_s, path, demonstration.quat_xyzw),
        is_viewpoint=np.ones(len(path), bool),
    )


def clock() -> None:
    """Let the workers of this process clock themselves; they know this module by its name."""
    import scale

    run.plan_job = scale.clocked


@dataclass
class Cost:
    """What a run took."""

    targets: int
    wall_s: float
    cpu_s: float  # of all processes
    planning_s: float  # of that time, what went into the targets themselves
    parent_gib: float = float("nan")  # peaks of resident memory
    worker_gib: float = float("nan")

    @property
    def overhead_s(self) -> float:
        """CPU seconds a target outside of planning; start-up of the processes included."""
        return (self.cpu_s - self.planning_s) / self.targets


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--targets", type=int, nargs="+", default=[100, 1000, 10_000])
    parser.add_argument("--flow", type=int, default=1000, help="targets of the run by Prefect; 0: none")
    parser.add_argument("--one", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(vars(alone(options.one))))
        return
    line("targets", *COLUMNS)
    for targets in options.targets:
        show(f"{targets}", in_a_process_of_its_own(targets))
    if options.flow:
        show(f"{options.flow}, by Prefect", by_prefect(options.flow))


def in_a_process_of_its_own(targets: int) -> Cost:
    """Peaks of memory are those of a process's life, so each size gets one."""
    command = [sys.executable, __file__, "--one", str(targets)]
    process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return Cost(**json.loads(process.stdout))


def alone(targets: int) -> Cost:
    """The fleet without an engine, in this process and its workers."""
    with tempfile.TemporaryDirectory() as folder:
        clock()
        catalog = fleet_of(Path(folder) / "catalog", targets)
        wall, cpu = time.perf_counter(), cpu_s()
        jobs = fleet.decide(catalog, REQUEST).jobs
        result = fleet.transfer(catalog, jobs, "bench", fleet.Resources(WORKERS))
        assert result.ok == targets, result.troubles[:3]
        return Cost(
            targets,
            time.perf_counter() - wall,
            cpu_s() - cpu,
            planning_s(catalog),
            gib(resource.RUSAGE_SELF),
            gib(resource.RUSAGE_CHILDREN),
        )


def by_prefect(targets: int) -> Cost:
    """The flow, with a server of its own; the CPU of both counts, the server's start-up does not."""
    with tempfile.TemporaryDirectory() as folder:
        catalog = fleet_of(Path(folder) / "catalog", targets)
        command = [sys.executable, "-c", FLOW, str(catalog.location), json.dumps(CHANGES), str(WORKERS)]
        command.append(str(Path(__file__).parent))
        with Server(Path(folder) / "prefect") as server:
            server.wait()
            wall, cpu = time.perf_counter(), cpu_s() + running_s(server.process.pid)
            subprocess.run(
                command,
                env=server.environment | {"PREFECT_LOGGING_LEVEL": "ERROR"},
                check=True,
                stderr=subprocess.DEVNULL,
            )
            wall_s = time.perf_counter() - wall
            time.sleep(10)  # the server still writes down what it was told
            spent = cpu_s() + running_s(server.process.pid) - cpu
        assert (catalog.transfers()["status"] == "ok").sum() == targets
        return Cost(targets, wall_s, spent, planning_s(catalog), worker_gib=gib(resource.RUSAGE_CHILDREN))


def fleet_of(folder: Path, targets: int) -> Catalog:
    """A catalog with a short demonstration round a cube and so many boxes."""
    catalog = open_catalog(folder)
    cube = member("cube-v1").structure
    flight = fly(cube, "sides")
    some = np.linspace(0, len(flight.positions) - 1, POSES).astype(int)
    short = replace(
        flight,
        t_ns=flight.t_ns[some],
        positions=flight.positions[some],
        quat_xyzw=flight.quat_xyzw[some],
        sha256="",
    )
    shapes = [random_member("box", seed).structure for seed in range(min(SHAPES, targets))]
    boxes = [
        replace(shapes[n % SHAPES], structure_id=f"box-{n:05d}", sha256=f"{n:064d}") for n in range(targets)
    ]
    catalog.add_structures([cube, *boxes])
    catalog.add_demonstrations([short])
    return catalog


def planning_s(catalog: Catalog) -> float:
    """CPU seconds that the workers spent on targets, as `clocked` told them."""
    return float(catalog.transfers(columns=["planning_s"])["planning_s"].sum())


def cpu_s() -> float:
    """CPU seconds of this process and of its children that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def running_s(pid: int) -> float:
    """CPU seconds so far of a process that runs, with its children."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def gib(who: int) -> float:
    """Largest resident memory of this process, or of any child that ended, GiB."""
    return resource.getrusage(who).ru_maxrss / 2**20


def show(what: str, cost: Cost) -> None:
    """One line of the table."""
    each = (cost.cpu_s, cost.planning_s, cost.cpu_s - cost.planning_s, cost.wall_s)
    line(
        what,
        *(f"{1000 * value / cost.targets:.1f}" for value in each),
        f"{cost.parent_gib:.2f}",
        f"{cost.worker_gib:.2f}",
        f"{100 * cost.overhead_s / TARGET_S:.1f} %",
    )


def line(*cells: object) -> None:
    """Cells in columns."""
    print(f"{cells[0]!s:22}" + "".join(f"{cell!s:>17}" for cell in cells[1:]), flush=True)


if __name__ == "__main__":
    main()
