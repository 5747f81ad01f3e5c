"""What it costs to write a fleet's plans by several processes at once, and to publish one change of it.

python bench/writing.py                      50 000 plans in 500 commits by 4 processes
python bench/writing.py --plans 4000         fewer, in commits of a hundred
python bench/writing.py --keep DIR           keep the catalog
python bench/writing.py --peer               the same rows by plain delta-rs, too: append, compact at the end
"""

from __future__ import annotations

import argparse
import functools
import gc
import hashlib
import json
import multiprocessing
import os
import resource
import tempfile
import time
from pathlib import Path

import deltalake
import numpy as np

from upplied.catalog import Catalog, export_tables, open_catalog
from upplied.catalog.schema import plan_rows, rows
from upplied.catalog.schema.tables import TABLES
from upplied.config import settings_for
from upplied.records import Demonstration, Measures, Plan, Registration, Structure, Trajectory

STEPS = 60  # waypoints of a plan
BATCH = 100  # plans of a commit
PLANS_OF_A_TARGET = 10


def fill(place: str, first: int, last: int, step: int, peer: bool) -> None:
    """Commit every `step`-th batch to the catalog or by the peer; write what it took, as JSON."""
    add = functools.partial(append, place) if peer else open_catalog(place).add_plans
    settings = settings_for("recommended")
    commits = []
    for batch in range(first, last, step):
        plans = [planned(number, settings) for number in range(batch * BATCH, (batch + 1) * BATCH)]
        began, cpu = time.perf_counter(), time.thread_time()
        add(plans)
        commits.append((time.perf_counter() - began, time.thread_time() - cpu))
    about = {"longest": max(commits), "dearest": max(cpu for _, cpu in commits), **spent()}
    Path(place, f"writer-{first}.json").write_text(json.dumps(about))


def append(place: str, plans: list[tuple[str, Plan, dict]]) -> None:
    """The rows of plans by delta-rs alone: no row is sealed, and no plan is known again or makes way."""
    added = [{"commit_id": "", **plan_rows.transfer_row(*plan)} for plan in plans]
    steps = plan_rows.waypoint_table({plan_rows.transfer_id(key): plan for key, plan, _ in plans})
    for name, table in (("waypoints", steps), ("transfers", rows.table_of(TABLES["transfers"], added))):
        deltalake.write_deltalake(f"{place}/{name}", table, mode="append")


def compact(place: str) -> float:
    """CPU seconds that it costs to merge the peer's files."""
    began = spent()["cpu"]
    for name in ("waypoints", "transfers"):
        stored = deltalake.DeltaTable(f"{place}/{name}")
        stored.optimize.compact()
        stored.vacuum(0, dry_run=False, enforce_retention_duration=False)
    return spent()["cpu"] - began


def planned(number: int, settings, again: int = 0) -> tuple[str, Plan, dict]:
    """One plan of a random path, with what a planner says of it."""
    rng = np.random.default_rng([number, again])
    quats = rng.normal(size=(STEPS, 4))
    path = Trajectory(
        np.arange(STEPS) * 0.5,
        np.cumsum(rng.normal(size=(STEPS, 3)), axis=0),
        quats / np.linalg.norm(quats, axis=1, keepdims=True),
    )
    laid = Registration(rng.random(3), np.eye(3), rng.random(3), 0.1, True)
    target = number // PLANS_OF_A_TARGET
    plan = Plan(
        f"flight-{number % PLANS_OF_A_TARGET}", "source-0", f"target-{target:05}", "ship", "recommended",
        "ok",
        trajectory=path, is_viewpoint=rng.random(STEPS) < 0.3, registration=laid,
        measures=Measures(), warnings=("it is windy",), surface_sha256=f"{number:064d}",
    )  # fmt: skip
    key = hashlib.sha256(f"{number}-{again}".encode()).hexdigest()
    hashes = {f"{name}_sha256": f"{again:064d}" for name in ("demonstration", "source", "target")}
    return key, plan, {"settings": settings, "run_id": f"run-{again}", "planning_s": 1.0, **hashes}


def spent() -> dict[str, float]:
    """CPU seconds of this process, and its peak memory, MB."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {"cpu": used.ru_utime + used.ru_stime, "mb": used.ru_maxrss / 1024}


def stage(catalog: Catalog, targets: int) -> None:
    """The structures and demonstrations of the fleet."""
    catalog.add_structures([box("source-0"), *(box(f"target-{at:05}") for at in range(targets))])
    path = np.cumsum(np.ones((STEPS, 3)), axis=0)
    t_ns = np.arange(STEPS) * 10**9
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (STEPS, 1))
    catalog.add_demonstrations(
        [Demonstration(f"flight-{at}", "source-0", t_ns, path + at, quats) for at in range(PLANS_OF_A_TARGET)]
    )


def box(name: str, sha256: str = "") -> Structure:
    """A triangle that stands for a structure."""
    return Structure(name, "ship", np.eye(3), np.array([[0, 1, 2]]), sha256=sha256)


def size_mb(place: Path, since_ns: int = 0) -> float:
    """Bytes of the files under a folder that were written since a moment, MB."""
    figures = {
        (s.st_ino, s.st_size)
        for p in place.rglob("*")
        if p.is_file() and (s := p.stat()).st_mtime_ns >= since_ns
    }
    return sum(size for _, size in figures) / 1e6


def live_mb(catalog: Catalog) -> float:
    """Bytes of the newest versions, MB."""
    total = 0
    for stored in catalog.tables.values():
        if (delta := stored.delta()) is not None:
            total += sum(Path(uri.removeprefix("file://")).stat().st_size for uri in delta.file_uris())
    return total / 1e6 + size_mb(Path(catalog.location) / "steps")


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--plans", type=int, default=50_000)
    options.add_argument("--writers", type=int, default=4)
    options.add_argument("--peer", action="store_true", help="by plain delta-rs as well")
    options.add_argument("--keep", type=Path, help="folder of the catalog")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = chosen.keep or Path(scratch)
        catalog = open_catalog(place / "catalog").create()
        stage(catalog, chosen.plans // PLANS_OF_A_TARGET)
        empty = size_mb(place)
        cost = write(place / "catalog", chosen.plans // BATCH, chosen.writers)
        root = Path(catalog.location)
        table("the catalog", cost, size_mb(root) - empty, live_mb(catalog))
        assert len(catalog.transfers(columns=["transfer_id"])) == chosen.plans
        if chosen.peer:
            peer = write(place / "peer", chosen.plans // BATCH, chosen.writers, peer=True)
            appended_mb, merging = size_mb(place / "peer"), compact(str(place / "peer"))
            live = size_mb(place / "peer")
            table("plain delta-rs", peer, appended_mb + live, live)
            print(f"  {'compacting in the end, CPU-s':30}{merging:10.2f}")
            print(f"  {'the catalog for one of it':30}{cost['cpu'] / (peer['cpu'] + merging):10.2f}")
        publish(catalog, place / "out", chosen.plans)


def write(place: Path, commits: int, writers: int, peer: bool = False) -> dict[str, float]:
    """What the plans cost by several processes: CPU and wall seconds, MB, and of commits the worst."""
    spawn = multiprocessing.get_context("spawn")
    place.mkdir(exist_ok=True)
    if peer:  # of two that make a table at once, delta-rs lets one fail
        append(str(place), [])
    began = time.perf_counter()
    processes = [
        spawn.Process(target=fill, args=(str(place), at, commits, writers, peer)) for at in range(writers)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0, "a writer stopped: what it cost stands for less than all"
    took, busy = time.perf_counter() - began, os.getloadavg()[0]
    results = [json.loads(path.read_text()) for path in place.glob("writer-*.json")]
    longest = max(one["longest"] for one in results)
    print(f"{commits} commits of {BATCH} plans by {writers} processes, {busy:.1f} of them busy, {took:.0f} s")
    return {
        "cpu": sum(one["cpu"] for one in results),
        "longest": longest[0],
        "longest_cpu": longest[1],
        "dearest": max(one["dearest"] for one in results),
        "mb": max(one["mb"] for one in results),
    }


def table(title: str, cost: dict[str, float], written_mb: float, live: float) -> None:
    """Print what one way of writing costs."""
    print(title)
    named = {
        "CPU, s": cost["cpu"],
        "longest commit, s": cost["longest"],
        "longest commit, CPU-s": cost["longest_cpu"],
        "dearest commit, CPU-s": cost["dearest"],
        "peak memory of a writer, MB": cost["mb"],
        "written, MB": written_mb,
        "live, MB": live,
    }
    for name, value in named.items():
        print(f"  {name:30}{value:10.2f}")


def publish(catalog: Catalog, out: Path, plans: int) -> None:
    """The first publication, one of nothing new, and one of a changed structure."""
    settings = settings_for("recommended")
    for what in ("all", "nothing new", "one structure"):
        if what == "one structure":
            catalog.add_structures([box("target-00007", "1" * 64)])
            catalog.add_plans([planned(70 + at, settings, 1) for at in range(PLANS_OF_A_TARGET)])
        gc.collect()
        began, cpu, since = time.perf_counter(), spent()["cpu"], time.time_ns()
        counts = export_tables(catalog, out)
        wall, cpu = time.perf_counter() - began, spent()["cpu"] - cpu
        print(
            f"publish {what:14}{cpu:8.2f} CPU-s{wall:8.2f} s{size_mb(out, since):10.2f} MB written, "
            f"{counts['transfers']} plans"
        )
        assert counts["transfers"] == plans


if __name__ == "__main__":
    main()
