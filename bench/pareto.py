"""The trade between the demonstrated shape and what is shown, over the paper's fifteen transfers.

    python bench/pareto.py [--real] [--only WORDS] [--svg FILE]

A line for each fidelity, and between them for bounds of one's own; the baseline, which keeps the shape
exactly, stands first.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from paper_tables import Remembered
from transfers import transfers

from upplied.config import FIDELITIES, Settings, settings_for
from upplied.planning.plan import plan_transfer
from upplied.records import Measures

_BOUNDS = (0.1, 0.4, 0.8)  # of the Frechet distance, z-scored, between those of the fidelities
_COLUMNS = (
    ("inspected %", "coverage_inspected_pct"),
    ("seen %", "coverage_seen_pct"),
    ("Frechet z", "frechet_floored"),
    ("Frechet m", "frechet_m"),
    ("turn ratio", "camera_turn_ratio"),
    ("time s", "duration_s"),
)


def main() -> None:
    """Print the curve, and draw it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true", help="on real meshes, see bench/real_data.py")
    parser.add_argument("--only", default="", help="rows whose title contains this")
    parser.add_argument("--svg", type=Path, help="draw the curve here")
    options = parser.parse_args()
    rows = list(transfers(options.real, options.only))
    memos = [Remembered() for _ in rows]
    print(f"{'variant':20}{'ok':>4}" + "".join(f"{title:>13}" for title, _ in _COLUMNS) + f"{'worst z':>9}")
    curve = []
    for name, settings in variants():
        plans = [
            plan_transfer(row.demonstration, row.source, row.target, settings, memo)
            for row, memo in zip(rows, memos, strict=True)
        ]
        measures = [plan.measures for plan in plans if plan.status == "ok"]
        means = [_mean(measures, field) for _, field in _COLUMNS]
        worst = max((one.frechet_floored for one in measures), default=float("nan"))
        print(
            f"{name:20}{len(measures):4}" + "".join(f"{mean:13.2f}" for mean in means) + f"{worst:9.2f}",
            flush=True,
        )
        curve.append((name, means[2], means[0], means[1]))
    if options.svg:
        _draw(curve, options.svg)


def variants() -> list[tuple[str, Settings]]:
    """The baseline, then from the tightest shape to the loosest; none is refused for what it shows."""
    ours = settings_for("recommended", verdict={"enforce": False})
    settings_by_name = [
        (name, replace(ours, refine=replace(ours.refine, fidelity=name))) for name in FIDELITIES
    ]
    bounded = [
        (f"bound {bound:g}", replace(ours, refine=replace(ours.refine, deviation=bound))) for bound in _BOUNDS
    ]
    return [("baseline", settings_for("baseline")), *settings_by_name, *bounded]


def _mean(measures: list[Measures], field: str) -> float:
    values = np.array([getattr(one, field) for one in measures])
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _draw(curve: list[tuple[str, float, float, float]], file: Path) -> None:
    """The points as an SVG: inspected coverage as discs, seen coverage as rings, over the departure."""
    wide, high, edge = 640, 420, 60
    most = max(point[1] for point in curve) or 1.0
    least = min(min(point[2:]) for point in curve)

    def at(shape: float, shown: float) -> str:
        x = edge + (wide - 2 * edge) * shape / most
        y = high - edge - (high - 2 * edge) * (shown - least) / max(100 - least, 1e-9)
        return f'cx="{x:.1f}" cy="{y:.1f}"'

    marks = [f'<circle {at(shape, shown)} r="4"/>' for _, shape, shown, _ in curve]
    marks += [f'<circle {at(shape, seen)} r="4" fill="none" stroke="black"/>' for _, shape, _, seen in curve]
    for name, shape, shown, _ in curve:
        place = at(shape, shown).replace("cx", "x").replace("cy", "y")
        marks.append(f'<text {place} dx="6" dy="-6" font-size="11">{name}</text>')
    marks.append(
        f'<text x="{edge}" y="{high - 20}" font-size="12">Frechet distance, z: 0 to {most:.2f}</text>'
    )
    marks.append(f'<text x="{edge}" y="24" font-size="12">coverage, %: {least:.1f} to 100</text>')
    body = "".join(marks)
    file.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}">{body}</svg>')


if __name__ == "__main__":
    main()
