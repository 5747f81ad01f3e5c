"""The paper's fifteen transfers: published figures, the baseline and both presets side by side.

    python bench/paper_tables.py [--real] [--only WORDS] [--pictures FOLDER] [--csv FILE]

`cov` is the paper's coverage (frustum, its correspondences), `seen` the share of the inspected
surface really seen (occlusion and incidence), `can` what any pose could see of it.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from real_data import real_folder
from transfers import Transfer, transfers

from upplied.config import settings_for
from upplied.files import replace_file
from upplied.outputs.figures import comparison_png, transfer_png
from upplied.planning.plan import plan_transfer
from upplied.records import Plan

_ORDER = ("recommended", "paper", "baseline")  # the first pays for what the three share
_COLUMNS = (
    ("cov", "coverage_paper_pct", 6, 1),
    ("seen", "coverage_seen_pct", 6, 1),
    ("can", "coverage_attainable_pct", 6, 1),
    ("fre_z", "frechet_z", 6, 2),
    ("fre_m", "frechet_m", 6, 1),
    ("clear", "min_clearance_m", 6, 2),
    ("so20%", "standoff_kept_pct", 6, 0),
    ("len_m", "path_length_m", 7, 0),
    ("dur_s", "duration_s", 6, 0),
)


class Remembered:
    """A memo in memory, for the runs of one pair."""

    def __init__(self) -> None:
        self.results: dict[tuple[str, str], Any] = {}

    def __call__(self, stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
        if (stage, key) not in self.results:
            self.results[stage, key] = compute()
        return self.results[stage, key]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true", help="on real meshes, see bench/real_data.py")
    parser.add_argument("--only", default="", help="rows whose title contains this")
    parser.add_argument("--pictures", type=Path, help="folder for one PNG per row and preset")
    parser.add_argument("--csv", type=Path, help="also write the figures here")
    options = parser.parse_args()
    if options.real and real_folder() is None:
        parser.error("no real meshes found; set UPPLIED_REAL_DATA to a folder with meshes/")
    print(
        f"{'transfer':28}{'preset':12}" + "".join(f"{name:>{wide}}" for name, _, wide, _ in _COLUMNS), end=""
    )
    print(f"{'wayp':>6}{'CPU s':>7}")
    rows = []
    for transfer in transfers(options.real, options.only):
        rows += _run(transfer, options.pictures)
    _print_means(rows)
    if options.csv:
        with options.csv.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, rows[0])
            writer.writeheader()
            writer.writerows(rows)


def _run(transfer: Transfer, pictures: Path | None) -> list[dict[str, Any]]:
    published = transfer.published
    print(
        f"{published.title:28}{'published':12}{published.coverage_pct:6.1f}"
        f"  baseline {published.baseline_pct:5.1f}{published.frechet:8.2f}"
    )
    memo, rows, plans = Remembered(), [], []
    for preset in _ORDER:
        began = time.process_time()
        plan = plan_transfer(
            transfer.demonstration, transfer.source, transfer.target, settings_for(preset), memo
        )
        rows.append(_row(published.title, plan, time.process_time() - began))
        plans.append(plan)
        print(_line(rows[-1], plan), flush=True)
    if pictures is not None:
        _draw(transfer, plans, pictures)
    return rows


def _row(title: str, plan: Plan, cpu_s: float) -> dict[str, Any]:
    figures = {name: getattr(plan.measures, name) for _, name, _, _ in _COLUMNS}
    waypoints = len(plan.trajectory) if plan.trajectory is not None else 0
    return {
        "transfer": title,
        "preset": plan.preset,
        "status": plan.status,
        **figures,
        "n_waypoints": waypoints,
        "cpu_s": cpu_s,
    }


def _line(row: dict[str, Any], plan: Plan) -> str:
    text = f"{'':28}{row['preset']:12}"
    if row["status"] != "ok":
        return text + f"{row['status']}: {plan.reason}"
    figures = "".join(f"{row[name]:{wide}.{digits}f}" for _, name, wide, digits in _COLUMNS)
    return text + figures + f"{row['n_waypoints']:6}{row['cpu_s']:7.1f}"


def _print_means(rows: list[dict[str, Any]]) -> None:
    print()
    for preset in _ORDER:
        rows_of_preset = [row for row in rows if row["preset"] == preset and row["status"] == "ok"]
        if rows_of_preset:
            means = "".join(
                f"{np.nanmean([row[name] for row in rows_of_preset]):{wide}.{digits}f}"
                for _, name, wide, digits in _COLUMNS
            )
            below = sum(row["min_clearance_m"] < 2.0 for row in rows_of_preset)
            print(f"{f'mean of {len(rows_of_preset)}':28}{preset:12}{means}   closer than 2 m: {below}")


def _draw(transfer: Transfer, plans: list[Plan], folder: Path) -> None:
    stem = transfer.published.title.replace(" > ", "-to-").replace(" ", "-").lower()
    for plan in plans:
        png = transfer_png(
            transfer.source, transfer.target, transfer.demonstration, plan, view=_view(transfer)
        )
        replace_file(folder / f"{stem}-{plan.preset}.png", png)
    shown = [plan for plan in plans if plan.trajectory is not None]
    if shown:
        replace_file(
            folder / f"{stem}-compared.png", comparison_png(transfer.target, shown, view=_view(transfer))
        )


def _view(transfer: Transfer) -> str:
    """The side that is inspected."""
    return {"engine_left": "other side", "wings": "top"}.get(transfer.published.inspection, "three-quarter")


if __name__ == "__main__":
    main()
