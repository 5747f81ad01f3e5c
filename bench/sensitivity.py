"""What each tuned number of the planner is worth: halved and doubled, and how far the plans move.

    python bench/sensitivity.py [--only WORD] [--part 1/2] [--csv FILE] [--real]

A number whose halving and doubling move nothing beyond the tolerance, on any row that runs its code, is no
decision: it should go. Which numbers are tuned says `docs/making/constants.csv`. Rows are small (1500
samples), so that all of it takes half an hour: a move here is a reason to look, not a figure to publish.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from scans import scan
from transfers import transfers

from upplied.config import Settings, settings_for
from upplied.errors import UppliedError
from upplied.planning.plan import plan_transfer
from upplied.records import Demonstration, Structure

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs" / "making"))
from constants import Constant, tuned

#: What is compared, and what is no move: as in bench/results.py.
COMPARED = {
    "coverage_inspected_pct": 1.0,
    "frechet_z": 0.02,
    "min_clearance_m": 0.1,
    "duration_s": 2.0,
    "counterpart_probability": 0.02,
}
#: Stages whose results a room before the changed one gave: they need not be computed again.
_BEFORE = {
    "correspondence": {"clouds", "skin", "views", "flight", "attention"},
    "airspace": {
        "clouds",
        "skin",
        "views",
        "flight",
        "attention",
        "registration",
        "correspondences",
        "parts",
    },
    "demonstration": {"clouds", "registration", "correspondences", "parts"},
    "carry": {"clouds", "skin", "views", "flight", "attention", "registration", "correspondences", "parts"},
}


#: Rows that run what a room is about; the others would repeat what these say.
_ROWS = {
    "surface": ("A320 engine > 747", "turbine 1 tower > turbine 2", "engine > scan of 747"),
    "correspondence": ("A320 engine > 747", "turbine 1 tower > turbine 2", "engine > scan of 747"),
    "airspace": ("piers, 6 m kept",),
    "demonstration": ("turbine 1 tower > turbine 2", "fuselage, noisy log", "engine > scan of 747"),
    "carry": ("A320 engine > 747", "cruise hull > yacht 1"),
}


@dataclass(frozen=True)
class Row:
    """One small transfer."""

    title: str
    demonstration: Demonstration
    source: Structure
    target: Structure
    settings: Settings


class Memory:
    """A memo that keeps some stages and computes the others anew."""

    def __init__(self, stages: set[str] | None = None, known: dict[Any, Any] | None = None) -> None:
        self.stages, self.known = stages, {} if known is None else known

    def __call__(self, stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
        if self.stages is None:
            return self.known.setdefault((stage, key), compute())
        return self.known[stage, key] if stage in self.stages and (stage, key) in self.known else compute()


def rows(real: bool) -> Iterator[Row]:
    """What the numbers are tried on; each runs some code that others do not."""
    small = settings_for(
        "recommended",
        clouds={"surface_samples": 1500, "raw_points": 20_000},
        optimise={"rounds": 2, "samples": 300},
        verdict={"enforce": False},
    )
    for word in ("engine > 747", "tower > turbine 2", "piers", "yacht 1"):
        each = next(transfers(real, word))
        yield Row(each.published.title, each.demonstration, each.source, each.target, small)
    each = next(transfers(False, "engine > 747"))
    shell = scan("airliner", "b747-v1", "clutter")
    yield Row("engine > scan of 747", each.demonstration, each.source, shell, small)
    each = next(transfers(False, "piers"))
    near = replace(small, route=replace(small.route, clearance_m=6.0))
    yield Row("piers, 6 m kept", each.demonstration, each.source, each.target, near)
    each = next(transfers(False, "fuselage > 777"))
    yield Row("fuselage, noisy log", _noisy(each.demonstration), each.source, each.target, small)


def _noisy(flown: Demonstration) -> Demonstration:
    """The log with errors of 4 cm, and a hover."""
    rng = np.random.default_rng(0)
    return replace(
        flown, positions=flown.positions + rng.normal(0, 0.04, flown.positions.shape), sha256="noisy"
    )


@contextmanager
def changed(constant: Constant, value: float) -> Iterator[None]:
    """The planner with another value of one number, compiled code too."""
    home = importlib.import_module(constant.module)
    before = getattr(home, constant.name)
    after: Any = value if constant.index is None else tuple(
        value if place == constant.index else each for place, each in enumerate(before)
    )  # fmt: skip
    undo: list[tuple[Any, str, Any]] = []
    for name, module in list(sys.modules.items()):
        if name.startswith("upplied.planning") and getattr(module, constant.name, None) is before:
            undo.append((module, constant.name, before))
            setattr(module, constant.name, after)
    for module in {each[0] for each in undo}:
        for name, compiled in list(vars(module).items()):
            code = getattr(getattr(compiled, "py_func", None), "__code__", None)
            if code is not None and constant.name in code.co_names:
                undo.append((module, name, compiled))
                setattr(module, name, njit(compiled.py_func))
    try:
        yield
    finally:
        for module, name, old in undo:
            setattr(module, name, old)


def figures(row: Row, memo: Memory) -> dict[str, float]:
    """The compared measures of a row; all NaN where it fails."""
    try:
        plan = plan_transfer(row.demonstration, replace(row.source), replace(row.target), row.settings, memo)
    except (UppliedError, ValueError, IndexError, np.linalg.LinAlgError):
        return dict.fromkeys(COMPARED, float("nan"))
    return {name: float(getattr(plan.measures, name)) for name in COMPARED}


def others(value: float) -> tuple[float, float]:
    """Half of a number and twice as much; of a share near 1, twice as near."""
    if isinstance(value, int | np.integer):
        return max(1, int(value) // 2), 2 * int(value)
    return value / 2, 2 * value if not 0.5 < value < 1 else 1 - (1 - value) / 2


def main() -> None:
    """Print one line for each number."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", help="numbers whose module or name contains this")
    parser.add_argument("--part", default="1/1", help="of the numbers, to share them among processes")
    parser.add_argument("--csv", type=Path, help="also write the moves here")
    parser.add_argument("--real", action="store_true", help="on real meshes, see bench/real_data.py")
    options = parser.parse_args()
    part, parts = (int(each) for each in options.part.split("/"))
    constants = [each for each in tuned() if options.only in f"{each.module}.{each.name}"][part - 1 :: parts]
    tried = list(rows(options.real))
    stores = [Memory() for _ in tried]
    base = [figures(row, store) for row, store in zip(tried, stores, strict=True)]
    stream = options.csv.open("w", newline="") if options.csv else None
    writer = csv.writer(stream) if stream else None
    print(f"{'number':52}{'value':>10}{'tried':>10}  moves")
    for constant in constants:
        before = _BEFORE.get(constant.module.split(".")[2], set())
        for value in others(constant.value):
            began, lines = time.process_time(), []
            with changed(constant, value):
                for row, store, was in zip(tried, stores, base, strict=True):
                    if row.title not in _ROWS.get(constant.module.split(".")[2], (row.title,)):
                        continue
                    now = figures(row, Memory(before, store.known))
                    lines += [
                        (row.title, name, now[name] - was[name])
                        for name, tolerance in COMPARED.items()
                        if not abs(now[name] - was[name]) <= tolerance
                        and not (np.isnan(now[name]) and np.isnan(was[name]))
                    ]
            words = "; ".join(f"{title}: {name} {by:+.3g}" for title, name, by in lines) or "none"
            spent = time.process_time() - began
            print(
                f"{constant.label:52}{constant.value:10.4g}{value:10.4g}  {words} [{spent:.0f} s]", flush=True
            )
            for title, name, by in lines or [("", "", 0.0)]:
                if writer and stream:
                    writer.writerow([constant.label, constant.value, value, title, name, f"{by:.4g}"])
                    stream.flush()


if __name__ == "__main__":
    main()
