"""What each stage of the preset `recommended` contributes, over the paper's fifteen transfers.

    python bench/ablation.py [--real] [--only WORDS] [--add | --terms]

Without --add, one stage at a time is set back to what the paper says (what is lost without it);
with --add, the paper's pipeline gets the stages of `recommended` one after the other; with --terms,
each term of the optimisation is left out in turn: one that is worth nothing on real meshes should go.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
from paper_tables import Remembered
from transfers import Transfer, transfers

from upplied.config import Settings, settings_for
from upplied.planning.plan import plan_transfer
from upplied.records import Measures

_TERMS = ("standoff", "clearance", "axis", "turning")
_SHOWN = (
    ("inspected %", "coverage_inspected_pct"),
    ("seen %", "coverage_seen_pct"),
    ("of attainable", "coverage_attainable_pct"),
    ("Frechet", "frechet_z"),
    ("Frechet m", "frechet_m"),
    ("stand-off %", "standoff_kept_pct"),
    ("turn ratio", "camera_turn_ratio"),
    ("time s", "duration_s"),
    ("clearance m", "min_clearance_m"),
    ("incidence p95", "incidence_p95_deg"),
    ("peak m/s2", "peak_acceleration_mps2"),
)


def main() -> None:
    """Print one line per variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--real", action="store_true", help="on real meshes, see bench/real_data.py")
    parser.add_argument("--only", default="", help="rows whose title contains this")
    parser.add_argument("--add", action="store_true", help="from `paper` to `recommended`, stage by stage")
    parser.add_argument("--terms", action="store_true", help="each term of the optimisation left out in turn")
    options = parser.parse_args()
    rows = list(transfers(options.real, options.only))
    memos = [Remembered() for _ in rows]
    print(f"{'variant':24}{'ok':>4}" + "".join(f"{title:>15}" for title, _ in _SHOWN) + f"{'CPU s':>8}")
    for name, settings in without_terms() if options.terms else variants(options.add):
        began = time.process_time()
        results = [_measures(row, settings, memo) for row, memo in zip(rows, memos, strict=True)]
        _print(name, [one for one in results if one is not None], time.process_time() - began)


def variants(add: bool) -> Iterator[tuple[str, Settings]]:
    """From one preset to the other: stage by stage, or each stage alone."""
    paper, recommended = settings_for("paper"), settings_for("recommended")
    stages = [item.name for item in fields(Settings) if item.name not in ("preset", "visibility")]
    stages = [name for name in stages if getattr(paper, name) != getattr(recommended, name)]
    if add:
        # True visibility first: it brings the clouds with normals on which the other stages plan.
        grown = paper
        yield "paper", grown
        for name in ("visibility", *stages):
            grown = replace(grown, **{name: getattr(recommended, name)})
            yield f"+ {name}", grown
        return
    yield "recommended", recommended
    for name in stages:
        yield f"without {name}", replace(recommended, **{name: getattr(paper, name)})
    yield "paper", paper


def without_terms() -> Iterator[tuple[str, Settings]]:
    """`recommended`, and each time one term of its optimisation without weight."""
    ours = settings_for("recommended", verdict={"enforce": False})
    yield "recommended", ours
    for name in _TERMS:
        yield f"without {name}", replace(ours, optimise=replace(ours.optimise, **{name: 0.0}))
    yield "without shape", replace(ours, refine=replace(ours.refine, fidelity="coverage"))


def _measures(row: Transfer, settings: Settings, memo: Remembered) -> Measures | None:
    plan = plan_transfer(row.demonstration, row.source, row.target, settings, memo)
    return plan.measures if plan.status == "ok" else None


def _print(name: str, results: list[Measures], cpu_s: float) -> None:
    line = f"{name:24}{len(results):4}"
    for _, field in _SHOWN:
        values = np.array([getattr(one, field) for one in results])
        mean = values[np.isfinite(values)].mean() if np.isfinite(values).any() else np.nan
        line += f"{mean:15.2f}"
    print(f"{line}{cpu_s:8.1f}", flush=True)


if __name__ == "__main__":
    main()
