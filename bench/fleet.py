"""A fleet, as ratios in one run: against a plain script, cold and warm, one process and two.

    python bench/fleet.py [--targets N] [--peer N] [--pairs N]

N random airliners get the demonstration round an A320's fuselage. `plain` is bench/plain.py, run for a
few of them (--peer) in one process, as such scripts are. CPU seconds are those of all processes.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.fleet.crew import Outcome
from upplied.fleet.ledger import Ledger
from upplied.records import Plan
from upplied.samples.fleet import member, random_member
from upplied.samples.pilot import fly


@dataclass
class Clocked:
    """What a run over the fleet took."""

    wall_s: float
    cpu_s: float
    plans: int

    @property
    def cpu_each(self) -> float:
        """CPU seconds a plan, start-up of the processes included."""
        return self.cpu_s / self.plans


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--targets", type=int, default=40)
    parser.add_argument("--peer", type=int, default=5, help="targets that the plain script plans")
    parser.add_argument(
        "--pairs", type=int, default=2000, help="pairs to decide; 10000 takes two minutes to make"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        planning(Path(folder), options.targets, options.peer)
        deciding(Path(folder), options.pairs)


def planning(folder: Path, targets: int, peer: int) -> None:
    """Presets cold and warm, the plain script, one process and two."""
    warm_up(folder)
    line("what", "plans", "wall s", "CPU s", "CPU s each")
    catalog = fleet_of(folder / "two", targets)
    paper = run(catalog, ("paper",), 2)
    show("paper, nothing cached, 2 processes", paper)
    again = run(catalog, ("paper",), 2, {"refine": {"iterations": 19}})
    show("paper, other settings, caches warm", again)
    show("recommended after paper, 2 processes", run(catalog, ("recommended",), 2))
    show(
        "recommended, other settings, caches warm",
        run(catalog, ("recommended",), 2, {"route": {"clearance_m": 2.1}}),
    )
    fresh = fleet_of(folder / "one", targets)
    alone = run(fresh, ("recommended",), 1)
    show("recommended, nothing cached, 1 process", alone)
    both = run(fleet_of(folder / "both", targets), ("recommended",), 2)
    show("recommended, nothing cached, 2 processes", both)
    print(
        f"scaling from 1 to 2 processes: {alone.wall_s / both.wall_s:.2f} by wall, on {os.cpu_count()} cores"
    )
    script = plain(catalog, peer)
    show("plain script, 1 process", script)
    ratio = script.cpu_each / paper.cpu_each
    print(f"CPU a target, plain over ours: cold {ratio:.1f}, warm {script.cpu_each / again.cpu_each:.1f}")
    wall = (script.wall_s / script.plans) / (paper.wall_s / paper.plans)
    warm = (script.wall_s / script.plans) / (again.wall_s / again.plans)
    print(f"wall a target, plain over ours on two processes: cold {wall:.1f}, warm {warm:.1f}")


def fleet_of(folder: Path, targets: int) -> Catalog:
    """A catalog with the demonstration and so many random airliners."""
    catalog = open_catalog(folder)
    source = member("a320-v1").structure
    catalog.add_structures([source, *(random_member("airliner", seed).structure for seed in range(targets))])
    catalog.add_demonstrations([fly(source, "fuselage")])
    return catalog


def warm_up(folder: Path) -> None:
    """Let compiled code be compiled, which happens once on a machine."""
    run(fleet_of(folder / "warm-up", 1), ("paper", "recommended"), 1)


def run(catalog: Catalog, presets: tuple[str, ...], workers: int, changes: dict | None = None) -> Clocked:
    """Plan what a wish asks for and clock it."""
    jobs = fleet.decide(catalog, fleet.Wish(presets, changes or {})).jobs
    wall, cpu = time.perf_counter(), cpu_s()
    result = fleet.transfer(catalog, jobs, "bench", fleet.Resources(workers))
    assert result.failed == 0, result.troubles
    return Clocked(time.perf_counter() - wall, cpu_s() - cpu, len(jobs))


def plain(catalog: Catalog, count: int) -> Clocked:
    """The plain script on the first targets, and whether it finds what we find."""
    from plain import Script

    demonstration = catalog.demonstration(catalog.demonstrations()["demonstration_id"][0])
    source = catalog.structure(demonstration.structure_id)
    rows = catalog.transfers(preset="paper", every=True).drop_duplicates("target_id").head(count)
    targets = [catalog.structure(target) for target in rows["target_id"]]
    wall, cpu = time.perf_counter(), cpu_s()
    script = Script(
        source.vertices,
        source.triangles,
        demonstration.positions,
        demonstration.quat_xyzw,
        settings_for("paper").viewpoints.shared,
    )
    found = [script.transfer(target.vertices, target.triangles) for target in targets]
    clocked = Clocked(time.perf_counter() - wall, cpu_s() - cpu, count)
    compared(catalog, rows, found)
    return clocked


def compared(catalog: Catalog, rows, found) -> None:
    """How far the plain script's results are from ours."""
    apart, coverage, frechet, clearance = [], [], [], []
    for row, other in zip(rows.itertuples(), found, strict=True):
        ours = catalog.waypoints(row.transfer_id)[["x_m", "y_m", "z_m"]].to_numpy()
        same = len(ours) == len(other.positions)
        apart += list(np.linalg.norm(ours - other.positions, axis=1)) if same else [np.nan]
        coverage.append(abs(row.coverage_paper_pct - other.coverage_pct))
        frechet.append(abs(row.frechet_z - other.frechet_z))
        clearance.append(abs(row.min_clearance_m - other.clearance_m))
    print(
        f"plain and ours apart: waypoints {np.nanmedian(apart):.1e} m (median), "
        f"coverage {max(coverage):.2f} points, Frechet {max(frechet):.1e}, clearance {max(clearance):.1e} m"
    )


def deciding(folder: Path, pairs: int) -> None:
    """How long it takes to find that nothing changed."""
    catalog = open_catalog(folder / "many")
    cube = member("cube-v1").structure
    clones = [replace(cube, structure_id=f"t{n:05d}", sha256=f"{n:064d}") for n in range(pairs)]
    catalog.add_structures([cube, *clones])
    catalog.add_demonstrations([fly(cube, "sides")])
    wish = fleet.Wish(("paper",))
    ledger = Ledger(catalog, "bench")
    for job in fleet.decide(catalog, wish).jobs:
        names = (job.demonstration_id, job.source_id, job.target_id, job.kind, "paper", "refused")
        ledger.add(Outcome(job, Plan(*names), 0.0))
    ledger.close()
    wall, cpu = time.perf_counter(), cpu_s()
    decision = fleet.decide(catalog, wish)
    assert decision.unchanged == pairs
    print(
        f"{pairs} unchanged pairs decided in {time.perf_counter() - wall:.2f} s, {cpu_s() - cpu:.2f} CPU s; "
        f"largest process so far {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB"
    )


def cpu_s() -> float:
    """CPU seconds of this process and of its children that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def show(what: str, clocked: Clocked) -> None:
    """One line of the table."""
    line(what, clocked.plans, f"{clocked.wall_s:.1f}", f"{clocked.cpu_s:.1f}", f"{clocked.cpu_each:.2f}")


def line(*cells: object) -> None:
    """Cells in columns."""
    print(f"{cells[0]!s:44}" + "".join(f"{cell!s:>12}" for cell in cells[1:]), flush=True)


if __name__ == "__main__":
    main()
