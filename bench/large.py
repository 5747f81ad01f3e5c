"""What a large fleet takes of each process: 10 000 to 100 000 targets with ten demonstrations each.

    python bench/large.py [--settled 10000 100000] [--planned 1000 10000] [--demonstrations 10] [--pages 1000]

First a catalog that holds a plan of every pair, generated (real rows and waypoints, all of one flight): its
files are merged, it is decided when nothing changed and when everything has to be planned, the shards are
written and read, and it is published, first all of it, then where nothing changed, then where one structure
did. Then three machines plan it with other settings, with the stand-in for planning of `scale.py`: processes
that share the catalog and the shards alone, each with two workers and a cache of its own, as those of a work
pool. Each reads one of its eight shards, whole, asks the catalog what is settled, and plans the first so
many of its pairs (`--pairs 0 --shards 8` plans all, which takes hours); and it is published again. Then
smaller fleets of which nothing was planned, planned whole.

Each step runs in a process of its own, whose largest resident memory is reported, and that of its children.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(Path(__file__).parent))

import scale  # noqa: E402
from large_fleets import generate, stage  # noqa: E402

from upplied import fleet, open_catalog  # noqa: E402
from upplied.catalog import Catalog  # noqa: E402
from upplied.catalog.verbs import maintenance  # noqa: E402
from upplied.fleet import Limits, planner  # noqa: E402
from upplied.outputs.publish import publish  # noqa: E402

MACHINES = 3
SHARDS = 24  # as the pool cuts for three machines: eight to each
BOUND_GIB = 2.0  # of each process
ANOTHER = fleet.PlanRequest(("paper",), scale.CHANGES)  # of which the catalog holds no plan


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--settled", type=int, nargs="*", default=[10_000, 100_000])
    parser.add_argument("--planned", type=int, nargs="*", default=[1000, 10_000])
    parser.add_argument("--demonstrations", type=int, default=10)
    parser.add_argument("--pages", type=int, default=1000)
    parser.add_argument("--shards", type=int, default=1, help="of each machine, of the fleets of --settled")
    parser.add_argument("--pairs", type=int, default=3000, help="of each of these shards; 0: all")
    parser.add_argument("--step", nargs="+", default=[], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        name, *arguments = options.step
        print(json.dumps(step(name, *arguments)))
        return
    line("targets x demonstrations", "step", "CPU s", "GiB", "GiB, children", "what came of it")
    for targets in options.settled:
        with tempfile.TemporaryDirectory() as folder:
            many = str(options.demonstrations)
            what = f"{targets} x {many}, settled"
            for name, *arguments in (
                ("generate", str(targets), many),
                ("merge",),
                ("decide", "baseline"),
                ("decide", "paper"),
                ("shards",),
                ("published", str(options.pages)),
                ("published", str(options.pages)),
                ("change",),
                ("published", str(options.pages)),
            ):
                show(what, name, folder, arguments)
            for machine in planned(folder, ANOTHER, options.shards, options.pairs):
                line(what, *machine)
            show(what, "count", folder, [ANOTHER.presets[0]])
            show(what, "published", folder, [str(options.pages)])
    for targets in options.planned:
        with tempfile.TemporaryDirectory() as folder:
            many = str(options.demonstrations)
            show(f"{targets} x {many}, planned", "stage", folder, [str(targets), many])
            for machine in planned(folder, scale.REQUEST, SHARDS, 0):
                line(f"{targets} x {many}, planned", *machine)
            show(f"{targets} x {many}, planned", "count", folder, [scale.REQUEST.presets[0]])
            show(f"{targets} x {many}, planned", "published", folder, [str(options.pages)])


def show(what: str, name: str, folder: str, arguments: list[str]) -> None:
    """Run a step in a process of its own and print what it took."""
    line(what, *line_of(name, read(started(name, folder, *arguments))))


def line_of(name: str, took: dict[str, float | str]) -> list[str]:
    """The cells of a step; marked where it takes more than the bound."""
    most = max(float(took["gib"]), float(took["children_gib"]))
    over = " (!)" if most > BOUND_GIB else ""
    return [
        name,
        f"{took['cpu_s']:.0f}",
        f"{took['gib']:.2f}",
        f"{took['children_gib']:.2f}{over}",
        str(took["said"]),
    ]


def started(name: str, folder: str, *arguments: str) -> subprocess.Popen[str]:
    """A process that does one step."""
    command = [sys.executable, __file__, "--step", name, folder, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def read(process: subprocess.Popen[str]) -> dict[str, float | str]:
    """What a step took, when it ended."""
    out, _ = process.communicate()
    if process.returncode:
        raise SystemExit(f"{process.args} ended with {process.returncode}")
    figures: dict[str, float | str] = json.loads(out.splitlines()[-1])
    return figures


def step(name: str, folder: str, *arguments: str) -> dict[str, float | str]:
    """Do one step in this process."""
    steps: dict[str, Callable[..., str]] = {
        "generate": generate, "merge": merge, "decide": decide, "shards": shards, "published": published,
        "change": change, "stage": stage, "hand_out": hand_out, "machine": machine, "count": count,
    }  # fmt: skip
    cache = Path(folder) / f"cache-{arguments[0]}" if name == "machine" else None
    catalog = open_catalog(Path(folder) / "catalog", cache)
    began = time.perf_counter()
    result = steps[name](catalog, *arguments)
    return {
        "cpu_s": scale.cpu_s(),
        "wall_s": time.perf_counter() - began,
        "gib": scale.gib(resource.RUSAGE_SELF),
        "children_gib": scale.gib(resource.RUSAGE_CHILDREN),
        "said": result,
    }


def merge(catalog: Catalog) -> str:
    """As maintenance does, and each run at its end."""
    merged = maintenance.compact(catalog)
    return f"{sum(merged.values())} files merged into {files(catalog)}"


def decide(catalog: Catalog, preset: str) -> str:
    """What the night would plan."""
    decision = fleet.decide(catalog, fleet.PlanRequest((preset,), scale.CHANGES))
    return f"{len(decision.jobs)} to plan, {decision.unchanged} unchanged"


def shards(catalog: Catalog) -> str:
    """As a run hands out all of the fleet, and learns what of it is known."""
    jobs = fleet.decide(catalog, ANOTHER).jobs
    cut = fleet.shards(jobs, SHARDS, -(-len({job.target_id for job in jobs}) // SHARDS))
    planner.write_shards(catalog, "large", cut)
    known, missing = fleet.known_outcomes(catalog, jobs, "large")
    planner.remove_shards(catalog, "large")
    return f"{len(cut)} shards of {len(cut[0])} pairs; {known.total} known, {len(missing)} missing"


def published(catalog: Catalog, pages: str) -> str:
    """Tables and pages."""
    report = publish(catalog, Path(str(catalog.location)).parent / "reports", pictures=0, pages=int(pages))
    return f"{len(report.written)} pages written, {report.unchanged} kept; {size_mb(report.index.parent)} MB"


def size_mb(folder: Path) -> int:
    """Of the current generation of tables and of all pages."""
    current = sum(path.stat().st_size for path in (folder / "tables/current").resolve().rglob("*.parquet"))
    return round((current + sum(path.stat().st_size for path in folder.rglob("*.html"))) / 1e6)


def change(catalog: Catalog) -> str:
    """Another version of one structure, and its plans."""
    changed = replace(catalog.structure("box-00007"), sha256="7" * 64)
    catalog.add_structures([changed])
    scale.clock()
    jobs = fleet.decide(catalog, fleet.PlanRequest(("baseline",), scale.CHANGES)).jobs
    return str(fleet.transfer(catalog, jobs, "changed", fleet.Resources(1)))


def planned(folder: str, request: fleet.PlanRequest, shards: int, pairs: int) -> Iterator[list[str]]:
    """Let three machines plan what there is to plan, so many shards each; what each process took."""
    (preset,) = request.presets
    yield line_of("hand_out", read(started("hand_out", folder, preset)))
    limits = (str(shards), str(pairs))
    machines = [started("machine", folder, str(number), *limits) for number in range(MACHINES)]
    for number, process in enumerate(machines):
        yield line_of(f"machine {number + 1}", read(process))
    planner.remove_shards(open_catalog(Path(folder) / "catalog"), "large")


def hand_out(catalog: Catalog, preset: str) -> str:
    """As a run cuts what is to be planned for its machines."""
    jobs = fleet.decide(catalog, fleet.PlanRequest((preset,), scale.CHANGES)).jobs
    cut = fleet.shards(jobs, SHARDS, -(-len({job.target_id for job in jobs}) // SHARDS))
    planner.write_shards(catalog, "large", cut)
    return f"{len(cut)} shards of {len(cut[0])} pairs"


def machine(catalog: Catalog, number: str, most: str, pairs: str) -> str:
    """What a machine of the pool does with its shards, one after the other."""
    scale.clock()
    total, location = fleet.Result(), str(catalog.location)
    names = sorted(path.name for path in Path(catalog.shards.path("large")).iterdir())
    for name in names[int(number) :: MACHINES][: int(most)]:
        jobs = planner.read_shard(location, f"large/{name}")
        _, missing = fleet.known_outcomes(catalog, jobs, "large")
        selected = missing[: int(pairs) or None]
        total.include(fleet.transfer(catalog, selected, "large", fleet.Resources(scale.WORKERS, Limits())))
    return str(total)


def count(catalog: Catalog, preset: str) -> str:
    """What the catalog holds of the request at the end, and in how many files."""
    plans_stored = catalog.transfers(every=True, preset=preset, columns=["transfer_id", "status"])
    twice = len(plans_stored) - plans_stored["transfer_id"].nunique()
    again = len(fleet.decide(catalog, fleet.PlanRequest((preset,), scale.CHANGES)).jobs)
    return f"{(plans_stored['status'] == 'ok').sum()} plans, {twice} twice, {again} left; {files(catalog)}"


def files(catalog: Catalog) -> str:
    """How many data files the plans and their steps have."""
    plans, steps = catalog.tables["transfers"].delta(), catalog.tables["waypoints"].files.names()
    return f"{len(plans.file_uris())} files of transfers, {len(steps)} of waypoints"


def line(*cells: object) -> None:
    """Cells in columns."""
    widths = (26, 12, 8, 8, 16, 0)
    print("".join(f"{cell!s:{width or ''}}" for cell, width in zip(cells, widths, strict=True)), flush=True)


if __name__ == "__main__":
    main()
