"""Planned against flown: the fifteen transfers in simulated wind.

    python bench/flown.py [--wind M_PER_S] [--flights N] [--real] [--only WORDS]

Each plan of the preset `recommended` is flown N times with other gusts and errors; the worst
clearance and the mean coverage of the flights stand beside those of the plan.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from paper_tables import Remembered
from transfers import Transfer, transfers

from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import interpolate
from upplied.planning.plan import plan_transfer
from upplied.records import Plan
from upplied.simulate import Wind, fly_trajectory, measure_flown


def main() -> None:
    """Print one line per transfer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--wind", type=float, default=6.0, help="mean wind, m/s")
    parser.add_argument("--flights", type=int, default=3, help="flights of each plan")
    parser.add_argument("--real", action="store_true", help="on real meshes, see bench/real_data.py")
    parser.add_argument("--only", default="", help="rows whose title contains this")
    options = parser.parse_args()
    print(f"wind {options.wind:g} m/s, {options.flights} flights each")
    heads = (
        ("clear m", 9),
        ("flown", 8),
        ("seen %", 9),
        ("flown", 8),
        ("off m p50", 11),
        ("max", 6),
        ("CPU s", 8),
    )
    print(f"{'transfer':28}" + "".join(f"{head:>{wide}}" for head, wide in heads))
    for transfer in transfers(options.real, options.only):
        print(f"{transfer.published.title:28}{_line(transfer, options.wind, options.flights)}", flush=True)


def _line(transfer: Transfer, wind_mps: float, flights: int) -> str:
    settings, memo = settings_for("recommended"), Remembered()
    parts = (transfer.demonstration, transfer.source, transfer.target, settings, memo)
    plan = plan_transfer(*parts)
    if plan.trajectory is None:
        return f"  {plan.status}: {plan.reason}"
    began = time.process_time()
    clear, seen, off = [], [], []
    for seed in range(flights):
        wind = Wind(wind_mps, towards_deg=360.0 * seed / flights)
        try:
            flown = fly_trajectory(plan.trajectory, wind=wind, seed=seed)
        except RefusedError as refusal:
            return f"  {refusal}"
        measures = measure_flown(flown, plan, *parts).measures
        clear.append(measures.min_clearance_m)
        seen.append(measures.coverage_seen_pct)
        off.append(
            np.linalg.norm(flown.positions - interpolate(plan.trajectory, flown.t_s).positions, axis=1)
        )
    return _figures(plan, clear, seen, np.concatenate(off)) + f"{time.process_time() - began:8.1f}"


def _figures(plan: Plan, clear: list[float], seen: list[float], off: np.ndarray) -> str:
    measures = plan.measures
    return (
        f"{measures.min_clearance_m:9.2f}{min(clear):8.2f}{measures.coverage_seen_pct:9.1f}"
        f"{np.mean(seen):8.1f}{np.median(off):11.2f}{off.max():6.2f}"
    )


if __name__ == "__main__":
    main()
