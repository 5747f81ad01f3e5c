"""Plans on scans to the end, judged by what is truly seen on the clean mesh.

    python bench/as_built_plans.py [--only WORD]

A plan is silently wrong where its status is ok, no warning names a part, and less than 80 % of what the plan
for the clean mesh shows of the right part is seen there.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import replace
from typing import Any

import numpy as np
from as_built import sort
from scans import VARIANTS, made, scan, true_parts

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.path_views import TRULY, views
from upplied.records import Camera, Plan, Trajectory
from upplied.samples.pilot import fly
from upplied.scene import scene_of

#: Kind, source, inspection, what is asked, target, and the parts that should be shown.
PLANS: tuple[tuple[str, str, str, dict[str, Any], str, str], ...] = (
    ("airliner", "a320-v1", "engine_left", {"repeat": "each", "expect": 4}, "b747-v1", "engine"),
    ("airliner", "a320-v1", "engine_left", {}, "b777-v1", "engine_left"),
    ("airliner", "a320-v1", "engine_left", {"counterparts": [("engine_left", "outer")]}, "b747-v1",
     "engine_left_outer"),
    ("airliner", "a320-v1", "wings", {}, "r11", "wing"),
    ("airliner", "a320-v1", "fuselage", {}, "b777-v1", "fuselage"),
    ("wind_turbine", "turbine-1-v1", "tower", {}, "turbine-2-v1", "tower"),
    ("bridge", "bridge-1-v1", "piers", {}, "bridge-2-v1", "pier"),
    ("ship", "cruise-v1", "hull", {}, "yacht-2-v1", "hull"),
)  # fmt: skip
STRANGERS = (("airliner", "a320-v1", "engine_left", "ship", "cruise-v1"),
             ("bridge", "bridge-1-v1", "piers", "airliner", "b777-v1"),
             ("ship", "cruise-v1", "hull", "bridge", "bridge-2-v1"))  # fmt: skip
CLEARANCE_M = 2.0  # that `recommended` keeps
SHOWN = 0.8  # of what the plan for the clean mesh shows of the right part


def plans(options: argparse.Namespace) -> None:
    """Plan on scans, and judge by the clean mesh."""
    print("source inspection > target (asked): variant: status, right part seen on the clean mesh "
          "(least of several), clearance there; silent wrong plans are marked")  # fmt: skip
    wrong = refused = planned = near = 0
    for kind, source, inspection, asked, target, right in PLANS:
        if options.only not in f"{kind} {inspection} {target}":
            continue
        clean = None
        for variant in VARIANTS:
            plan = _planned(kind, source, inspection, asked, kind, target, variant)
            said = any("part_" in warning for warning in plan.warnings)
            line = f"{source} {inspection} > {target} ({asked or 'once'}): {variant:8} {plan.status:8}"
            planned += 1
            if plan.trajectory is None:
                refused += 1
                print(f"{line} {plan.reason[:140]}", flush=True)
                continue
            seen, clearance = _judged(plan.trajectory, kind, target, right)
            clean = seen if variant == "model" else clean
            silent = clean is not None and seen < SHOWN * clean and not said
            wrong, near = wrong + silent, near + (clearance < CLEARANCE_M)
            known = plan.measures.counterpart_probability
            mark = ", SILENT WRONG" if silent else ", warned" if said else ""
            print(
                f"{line} seen {100 * seen:3.0f} %, clear {clearance:.2f} m, sure {known:.2f}{mark}",
                flush=True,
            )
    for kind, source, inspection, other, target in STRANGERS:
        for variant in ("shell", "cloud"):
            if options.only not in f"{kind} {inspection} {target}":
                continue
            plan = _planned(kind, source, inspection, {}, other, target, variant)
            said = f"stranger {source} {inspection} > {target}: {variant:8}"
            print(said, plan.status, plan.reason[:80])
    print(f"{planned} plans, {refused} refused, {wrong} silently wrong, {near} nearer on the clean mesh")


def _planned(
    kind: str, source: str, inspection: str, asked: dict[str, Any], other: str, target: str, variant: str
) -> Plan:
    one, there = made(kind, source).structure, scan(other, target, variant)
    settings = settings_for("recommended", correspondence=asked)
    return plan_transfer(fly(one, inspection, seed=2), one, replace(there, kind=kind), settings)


def _judged(path: Trajectory, kind: str, target: str, right: str) -> tuple[float, float]:
    """Share of the right part (the least of several) seen on the clean mesh, and the clearance there, m."""
    clean = made(kind, target).structure
    scene = scene_of(clean, 1)
    cloud = surface_samples(clean, scene, settings_for("recommended").clouds)
    seen = views(path, cloud, Camera(), TRULY, scene).seen.any(axis=0)
    name = true_parts(kind, target, cloud.points)
    area = np.ones(len(cloud)) if cloud.area_m2 is None else cloud.area_m2
    meant = [each for each in np.unique(name) if str(each) == right or sort(str(each)) == right]
    shares = [float(area[seen & (name == each)].sum() / area[name == each].sum()) for each in meant]
    along = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(path.positions)])
    return min(shares), float(scene.distance(along).min())


def main() -> None:
    """Plan and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", help="kind, inspection and target contain it")
    plans(parser.parse_args())


if __name__ == "__main__":
    main()
