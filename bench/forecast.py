"""Acceptance as a forecast: evidence of many pairs, what their forced plans show, and the calibration.

    python bench/forecast.py collect FILE [--part K/N] [--held]
    python bench/forecast.py fit FILE [FILE ...]
    python bench/forecast.py judge FILE [FILE ...]

`collect` flies demonstrations round the samples, round structures that nobody built and round the real
ones (bench/real_data.py), carries each to structures of its kind and to strangers, plans what the gate
would refuse too, and writes evidence and outcome of each pair as lines of JSON. `fit` calibrates the
probability on half of the structures and judges it on pairs of the other half, then on all, and prints
the constants of `planning.carry.forecast`. `judge` says of other pairs, collected with ``--held`` round
structures and by flights that nothing was calibrated on, what the gate accepts, kind by kind.

The outcome of a pair of one kind is the inspected coverage of its forced plan, pictures sharp or not, times
the share of counterparts that lie on the intended part, where the parts have names. That of strangers is 0.
"""

from __future__ import annotations

import argparse
import json
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from attention import FLIGHTS, INTENDED
from random_members import random_member
from real_data import real_folder, real_structure
from scipy.optimize import minimize

from upplied.config import Settings, settings_for
from upplied.errors import UppliedError
from upplied.geometry.scene import scene_of
from upplied.planning.carry.forecast import CAPS, OFFSET, WEIGHTS, evidence_of
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import Take, takes_of
from upplied.planning.plan import plan_transfer
from upplied.records import Bools, Floats, Structure
from upplied.samples.fleet import member, sample_structures
from upplied.samples.pilot import fly
from upplied.samples.surfaces import Member

KINDS = {
    "airplane": "airliner", "airliner": "airliner", "wind_turbine": "wind_turbine", "ship": "ship",
    "yacht": "ship", "building": "box", "box": "box", "bridge": "bridge", "industrial": "industrial",
}  # fmt: skip
SOURCES = ("a320-v1", "turbine-1-v1", "cruise-v1", "cube-v1", "bridge-1-v1")
REAL_SOURCES = (
    "airplane/a320_fr24", "wind_turbine/enercon_e82_98m", "ship/cruise_ship_219m",
    "building/office_30x47_fg",
)  # fmt: skip
HELD_SOURCES = (
    "b738_fr24", "e190_fr24", "vestas_v112_119m", "enercon_e82_78m", "ferry_88m", "silver_shadow_187m",
    "hotel_generic_fg", "generic_135x65x35_fg", "motor_yacht_22m",
    *(f"{kind}-random-700" for kind in FLIGHTS),
)  # fmt: skip
LIKE = 8  # targets of the same kind, for each flight
GOOD = 75.0  # inspected coverage, percent, that counts as most of it
RIDGE = 0.02
STRANGERS = 5  # targets of other kinds, for each flight
RANDOM = 1  # structures of each kind that nobody built
FORCED: dict[str, Any] = {
    "registration": {"acceptance": 10.0, "least_probability": 0.0},
    "verdict": {"enforce": False},
    "inspection": {"max_motion_px": 1e3},
}


@dataclass(frozen=True)
class Known:
    """A structure, its kind, and its named parts where it has them."""

    structure: Structure
    kind: str
    member: Member | None


def structures(first: int) -> list[Known]:
    """Samples, structures that nobody built, and real ones."""
    structures = [Known(one, one.kind, member(one.structure_id)) for one in sample_structures()]
    for kind in FLIGHTS:
        for seed in range(first, first + RANDOM):
            sample = random_member(kind, seed)
            structures.append(Known(sample.structure, kind, sample))
    folder = real_folder()
    for path in sorted((folder / "meshes").glob("[a-z]*/*.ply")) if folder else []:
        assert folder is not None
        structure = real_structure(folder, f"{path.parent.name}/{path.stem}")
        structures.append(Known(structure, KINDS[path.parent.name], None))
    return structures


def rows(part: int, parts: int, held: bool) -> Iterator[dict[str, Any]]:
    """Evidence and outcome of every pair of this part."""
    everything = structures(700 if held else 300)
    calibrated = (*SOURCES, *(place.split("/")[1] for place in REAL_SOURCES))
    flown = HELD_SOURCES if held else calibrated
    sources = [one for one in everything if one.structure.structure_id in flown]
    for number, source in enumerate(sources):
        if number % parts != part:
            continue
        for inspection in FLIGHTS.get(source.kind, ()):
            try:
                flight = fly(source.structure, inspection, seed=22 if held else 21)
            except UppliedError:
                continue
            rng = np.random.default_rng(zlib.crc32(flight.demonstration_id.encode()))
            others = [one for one in everything if one.structure is not source.structure]
            same = [one for one in others if one.kind == source.kind]
            strange = [one for one in others if one.kind != source.kind]
            same = [same[k] for k in np.sort(rng.permutation(len(same))[:LIKE])]
            chosen = [strange[k] for k in rng.choice(len(strange), STRANGERS, replace=False)]
            for target in same + chosen:
                try:
                    yield _row(source, target, inspection, flight)
                except UppliedError as error:
                    print(f"left out: {flight.demonstration_id} > {target.structure.structure_id}: {error}")


_KEPT: dict[tuple[str, str], Any] = {}


def _memo(stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
    """Remembers what is found of structures and flights, of pairs only while they are asked."""
    if (stage, key) not in _KEPT:
        _KEPT[stage, key] = compute()
    return _KEPT[stage, key]


def _row(source: Known, target: Known, inspection: str, flight: Any) -> dict[str, Any]:
    settings: Settings = settings_for("recommended", **FORCED)
    pair = study_pair(source.structure, target.structure, settings, _memo)
    take = takes_of(flight, pair, settings, _memo)[0]
    same = source.kind == target.kind
    row = {
        "source": source.structure.structure_id,
        "target": target.structure.structure_id,
        "inspection": inspection,
        "kind": source.kind,
        "same": same,
        "evidence": evidence_of(take).values.tolist(),
        "right": _right(take, source, target, inspection),
        "coverage": None,
        "status": "",
    }
    if same:
        plan = plan_transfer(flight, source.structure, target.structure, settings, _memo)
        row["status"] = plan.status
        shown = plan.measures.coverage_inspected_pct
        row["coverage"] = None if plan.status != "ok" or np.isnan(shown) else shown
        row["reason"] = plan.reason[:160]
    return row


def _right(take: Take, source: Known, target: Known, inspection: str) -> float | None:
    """Share of the inspected surface whose counterpart is on the intended part; None if it has no name."""
    if target.member is None or source.kind != target.kind:
        return None
    fit, match = take.pair.surface, take.pair.surface.correspondences
    weight = take.inspection.attention.weight * fit.source.area_m2
    known = np.flatnonzero((match.target_index >= 0) & (weight > 0))
    triangle = scene_of(target.structure).closest(fit.target.points)[1]
    names = np.array(target.member.part_names)[target.member.part_of_triangle[triangle]]
    strict, attached = INTENDED[inspection]
    mine = np.array([name.startswith(strict + attached) for name in names])
    return float(weight[known][mine[match.target_index[known]]].sum() / max(weight[known].sum(), 1e-12))


def collect(options: argparse.Namespace) -> None:
    """Write the pairs."""
    part, parts = (int(number) for number in options.part.split("/"))
    with open(options.files[0], "w", encoding="utf-8") as file:
        for row in rows(part, parts, options.held):
            print(json.dumps(row), file=file, flush=True)


def fit(options: argparse.Namespace) -> None:
    """Calibrate on half of the structures and judge the other half, in turn; then print the constants."""
    rows_ = _read(options.files)
    evidence = np.minimum([row["evidence"] for row in rows_], CAPS)
    outcome = np.array([_outcome(row) for row in rows_])
    good = outcome >= GOOD
    group = np.array([zlib.crc32(row["target"].encode()) % 2 for row in rows_])
    held = np.empty(len(rows_))
    for half in (0, 1):
        offset, weights = _calibrated(evidence[group != half], good[group != half])
        held[group == half] = _probability(evidence[group == half], offset, weights)
    _print_judged("targets held back", held, outcome)
    offset, weights = _calibrated(evidence, good)
    _print_judged("all", _probability(evidence, offset, weights), outcome)
    for place in np.argsort(-np.abs(held - good))[:12]:
        row = rows_[place]
        print(f"    {row['source']} {row['inspection']} > {row['target']}: {held[place]:.2f}, "
              f"outcome {outcome[place]:.0f}")  # fmt: skip
    print(f"OFFSET = {offset:.2f}\nWEIGHTS = ({', '.join(f'{weight:.2f}' for weight in weights)})")


def judge(options: argparse.Namespace) -> None:
    """What the constants in force say of pairs that they were not calibrated on, kind by kind."""
    rows_ = _read(options.files)
    evidence = np.minimum([row["evidence"] for row in rows_], CAPS)
    outcome = np.array([_outcome(row) for row in rows_])
    forecast = _probability(evidence, OFFSET, np.array(WEIGHTS))
    _print_judged("all", forecast, outcome)
    least = settings_for("recommended").registration.least_probability
    assert least is not None
    for words, same in (("its own kind", True), ("other kinds", False)):
        for kind in sorted({row["kind"] for row in rows_}):
            some = np.array([row["kind"] == kind and row["same"] == same for row in rows_])
            good = some & (outcome >= GOOD)
            print(f"    {kind} to {words}: {(forecast[some] >= least).sum()} of {some.sum()} accepted, "
                  f"{(forecast[good] >= least).sum()} of {good.sum()} that show {GOOD:g} %")  # fmt: skip
    wrong = np.flatnonzero((forecast >= least) != (outcome >= GOOD))
    for place in wrong[np.argsort(-np.abs(forecast - (outcome >= GOOD))[wrong])][:20]:
        row = rows_[place]
        print(f"    {row['source']} {row['inspection']} > {row['target']}: {forecast[place]:.2f}, "
              f"outcome {outcome[place]:.0f}")  # fmt: skip


def _read(files: Sequence[Path]) -> list[dict[str, Any]]:
    rows_ = [json.loads(line) for path in files for line in path.read_text().splitlines()]
    return [row for row in rows_ if not np.isnan(_outcome(row))]


def _outcome(row: dict[str, Any]) -> float:
    """Inspected coverage that counts, percent; NaN where no path was found though the shapes answer."""
    if not row["same"]:
        return 0.0
    if row["coverage"] is None:
        return 0.0 if row["evidence"][0] > 0.5 else float("nan")
    return float(row["coverage"]) * (1.0 if row["right"] is None else float(row["right"]))


def _calibrated(evidence: Floats, good: Bools) -> tuple[float, Floats]:
    """Logistic regression with weights of at least 0 and a ridge on them, in units of their caps."""

    def loss(values: Floats) -> float:
        margin = (values[0] - (evidence / CAPS) @ values[1:]) * np.where(good, 1, -1)
        return float(np.logaddexp(0, -margin).sum() + RIDGE * (values[1:] ** 2).sum())

    start = np.ones(1 + len(CAPS))
    weights = minimize(loss, start, bounds=[(None, None), *[(0, None)] * len(CAPS)], method="L-BFGS-B").x
    return float(weights[0]), weights[1:] / np.array(CAPS)


def _probability(evidence: Floats, offset: float, weights: Floats) -> Floats:
    return np.asarray(1 / (1 + np.exp(evidence @ weights - offset)))


def _print_judged(name: str, probability: Floats, outcome: Floats) -> None:
    """Shares that pass the gate, and how far forecast and frequency are apart in five groups."""
    accepted = probability >= settings_for("recommended").registration.least_probability
    shares = [
        f"{100 * accepted[some].mean():.1f} % of {some.sum()} {words}"
        for words, some in (("with at least 90 %", outcome >= 90), ("below 60 %", outcome < 60))
    ]
    order = np.array_split(np.argsort(probability, kind="stable"), 5)
    off = [abs(probability[some].mean() - (outcome[some] >= GOOD).mean()) for some in order]
    weight = [len(some) for some in order]
    print(f"{name}: accepted {', '.join(shares)}; calibration error "
          f"{100 * np.average(off, weights=weight):.1f} points")  # fmt: skip


def main() -> None:
    """Collect, fit or judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("collect", "fit", "judge"))
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--part", default="0/1")
    parser.add_argument("--held", action="store_true", help="other flights and structures, to judge by")
    options = parser.parse_args()
    {"collect": collect, "fit": fit, "judge": judge}[options.what](options)


if __name__ == "__main__":
    main()
