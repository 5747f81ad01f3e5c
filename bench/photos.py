"""Missions of every row in every format: photos, their times as the files state them, and what they cost.

    python bench/photos.py [--real] [--only WORD] [--trigger S]

Each plan of `recommended` is written in every format and read again from its bytes. `before` is what an
export would ask for that takes a photo at each viewpoint: how many, and the shortest time between two.
`least` is the shortest time between photos of any format, `+ s` how much longer the flight takes for them;
`photos %` of the inspected surface they show, of the `plan %` that the plan shows.
Beside them the resolution in millimetres a pixel, demonstrated and planned.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from transfers import transfers

from upplied.config import settings_for
from upplied.outputs.missions import FORMATS, MissionOptions, export
from upplied.outputs.missions.read_back import read_mission
from upplied.planning.plan import plan_transfer
from upplied.records import Placement

_FINE = ("gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50", "gsd_demonstrated_mm_p95", "gsd_within_pct")
PLACE = Placement(47.0, 8.0, 400.0, 30.0, "ellipsoid")


def main() -> None:
    """Print all rows, then the worst."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--trigger", type=float, default=2.0)
    options = parser.parse_args()
    head = (
        "before",
        "least",
        "photos",
        "least",
        "plan %",
        "photos %",
        "plan s",
        "+ s",
        "mm 50",
        "mm 95",
        "was 50",
        "was 95",
    )
    print(f"{'transfer':32}" + "".join(f"{name:>8}" for name in (*head, "fine %", "blur px")), flush=True)
    worst, soonest = [], []
    for row in transfers(options.real, options.only):
        args = row.demonstration, row.source, row.target, settings_for("recommended")
        plan = plan_transfer(*args)
        if plan.trajectory is None or plan.is_viewpoint is None:
            print(f"{row.published.title:32} {plan.reason[:90]}", flush=True)
            continue
        placed = replace(row.target, placement=PLACE)
        before = plan.trajectory.t_s[plan.is_viewpoint]
        mission_options = MissionOptions(trigger_s=options.trigger, drone="m30t")
        apart, count, shown, flown = [], 0, "", 0.0
        with tempfile.TemporaryDirectory() as folder:
            for name in (name for name in FORMATS if name != "mcap"):
                goal = Path(folder) / f"m{FORMATS[name]}"
                done = export(plan, placed, name, goal, mission_options, row.demonstration.camera)
                for path, mission in zip(done.paths, done.missions, strict=False):
                    reading = read_mission(name, path.read_bytes(), mission)
                    apart += np.diff(reading.photo_s).tolist()
                if name == "csv":
                    count = sum(int(mission.photo.sum()) for mission in done.missions)
                    inside = [mission.arrival_s[mission.inspect] for mission in done.missions]
                    flown = sum(float(np.ptp(times)) for times in inside)
                    shown = f"{done.missions[0].shown_pct:.1f}"
        measures = plan.measures
        planned = float(plan.trajectory.t_s[-1])
        cells = [f"{len(before):8d}", f"{np.diff(before).min():8.2f}", f"{count:8d}", f"{min(apart):8.2f}",
                 f"{measures.coverage_inspected_pct:8.1f}", f"{shown:>8}", f"{planned:8.0f}",
                 f"{flown - planned:8.0f}"]  # fmt: skip
        cells += [f"{getattr(measures, name):8.1f}" for name in _FINE]
        print(f"{row.published.title:32}{''.join(cells)}{measures.blur_px_p99:8.2f}", flush=True)
        worst.append(float(np.mean(np.diff(before) < options.trigger)))
        soonest.append(min(apart))
    print(f"\nbefore: {100 * np.mean(worst):.0f} % of photos within {options.trigger:g} s of the one before; "
          f"now the nearest two of any format are {min(soonest):.3f} s apart")  # fmt: skip


if __name__ == "__main__":
    main()
