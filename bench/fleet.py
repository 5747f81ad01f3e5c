"""A fleet, as ratios in one run: against a plain script, cold and warm, one process and two.

    python bench/fleet.py [--targets N] [--recommended N] [--peer N] [--pairs N] [--no-scaling]

Random airliners get the demonstration round an A320's fuselage. `plain` is bench/plain.py, run for a
few of them (--peer) in one process, as such scripts are; Open3D takes threads for itself. CPU seconds
are those of all processes, start-up included. Scaling stands beside what the machine allows: two
processes that plan the same target again and again and share nothing else. See bench/README.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from random_members import random_member

from upplied import fleet, open_catalog
from upplied.catalog import Catalog
from upplied.config import settings_for
from upplied.fleet import planner
from upplied.fleet.planner import Outcome
from upplied.fleet.run import Keeper
from upplied.fleet.workers import Workers
from upplied.planning.carry.affine import registered_map
from upplied.planning.correspondence.pair import study_pair
from upplied.records import Cloud, Plan, Structure
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@dataclass
class Clocked:
    """What a run over the fleet took."""

    wall_s: float
    cpu_s: float
    plans: int

    @property
    def wall_each(self) -> float:
        """Seconds a plan."""
        return self.wall_s / self.plans

    @property
    def cpu_each(self) -> float:
        """CPU seconds a plan, start-up of the processes included."""
        return self.cpu_s / self.plans


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--targets", type=int, default=200, help="of preset paper")
    parser.add_argument("--recommended", type=int, default=100, help="targets of preset recommended")
    parser.add_argument("--peer", type=int, default=5, help="targets that the plain script plans; 0: none")
    parser.add_argument(
        "--pairs", type=int, default=2000, help="pairs to decide; 10000 takes two minutes to make"
    )
    parser.add_argument("--scaling", action=argparse.BooleanOptionalAction, default=True)
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before the start")
    with tempfile.TemporaryDirectory() as folder:
        warm_up(Path(folder))
        line("what", "plans", "wall s", "CPU s", "CPU s each")
        if options.targets:
            change = {"refine": {"iterations": 19}}
            timed = ours("paper", change, Path(folder), options.targets, options.scaling)
            if options.peer:
                against_a_script(*timed, options.peer, options.targets)
        if options.recommended:
            change = {"route": {"clearance_m": 2.1}}
            ours("recommended", change, Path(folder), options.recommended, options.scaling)
        if options.pairs:
            deciding(Path(folder), options.pairs)


def ours(
    preset: str, change: dict, folder: Path, targets: int, scaling: bool
) -> tuple[Catalog, Clocked, Clocked]:
    """A preset with nothing cached, with the caches of the night before, and by one process alone."""
    catalog = fleet_of(folder / preset, targets)
    cold = run(catalog, (preset,), 2)
    show(f"{preset}, nothing cached, 2 processes", cold)
    warm = run(catalog, (preset,), 2, change)
    show(f"{preset}, other settings, caches warm", warm)
    last = catalog.transfers(preset=preset, columns=("planning_s",))["planning_s"]
    print(f"  of the last, in a process that has started: {last.mean():.2f} s a plan by wall")
    if scaling:
        alone = run(fleet_of(folder / f"{preset}-alone", targets), (preset,), 1)
        show(f"{preset}, nothing cached, 1 process", alone)
        print(
            f"{preset} from 1 to 2 processes: {alone.wall_s / cold.wall_s:.2f} by wall, where the machine "
            f"allows {ceiling(catalog, preset):.2f}; the two had {cold.cpu_s / cold.wall_s:.2f} cores, "
            f"the one {alone.cpu_s / alone.wall_s:.2f}",
            flush=True,
        )
    return catalog, cold, warm


def ceiling(catalog: Catalog, preset: str, seconds: float = 8.0) -> float:
    """How much more two processes do than one that need nothing of each other.

    They plan the same target again and again, from what they hold in memory, and nobody commits it.
    """
    job = fleet.decide(catalog, fleet.PlanRequest((preset,), {"route": {"ground_clearance_m": 2.5}})).jobs[0]

    def rate(lasting_s: float) -> float:
        began, rounds = time.perf_counter(), 0
        while rounds == 0 or time.perf_counter() - began < lasting_s:
            workers.run(planner.plan_job, job)
            rounds += 1
        return rounds / (time.perf_counter() - began)

    with Workers(2, planner.prepare, (str(catalog.location),)) as workers, ThreadPoolExecutor(2) as threads:
        list(threads.map(rate, [0.0, 0.0]))  # starts both
        one = rate(seconds)
        return sum(threads.map(rate, [seconds, seconds])) / one


def against_a_script(catalog: Catalog, cold: Clocked, warm: Clocked, peer: int, targets: int) -> None:
    """Preset paper beside the plain script."""
    for what, timed, with_surfaces in (("cold", cold, False), ("warm", warm, True)):
        script, frechet_s = plain(catalog, peer, with_surfaces, targets)
        show(f"plain script, {'surfaces given' if with_surfaces else 'all by itself'}, 1 process", script)
        wall = script.wall_each / timed.wall_each
        cpu = script.cpu_each / timed.cpu_each
        without = (script.cpu_s - frechet_s) / script.plans / timed.cpu_each
        print(
            f"plain over ours, {what}: wall {wall:.1f}, CPU {cpu:.1f}; "
            f"CPU {without:.1f} with the script's Frechet distances taken off it"
        )


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
    """Plan what a plan_request asks for and clock it."""
    jobs = fleet.decide(catalog, fleet.PlanRequest(presets, changes or {})).jobs
    wall, cpu = time.perf_counter(), cpu_s()
    result = fleet.transfer(catalog, jobs, "bench", fleet.Resources(workers))
    assert result.failed == 0, result.troubles
    return Clocked(time.perf_counter() - wall, cpu_s() - cpu, len(jobs))


def plain(catalog: Catalog, count: int, with_surfaces: bool, fleet_size: int) -> tuple[Clocked, float]:
    """The plain script on the first targets, and whether it finds what we find; CPU s of its Frechet too.

    Against warm caches it is given what they hold of surfaces; against cold ones it makes its own. What
    it does once for all targets counts as if it planned the whole fleet.
    """
    from plain import Body, Script, Surface, spent

    demonstration = catalog.demonstration(catalog.demonstrations()["demonstration_id"][0])
    source = catalog.structure(demonstration.structure_id)
    settings = settings_for("paper")
    rows = catalog.transfers(preset="paper", every=True)
    rows = rows[rows["settings_sha256"] == settings.sha256].head(count)
    targets = [catalog.structure(target) for target in rows["target_id"]]
    fits = [study_pair(source, target, settings, catalog.cache).surface for target in targets]

    def body(structure: Structure, cloud: Cloud) -> Body:
        surface = Surface(cloud.points, cloud.normals, cloud.area_m2) if with_surfaces else None
        return Body(structure.vertices, structure.triangles, surface)

    flight = demonstration.trajectory
    wall, cpu = time.perf_counter(), cpu_s()
    script = Script(
        body(source, fits[0].source),
        flight.positions,
        flight.quat_xyzw,
        flight.t_s,
        settings.viewpoints.shared,
    )
    spent.clear()
    share = count / fleet_size
    once = Clocked((time.perf_counter() - wall) * share, (cpu_s() - cpu) * share, count)
    spent["the demonstration"] = once.cpu_s
    wall, cpu, planned = time.perf_counter(), cpu_s(), []
    for target, fit in zip(targets, fits, strict=True):
        known = (fit.correspondences.target_index, registered_map(fit.registration).matrix)
        planned.append(script.transfer(body(target, fit.target), *(known if with_surfaces else ())))
    clocked = Clocked(once.wall_s + time.perf_counter() - wall, once.cpu_s + cpu_s() - cpu, count)
    compared(catalog, rows, planned)
    print(
        "plain, CPU s of a target: "
        + ", ".join(f"{stage} {seconds / count:.2f}" for stage, seconds in spent.items())
    )
    return clocked, spent["Frechet"]


def compared(catalog: Catalog, rows, planned) -> None:
    """How far the plain script's results are from ours: the largest difference of each column."""
    apart: list[float] = []
    worst: dict[str, float] = {}
    for row, other in zip(rows.itertuples(), planned, strict=True):
        ours = catalog.waypoints(row.transfer_id)[["x_m", "y_m", "z_m"]].to_numpy()
        same = len(ours) == len(other.positions)
        apart += list(np.linalg.norm(ours - other.positions, axis=1)) if same else [np.nan]
        for name, value in other.measures.items():
            worst[name] = max(worst.get(name, 0.0), abs(getattr(row, name) - value))
    print(f"plain and ours apart: waypoints {np.median(apart):.1e} m (median), {max(apart):.1e} m (most)")
    print("  " + ", ".join(f"{name} {value:.1e}" for name, value in worst.items()))


def deciding(folder: Path, pairs: int) -> None:
    """How long it takes to find that nothing changed."""
    catalog = open_catalog(folder / "many")
    cube = member("cube-v1").structure
    clones = [replace(cube, structure_id=f"t{n:05d}", sha256=f"{n:064d}") for n in range(pairs)]
    catalog.add_structures([cube, *clones])
    catalog.add_demonstrations([fly(cube, "sides")])
    plan_request = fleet.PlanRequest(("paper",))
    keeper = Keeper(catalog, "bench")
    for job in fleet.decide(catalog, plan_request).jobs:
        names = (job.demonstration_id, job.source_id, job.target_id, job.kind, "paper", "refused")
        keeper.add(Outcome(job, Plan(*names), 0.0))
    keeper.close()
    wall, cpu = time.perf_counter(), cpu_s()
    decision = fleet.decide(catalog, plan_request)
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
