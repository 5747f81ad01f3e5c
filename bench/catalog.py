"""The catalog against pyarrow's own scan of its bytes, one trajectory among many, verify, commits, memory.

python bench/catalog.py              100 000 transfers, 3 million waypoints
python bench/catalog.py --full       1 million transfers, 30 million waypoints
python bench/catalog.py --keep DIR   keep the generated catalog, and use it again
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import resource
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from upplied.catalog import Catalog, compact, open_catalog, verify
from upplied.catalog.schema.steps import pose_arrays, poses_sha256
from upplied.catalog.schema.tables import STEPS, TABLES
from upplied.config import settings_for
from upplied.records import Measures, Plan, Trajectory

POINTS = 30  # waypoints of a generated plan
KINDS = ("airliner", "turbine", "ship", "bridge", "tower", "dam", "tank", "hall")
START = datetime(2026, 1, 1, tzinfo=UTC)
BATCH = 5_000  # plans in a generated commit


def generate(catalog: Catalog, transfers: int) -> None:
    """Fill a catalog with plans of nightly runs, a commit at a time, then merge the files."""
    rng = np.random.default_rng(0)
    for first in range(0, transfers, BATCH):
        numbers = np.arange(first, min(first + BATCH, transfers))
        keys = [hashlib.sha256(str(number).encode()).hexdigest() for number in numbers]
        order = np.argsort(keys)
        ids = [keys[at][:20] for at in order]
        when = START + timedelta(minutes=first // BATCH)
        steps = waypoints(rng, ids)
        hashes = {name: sha256_of(steps.slice(at * POINTS, POINTS)) for at, name in enumerate(ids)}
        commit = catalog.tables["waypoints"].keep(steps, when)
        catalog.tables["transfers"].append(plans(rng, numbers, keys, hashes, commit, first // BATCH))
    compact(catalog)


def waypoints(rng: np.random.Generator, ids: list[str]) -> pa.Table:
    """Random steps of some plans."""
    count = len(ids) * POINTS
    walk = np.cumsum(rng.normal(size=(len(ids), POINTS, 3)), axis=1).reshape(count, 3)
    quats = rng.normal(size=(count, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    columns = {
        "transfer_id": pa.array(ids).take(pa.array(np.repeat(np.arange(len(ids)), POINTS))),
        "seq": np.tile(np.arange(POINTS), len(ids)),
        "t_s": np.tile(np.arange(POINTS) * 0.5, len(ids)),
        **dict(zip(("x_m", "y_m", "z_m"), walk.T, strict=True)),
        **dict(zip(("qx", "qy", "qz"), quats.T, strict=False)),
        "qw": np.abs(quats[:, 3]),
        "is_viewpoint": rng.random(count) < 0.3,
        "commit_id": pa.repeat("", count),
        "origin": pa.repeat("demonstrated", count),
    }
    columns |= {name: pa.nulls(count, pa.float64()) for name in ("hfov_deg", "vfov_deg")}
    return pa.table([columns[name] for name in TABLES["waypoints"].names], schema=TABLES["waypoints"].schema)


def sha256_of(steps: pa.Table) -> str:
    """The hash that the row of these steps keeps."""
    return poses_sha256(steps["t_s"].to_numpy(), *pose_arrays(steps), np.asarray(steps["is_viewpoint"]))


def plans(
    rng: np.random.Generator,
    numbers: np.ndarray,
    keys: list[str],
    hashes: dict[str, str],
    commit: str,
    night: int,
) -> pa.Table:
    """Rows of plans: every pair is planned twice, a tenth is refused."""
    count = len(numbers)
    pair = numbers // 2
    settings = settings_for("recommended")
    texts: dict[str, Any] = {
        "transfer_id": [key[:20] for key in keys],
        "key": keys,
        "waypoints_sha256": [hashes[key[:20]] for key in keys],
        "demonstration_id": np.char.add("flight-", (pair % 50).astype(str)),
        "source_id": np.char.add("source-", (pair % 50).astype(str)),
        "target_id": np.char.add("target-", (pair // 50).astype(str)),
        "kind": np.array(KINDS)[pair % len(KINDS)],
        "preset": ["recommended"] * count,
        "status": np.where(rng.random(count) < 0.9, "ok", "refused"),
        "settings_sha256": [settings.sha256] * count,
        "run_id": [f"night-{night}"] * count,
        "commit_id": [commit] * count,
    }
    columns = []
    for field in TABLES["transfers"].schema:
        if field.name in texts:
            columns.append(pa.array([str(text) for text in texts[field.name]]))
        elif field.name == "planned_at":
            columns.append(
                pa.array([START + timedelta(minutes=night, microseconds=at) for at in range(count)])
            )
        elif field.name == "n_waypoints":
            columns.append(pa.array(np.full(count, POINTS)))
        elif pa.types.is_floating(field.type):
            columns.append(pa.array(rng.random(count) * 50))
        elif pa.types.is_integer(field.type):
            columns.append(pa.array(rng.integers(0, POINTS, count)))
        elif pa.types.is_string(field.type):
            columns.append(pa.array([""] * count))
        else:
            columns.append(pa.nulls(count, field.type))
    return pa.table(columns, schema=TABLES["transfers"].schema)


def timed(act: Callable[[], Any], repeat: int = 5) -> tuple[float, Any]:
    """The least wall time of some runs, s, after one that warms up."""
    result = act()
    best = float("inf")
    for _ in range(repeat):
        gc.collect()
        start = time.perf_counter()
        result = act()
        best = min(best, time.perf_counter() - start)
    return best, result


def compared(ours: Callable[[], Any], theirs: Callable[[], Any], repeat: int = 9) -> tuple[np.ndarray, Any]:
    """Wall and CPU time of both, s, (2, 2): the least of runs that take turns, after one that warms up."""
    result = ours()
    theirs()
    times = []
    for _ in range(repeat):
        for act in (ours, theirs):
            gc.collect()
            wall, cpu = time.perf_counter(), time.process_time()
            act()
            times.append((time.perf_counter() - wall, time.process_time() - cpu))
    return np.array(times).reshape(repeat, 2, 2).min(axis=0), result


def scan(catalog: Catalog, name: str, where: ds.Expression | None, columns: list[str] | None) -> pa.Table:
    """Pyarrow's own scan of the same files, without our code and without delta-rs."""
    if name in STEPS:
        files = [catalog.tables[name].files.path(file) for file in catalog.tables[name].files.names()]
    else:
        files = [uri.removeprefix("file://") for uri in catalog.tables[name].delta().file_uris()]
    return ds.dataset(files, schema=TABLES[name].schema).to_table(filter=where, columns=columns).to_pandas()


def reads(catalog: Catalog) -> None:
    """Questions beside the plain scan that reads the same rows."""
    kind, target = pc.field("kind") == "dam", pc.field("target_id") == "target-77"
    few = [
        "demonstration_id",
        "target_id",
        "preset",
        "planned_at",
        "transfer_id",
        "status",
        "coverage_seen_pct",
    ]
    questions = {
        "plans of one target": (lambda: catalog.transfers(structure="target-77", every=True), (target, None)),
        "plans of one kind, 7 columns": (
            lambda: catalog.transfers(kind="dam", every=True, columns=few),
            (kind, few),
        ),
        "the same, newest of each pair": (lambda: catalog.transfers(kind="dam", columns=few), (kind, few)),
        "every plan, 7 columns": (lambda: catalog.transfers(every=True, columns=few), (None, few)),
    }
    print(f"{'read':34}{'rows':>9}{'ours s':>9}{'scan s':>9}{'ratio':>7}{'CPU s':>9}{'CPU s':>9}{'ratio':>7}")
    for name, (ours, (where, columns)) in questions.items():
        least, comparison = compared(
            ours, lambda where=where, columns=columns: scan(catalog, "transfers", where, columns)
        )
        (wall, cpu), (their_wall, their_cpu) = least
        print(
            f"{name:34}{len(comparison):9}{wall:9.3f}{their_wall:9.3f}{wall / their_wall:7.2f}"
            f"{cpu:9.3f}{their_cpu:9.3f}{cpu / their_cpu:7.2f}"
        )


def one_trajectory(catalog: Catalog) -> None:
    """One plan's steps among all, warm; against pyarrow's scan with the same filter, and one without."""
    ids = catalog.transfers(every=True, columns=["transfer_id"])["transfer_id"]
    chosen = ids.sample(60, random_state=0).tolist()
    times = []
    for name in chosen:
        start = time.perf_counter()
        path = catalog.waypoints(name)
        times.append(1000 * (time.perf_counter() - start))
        assert len(path) == POINTS
    warm = np.array(times[10:])
    theirs, _ = timed(
        lambda: scan(catalog, "waypoints", pc.field("transfer_id") == chosen[0], None), repeat=1
    )
    print(
        f"one trajectory: {np.median(warm):.1f} ms median, {np.percentile(warm, 95):.1f} ms p95 warm "
        f"(goal 50); pyarrow looking for its id in the same files {1000 * theirs:.0f} ms"
    )


def checks(catalog: Catalog) -> None:
    """What it costs to verify all of it, beside decoding every Parquet file once, on one thread."""
    files = sorted(Path(catalog.location).rglob("*.parquet"))
    acts: dict[str, Callable[[], Any]] = {
        "decoding every file": lambda: sum(len(pq.read_table(file, use_threads=False)) for file in files),
        "verify": lambda: len(verify(catalog)),
    }
    took = []
    for what, act in acts.items():
        wall, cpu = time.perf_counter(), time.process_time()
        act()
        took.append(time.process_time() - cpu)
        print(f"{what}: {time.perf_counter() - wall:.2f} s, {took[-1]:.2f} CPU s")
    print(f"verify for one decoding of {len(files)} files: {took[1] / took[0]:.2f}")


def commits(catalog: Catalog) -> None:
    """Results of 256 targets in one commit, 200 waypoints each."""
    rng = np.random.default_rng(1)
    quats = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))
    for at in range(3):
        batch = []
        for number in range(256):
            path = Trajectory(np.arange(200) * 0.5, rng.normal(size=(200, 3)), quats)
            plan_row = Plan(
                "flight-0", "source-0", f"new-{number}", "dam", "paper", "ok", "", path, measures=Measures()
            )
            batch.append(
                (hashlib.sha256(f"{time.time_ns()}-{number}".encode()).hexdigest(), plan_row, {"run_id": "r"})
            )
        start, cpu = time.perf_counter(), time.process_time()
        catalog.add_plans(batch)
        took, worked = time.perf_counter() - start, time.process_time() - cpu
        print(f"commit {at + 1} of 256 plans, 51 200 waypoints: {took:.2f} s, {worked:.2f} CPU s (goal 0.5)")


def peak_mb() -> float:
    """Peak resident memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--full", action="store_true", help="1 million transfers")
    options.add_argument("--plans", type=int, default=100_000)
    options.add_argument("--keep", type=Path, help="folder of the generated catalog")
    chosen = options.parse_args()
    count = 1_000_000 if chosen.full else chosen.plans
    with tempfile.TemporaryDirectory() as scratch:
        place = (chosen.keep or Path(scratch)) / f"catalog-{count}"
        catalog = open_catalog(place)
        if not place.exists():
            start = time.perf_counter()
            generate(catalog, count)
            took = time.perf_counter() - start
            print(f"generated {count} transfers, {count * POINTS} waypoints in {took:.0f} s")
        size = sum(path.stat().st_size for path in place.rglob("*.parquet")) / 1e6
        print(f"{size:.0f} MB of Parquet; peak memory before reading {peak_mb():.0f} MB")
        one_trajectory(catalog)
        print(f"peak memory {peak_mb():.0f} MB")
        reads(catalog)
        checks(catalog)
        print(f"peak memory {peak_mb():.0f} MB")
        commits(catalog)


if __name__ == "__main__":
    main()
