"""Acceptance as a forecast: evidence of many pairs, what their forced plans show, and the calibration.

    python bench/forecast.py collect FILE [--strangers] [--shuffle SEED] [--budget SECONDS] [--processes N]
    python bench/forecast.py fit FILE [FILE ...]
    python bench/forecast.py judge FILE [FILE ...]

`collect` takes the pairs of bench/stability_pairs.py, plans what the gate would refuse too, and writes
evidence and outcome of each as a line of JSON. Strangers are declared to be of the demonstration's kind, so
that the geometry alone is asked; they are not planned. `fit` calibrates the probability on the targets of
half ``tune`` and prints the constants of `planning.carry.forecast`. `judge` says what the constants in force
accept, for both halves and each part.

The outcome of a pair of one kind is the inspected coverage of its forced plan, times the share of
counterparts that lie on the intended part, where the parts have names. That of strangers is 0.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from attention import INTENDED
from random_members import random_member
from scipy.optimize import minimize
from stability import read
from stability_pairs import Pair, demonstration, pairs, structure
from stability_rows import Memory, opened, warm_up

from upplied.config import settings_for
from upplied.errors import UppliedError
from upplied.geometry.scene import scene_of
from upplied.planning.carry.forecast import CAPS, OFFSET, WEIGHTS, evidence_of
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import Take, takes_of
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.frames import demonstration_in, frames_for, structure_in
from upplied.records import Bools, Floats

GOOD = 75.0  # inspected coverage, percent, that counts as most of it
RIDGE = 0.02
MISDECLARED = 0.01  # what a stranger counts beside a pair of like kind: one in 100 is declared wrongly
_MEASURED = {"acceptance": 10.0, "least_probability": 0.0}  # what is shown is measured whatever corresponds


def row_of(pair: Pair) -> dict[str, Any]:
    """Evidence and outcome of a pair."""
    row: dict[str, Any] = {
        "pair": pair.name,
        "part": pair.flight.part,
        "half": pair.half,
        "stranger": pair.stranger,
        "evidence": None,
        "coverage": None,
        "right": None,
        "reason": "",
    }
    memo = Memory()
    settings = replace(opened(0), registration=replace(opened(0).registration, **_MEASURED))
    try:
        flight, source = demonstration(pair.flight), structure(pair.flight.source)
        target = replace(structure(pair.target), kind=source.kind)
        here, there = frames_for(source, target, settings)
        pair_study = study_pair(structure_in(here, source), structure_in(there, target), settings, memo)
        take = takes_of(demonstration_in(here, flight), pair_study, settings, memo)[0]
        row |= {"evidence": evidence_of(take).values.tolist(), "right": _right(take, pair)}
        if not pair.stranger:
            plan = plan_transfer(flight, source, target, settings, memo)
            shown = plan.measures.coverage_inspected_pct
            row |= {"reason": plan.reason[:160], "coverage": None if np.isnan(shown) else shown}
    except UppliedError as error:
        row["reason"] = str(error)[:160]
    return row


def _right(take: Take, pair: Pair) -> float | None:
    """Share of the inspected surface whose counterpart is on the intended part; None if it has no name."""
    if not pair.generated or pair.stranger:
        return None
    kind, _, seed = pair.target.partition("-random-")
    named = random_member(kind, int(seed))
    fit, match = take.pair.surface, take.pair.surface.correspondences
    weight = take.inspection.attention.weight * fit.source.areas
    known = np.flatnonzero((match.target_index >= 0) & (weight > 0))
    triangle = scene_of(take.pair.target).closest(fit.target.points)[1]
    names = np.array(named.part_names)[named.part_of_triangle[triangle]]
    strict, attached = INTENDED[pair.flight.inspection]
    mine = np.array([name.startswith(strict + attached) for name in names])
    return float(weight[known][mine[match.target_index[known]]].sum() / max(weight[known].sum(), 1e-12))


def collect(options: argparse.Namespace) -> None:
    """Append the pairs that are not there yet."""
    file_of, until = options.files[0], time.monotonic() + options.budget
    names = {row["pair"] for row in read(file_of)}
    rest = (pair for pair in pairs(options.strangers, options.shuffle) if pair.name not in names)
    with (
        ProcessPoolExecutor(options.processes, initializer=warm_up) as pool,
        file_of.open("a", encoding="utf-8") as file,
    ):
        waiting = {pool.submit(row_of, pair) for pair, _ in zip(rest, range(options.processes), strict=False)}
        while waiting:
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for one in ready:
                print(json.dumps(one.result()), file=file, flush=True)
                if time.monotonic() < until and (pair := next(rest, None)):
                    waiting.add(pool.submit(row_of, pair))


def fit(options: argparse.Namespace) -> None:
    """Calibrate on one half of the structures, judge the other, and print the constants."""
    rows = _read(options.files)
    evidence = np.minimum([row["evidence"] for row in rows], CAPS)
    outcome = np.array([_outcome(row) for row in rows])
    weight = np.array([MISDECLARED if row["stranger"] else 1.0 for row in rows])
    tune = np.array([row["half"] == "tune" for row in rows])
    offset, weights = _calibrated(evidence[tune], outcome[tune] >= GOOD, weight[tune])
    _print_judged(rows, _probability(evidence, offset, weights), outcome)
    print(f"OFFSET = {offset:.2f}\nWEIGHTS = ({', '.join(f'{weight:.2f}' for weight in weights)})")


def judge(options: argparse.Namespace) -> None:
    """What the constants in force say."""
    rows = _read(options.files)
    evidence = np.minimum([row["evidence"] for row in rows], CAPS)
    outcome = np.array([_outcome(row) for row in rows])
    _print_judged(rows, _probability(evidence, OFFSET, np.array(WEIGHTS)), outcome)


def _read(files: Sequence[Path]) -> list[dict[str, Any]]:
    rows = [row for path in files for row in read(path) if row["evidence"] is not None]
    return [row for row in rows if not np.isnan(_outcome(row))]


def _outcome(row: dict[str, Any]) -> float:
    """Inspected coverage that counts, percent; NaN where no path was found though the shapes answer."""
    if row["stranger"]:
        return 0.0
    if row["coverage"] is None:
        return 0.0 if row["evidence"][0] > 0.5 else float("nan")
    return float(row["coverage"]) * (1.0 if row["right"] is None else float(row["right"]))


def _calibrated(evidence: Floats, good: Bools, weight: Floats) -> tuple[float, Floats]:
    """Logistic regression of weighted rows: weights of at least 0, a ridge on them in units of their caps."""

    def loss(values: Floats) -> float:
        margin = (values[0] - (evidence / CAPS) @ values[1:]) * np.where(good, 1, -1)
        return float(weight @ np.logaddexp(0, -margin) + RIDGE * (values[1:] ** 2).sum())

    start = np.ones(1 + len(CAPS))
    weights = minimize(loss, start, bounds=[(None, None), *[(0, None)] * len(CAPS)], method="L-BFGS-B").x
    return float(weights[0]), weights[1:] / np.array(CAPS)


def _probability(evidence: Floats, offset: float, weights: Floats) -> Floats:
    return np.asarray(1 / (1 + np.exp(evidence @ weights - offset)))


def _print_judged(rows: Sequence[dict[str, Any]], forecast: Floats, outcome: Floats) -> None:
    """Shares that pass the gate, how far forecast and frequency are apart in fifths, and what is wrong."""
    least = settings_for("recommended").registration.least_probability
    assert least is not None
    accepted, like = forecast >= least, np.array([not row["stranger"] for row in rows])
    of = {half: np.array([row["half"] == half for row in rows]) for half in ("tune", "report")}
    of |= {
        part: np.array([row["part"] == part for row in rows])
        for part in dict.fromkeys(r["part"] for r in rows)
    }
    for name, some in of.items():
        good, bad = like & some & (outcome >= 90), like & some & (outcome < 60)
        order = np.array_split(
            np.flatnonzero(like & some)[np.argsort(forecast[like & some], kind="stable")], 5
        )
        off = [abs(forecast[group].mean() - (outcome[group] >= GOOD).mean()) for group in order if len(group)]
        print(
            f"{name}: accepted {accepted[good].sum()} of {good.sum()} that show 90 %, "
            f"{accepted[bad].sum()} of {bad.sum()} below 60 %, {accepted[some & ~like].sum()} of "
            f"{(some & ~like).sum()} strangers; calibration error {100 * np.mean(off):.1f} points"
        )
    wrong = np.flatnonzero(accepted != (outcome >= GOOD))
    for place in wrong[np.argsort(-np.abs(forecast - (outcome >= GOOD))[wrong])][:20]:
        print(f"    {rows[place]['pair']}: {forecast[place]:.2f}, outcome {outcome[place]:.0f}")


def main() -> None:
    """Collect, fit or judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("collect", "fit", "judge"))
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument(
        "--strangers", action="store_true", help="pairs of other kinds, declared to be of one"
    )
    parser.add_argument("--shuffle", type=int, default=0, metavar="SEED", help="of the order of the pairs")
    parser.add_argument(
        "--budget", type=float, default=float("inf"), help="seconds, after which no pair begins"
    )
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    {"collect": collect, "fit": fit, "judge": judge}[options.what](options)


if __name__ == "__main__":
    main()
