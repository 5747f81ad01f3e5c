"""Plans on scans to the end, judged by what is truly seen of the clean mesh, and how near they come to it.

    python bench/as_built_plans.py write FILE [--kinds airliner,ship] [--seeds 31-36] [--variants shell]
    python bench/as_built_plans.py write FILE --real [--kinds airliner] [--variants shell,cut20]
    python bench/as_built_plans.py judge FILE...
    python bench/as_built_plans.py places [--kinds airliner] [--seeds 31-36] [--variants cloud,shell]
    python bench/as_built_plans.py places --real

Each case is planned on the structure as modelled and as scanned. A plan is silently wrong where its status
is ok, no warning names a part, and less than 80 % of what the plan for the model shows of the right part is
seen.
The clearance that is promised (`min_clearance_m`) must be kept on the clean mesh.

`places` asks the same of places rather than of paths: thousands round each scan, from 1 to 4 m away, whether
the clean mesh is as far as the scan promises. Those whose nearest surface was never scanned (what was cut
away, what a reconstruction left out) are not counted, but told.

`--real` plans on real meshes, remeshed, or asks of places round them. What is right of one is what is decided
for it as modelled, whose pieces tell its parts; where that is not decided without a doubt, nothing is said of
what is seen.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from as_built_cases import CASES, RIGHT, SOURCE, Case, area_of, clean_cloud, flown, learn
from as_built_decisions import Memory, targets_of
from scans import DIVIDED, member_of, real_names, scan, surface_seen, true_parts
from scipy.spatial import cKDTree

from upplied.config import settings_for
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.airspace.rules import path_clearance
from upplied.planning.plan import decided, plan_transfer
from upplied.planning.visibility.observations import TRULY, views
from upplied.records import Bools, Camera, Floats, Plan, Trajectory

_CLOUDS = ("cloud", "sparse", "rough")
_SCANS = "cloud,sparse,rough,shell,noise,clutter,cut20"
_REAL_SCANS = "shell,cut20"
_STEP_M = 0.05
_LEFT_OUT = 0.02  # of the size
_NOT_CUT_M = 0.15  # five times the noise: what of the whole shell lies farther off a cut one was cut away
_TOLERANCE_M = 0.01  # within which a clearance is known (`airspace.rules`)


def plans(options: argparse.Namespace) -> None:
    """Plan on scans, and judge by the clean mesh; the plan on the model comes first."""
    path = Path(options.file[0])
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = {tuple(json.loads(line)["case"]): json.loads(line) for line in lines}
    memo = Memory()  # what is found out once is found out for the model as for the scan: the costs compare
    with path.open("a", encoding="utf-8") as file:
        for kind, target, variant in _real_targets(options) if options.real else targets_of(options):
            for number, case in enumerate(CASES[kind]):
                if options.cases and str(number) not in options.cases.split(","):
                    continue
                if options.real:
                    _learn(kind, case, target, memo)
                for scanned in dict.fromkeys(("model", variant)):
                    name = (kind, SOURCE[kind], target, scanned, number)
                    if name not in rows:
                        rows[name] = {"case": name, **_row(kind, case, target, scanned, memo)}
                        file.write(json.dumps(rows[name]) + "\n")
                        file.flush()
            memo.prune()


def _learn(kind: str, case: Case, target: str, memo: Memory) -> None:
    """Take for right what is decided, without a doubt, for a real mesh as modelled."""
    settings = settings_for("recommended", correspondence=case.correspondence)
    demonstration, source = flown(kind, case.inspection), member_of(kind, SOURCE[kind]).structure
    plan, takes = decided(demonstration, source, member_of(kind, target).structure, settings, memo)
    if takes and plan.status == "ok" and not _named(plan):
        learn(kind, case, target, takes)


def _row(kind: str, case: Case, target: str, variant: str, memo: Memory) -> dict[str, Any]:
    source, there = member_of(kind, SOURCE[kind]).structure, scan(kind, target, variant)
    demonstration = flown(kind, case.inspection)
    start = time.process_time()
    plan = plan_transfer(
        demonstration, source, there, settings_for("recommended", correspondence=case.correspondence), memo
    )
    took = time.process_time() - start
    row = {
        "inspection": case.inspection,
        "asked": case.label,
        "status": "warned" if plan.status == "ok" and _named(plan) else plan.status,
        "reason": plan.reason or "; ".join(plan.warnings),
        "cpu_s": took,
    }
    if plan.trajectory is None:
        return row
    return {**row, **_judged(plan, plan.trajectory, kind, case, target, variant)}


def _named(plan: Plan) -> bool:
    return any("part_" in warning for warning in plan.warnings)


def _judged(plan: Plan, path: Trajectory, kind: str, case: Case, target: str, variant: str) -> dict[str, Any]:
    """What of the right part, where it is known, is seen of the clean mesh (the least of several), and the
    clearance there.
    """
    scene, cloud = scene_of(member_of(kind, target).structure, 1), clean_cloud(kind, target)
    seen = views(path, cloud, Camera(), TRULY, scene).seen.any(axis=0)
    name, area = true_parts(kind, target, cloud.points), area_of(cloud)
    shares = [
        float(area[seen & mine].sum() / max(area[mine].sum(), 1e-9))
        for mine in (name == each for each in case.right(kind, target))
    ]
    return {
        **({"seen": (min if case.every else max)(shares)} if shares else {}),
        "reported": plan.measures.coverage_inspected_pct,
        "promised_m": plan.measures.min_clearance_m,
        "error_m": plan.measures.surface_error_m,
        "kept_m": path_clearance(scene, path.positions).distance_m,
        "kept_scanned_m": _clearance_of_scanned(path, kind, target, variant),
    }


def _clearance_of_scanned(path: Trajectory, kind: str, target: str, variant: str) -> float:
    """Clearance of a path on the clean mesh, m, where the surface that is nearest was scanned."""
    steps = np.linalg.norm(np.diff(path.positions, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    distances = np.arange(0, along[-1] + _STEP_M, _STEP_M)
    at = np.column_stack([np.interp(distances, along, axis) for axis in path.positions.T])
    near, _ = scene_of(member_of(kind, target).structure, 1).closest(at)
    if variant != "model":
        known = _was_scanned(kind, target, variant, near)
        at, near = at[known], near[known]
    return float(np.linalg.norm(at - near, axis=1).min(initial=np.inf))


def places(options: argparse.Namespace) -> None:
    """How far places round scans are from the clean mesh, beside what the scans promise of them."""
    print(f"{'structure':36}{'scan':8}{'size':>8}{'error, m':>10}{'largest, m':>12}{'places':>8}", end="")
    print(f"{'unscanned':>11}{'nearer':>8}{'if no error':>13}{'worst, m':>10}")
    clear = scans = nearer = counted = 0
    errors = []
    for kind, target, variant in _real_targets(options) if options.real else targets_of(options):
        if variant == "model":
            continue
        there, clean = scan(kind, target, variant), scene_of(member_of(kind, target).structure, 1)
        scene, at = scene_of(there, 1), _places(kind, target)
        away, (foot, _) = clean.distance(at), clean.closest(at)
        known = _was_scanned(kind, target, variant, foot)
        promised = scene.distance(at)
        spare = (away - promised)[known]
        off = scene.error_m - spare[promised[known] > 0]  # how much nearer than without an error
        few, else_, largest = (spare < -_TOLERANCE_M).sum(), (off > _TOLERANCE_M).sum(), max(off.max(), 0.0)
        size = len(there.triangles) or len(there.vertices)
        line = f"{kind + ' ' + target:36}{variant:8}{size:8}{scene.error_m:10.3f}{largest:12.3f}{len(at):8}"
        print(f"{line}{(~known).sum():11}{few:8}{else_:13}{spare.min():10.3f}", flush=True)
        clear, scans = clear + (few == 0), scans + 1
        nearer, counted = nearer + few, counted + len(spare)
        errors.append((scene.error_m, largest))
    print(f"{clear} of {scans} scans keep what they promise; {nearer} of {counted} places are nearer")
    stated, largest = np.median(errors, axis=0)
    print(f"in the median the error is {stated:.2f} m, the largest deviation {largest:.2f} m")


def _real_targets(options: argparse.Namespace) -> Iterator[tuple[str, str, str]]:
    kinds = options.kinds.split(",") if options.kinds else list(CASES)
    for kind in kinds:
        for name in real_names(kind):
            for variant in (options.variants or _REAL_SCANS).split(","):
                yield kind, name, variant


def _was_scanned(kind: str, target: str, variant: str, points: Floats) -> Bools:
    """Which points of the clean surface were scanned: seen, and neither cut away nor wholly left out.

    A reconstruction that is off by more than two hundredths of the size lost a piece, as a mast.
    """
    whole = scan(kind, target, "shell")
    seen = cKDTree(surface_seen(kind, target)).query(points)[0] < _LEFT_OUT * whole.diagonal_m
    if variant in _CLOUDS or variant == DIVIDED:
        return np.asarray(seen, bool)
    if variant.startswith("cloudcut"):
        left = cKDTree(scan(kind, target, variant).vertices).query(points)[0] < _LEFT_OUT * whole.diagonal_m
        return np.asarray(seen & left, bool)
    near, _ = Scene(whole.vertices, whole.triangles, 1).closest(points)
    there = scan(kind, target, variant)
    left = Scene(there.vertices, there.triangles, 1).distance(near) < _NOT_CUT_M
    rim = np.linalg.norm(near - points, axis=1) < _LEFT_OUT * whole.diagonal_m
    return np.asarray(seen & left & rim, bool)


def _places(kind: str, target: str) -> Floats:
    """Places before the clean surface, 1 to 4 m off it, that see the sky."""
    cloud, rng = clean_cloud(kind, target), np.random.default_rng(0)
    scene, reach = (
        scene_of(member_of(kind, target).structure, 1),
        2 * member_of(kind, target).structure.diagonal_m,
    )
    assert cloud.normals is not None
    at = cloud.points + rng.uniform(1, 4, (len(cloud), 1)) * cloud.normals
    return at[~scene.occluded(at, at + reach * cloud.normals, slack=0.0)]


def judge(options: argparse.Namespace) -> None:
    """Count plans by variant: against the plan on the model of the same case."""
    rows = [
        json.loads(line)
        for file in options.file
        for line in Path(file).read_text(encoding="utf-8").splitlines()
    ]
    models = {_without_variant(row): row for row in rows if row["case"][3] == "model"}
    print(f"{'scan':10}{'n':>5}{'ok':>5}{'warned':>8}{'refused':>9}", end="")
    print(f"{'seen less by, points: median':>30}{'p95':>6}", end="")
    print(f"{'silently wrong':>16}{'too near':>10}{'worst, m':>10}", end="")
    print(f"{'of scanned':>12}{'worst, m':>10}{'error, m':>10}{'CPU':>6}")
    for variant in [*dict.fromkeys(row["case"][3] for row in rows), "all scans"]:
        some = [
            row
            for row in rows
            if row["case"][3] == variant or variant == "all scans" != row["case"][3] != "model"
        ]
        _print_row(variant, some, models)
    for row in rows:
        if _silent(row, models):
            clean = models[_without_variant(row)].get("seen", np.nan)
            print(
                "SILENT", *row["case"], row["inspection"], row["asked"], f"{row['seen']:.2f} of {clean:.2f}"
            )


def _print_row(variant: str, some: Sequence[dict[str, Any]], models: dict[tuple[Any, ...], Any]) -> None:
    ok, warned, refused = (
        sum(row["status"] == status for row in some) for status in ("ok", "warned", "refused")
    )
    pairs = [(row, models.get(_without_variant(row), {})) for row in some]
    less = [
        100 * (clean["seen"] - row["seen"])
        for row, clean in pairs
        if row["status"] == "ok" and "seen" in clean and "seen" in row
    ]
    over = [row["kept_m"] - row["promised_m"] for row in some if "kept_m" in row]
    known = [row["kept_scanned_m"] - row["promised_m"] for row in some if "kept_scanned_m" in row]
    cost = [row["cpu_s"] / clean["cpu_s"] for row, clean in pairs if "kept_m" in row and "kept_m" in clean]
    error = [row["error_m"] for row in some if "error_m" in row]
    print(
        f"{variant:10}{len(some):5}{ok:5}{warned:8}{refused:9}{_of(np.median, less):30.1f}"
        f"{_of(lambda values: np.percentile(values, 95), less):6.1f}"
        f"{sum(_silent(row, models) for row in some):16}"
        f"{sum(each < -_TOLERANCE_M for each in over):5} / {len(over):3}{_of(min, over):9.2f}"
        f"{sum(each < -_TOLERANCE_M for each in known):7} / {len(known):3}{_of(min, known):9.2f}"
        f"{_of(np.median, error):10.2f}{_of(np.median, cost):6.2f}"
    )


def _of(measure: Any, values: Sequence[float]) -> float:
    return float(measure(values)) if values else float("nan")


def _without_variant(row: dict[str, Any]) -> tuple[Any, ...]:
    kind, source, target, _, number = row["case"]
    return kind, source, target, number


def _silent(row: dict[str, Any], models: dict[tuple[Any, ...], Any]) -> bool:
    """Whether a plan shows much less of the right part than the one for the model, and nothing says so."""
    clean = models.get(_without_variant(row), {}).get("seen")
    return row["status"] == "ok" and clean is not None and row["seen"] < RIGHT * clean


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, run in (("write", plans), ("judge", judge), ("places", places)):
        command = commands.add_parser(name)
        command.set_defaults(run=run)
        if run is not places:
            command.add_argument("file", nargs="+" if run is judge else 1)
        if run is not judge:
            command.add_argument("--real", action="store_true", help="take real meshes, remeshed")
            command.add_argument("--kinds", default="")
            command.add_argument("--seeds", default="31-33")
            command.add_argument("--variants", default="" if run is plans else _SCANS)
        if run is plans:
            command.add_argument("--cases", default="", help="numbers of cases of each kind")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
