"""Structures as they are built: parts found on scans, how certain that is, and what plans truly show.

    python bench/as_built.py parts FILE
    python bench/as_built.py fit FILE

`parts` finds the parts of scans (bench/scans.py) by structures whose pieces tell theirs, and the other way
round, and writes for each part the evidence and whether it is the right one as a line of JSON: right is a
part of which at least 70 % lies on the generator's part of that name (of that sort, where numbers differ),
and which holds at least half of it. `fit` calibrates
`correspondence.fit` on the samples (FIT) and on structures that nobody built (HOLDOUT), judges each by the
other, and prints the constants of all.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from as_built_cases import area_of, side, sort
from scans import VARIANTS, member_of, scan, true_parts
from scipy.optimize import minimize

from upplied.config import settings_for
from upplied.errors import UppliedError
from upplied.planning.correspondence.certainty import CAPS, evidence_of_counterpart, evidence_of_same_kind
from upplied.planning.correspondence.naming import choices_for
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.surface.parts import labels_of, parts_of
from upplied.records import Bools, Floats, Ints

SOURCES = {
    "airliner": ("a320-v1", "b747-v1"),
    "wind_turbine": ("turbine-1-v1",),
    "bridge": ("bridge-1-v1",),
    "ship": ("cruise-v1", "yacht-1-v1"),
}
FIT = {
    "airliner": ("b747-v1", "b777-v1", "beluga-v1", "r1", "r2"),
    "wind_turbine": ("turbine-2-v1", "turbine-3-v1", "r1"),
    "bridge": ("bridge-2-v1", "p4", "r1"),
    "ship": ("yacht-2-v1", "yacht-1-v1", "r1"),
}
HOLDOUT = {
    "airliner": ("r11", "r12", "r13", "r14"),
    "wind_turbine": ("r11", "r12"),
    "bridge": ("p5", "r11", "r12"),
    "ship": ("r11",),
}
SMALL = 0.01  # share of the surface below which a part is not asked about
RIDGE = 0.1
LEAST = 0.8  # probability that a plan is asked for
_BODY = 0  # the largest part
PURE, WHOLE = 0.7, 0.5  # of a part that is found on the right one, and of the right one that it holds


def pairs(variant: str, holdout: bool) -> Iterator[tuple[str, str, str, str, bool]]:
    """Kind, source, target, variant, and whether the source is the one that was scanned."""
    for kind, targets in (HOLDOUT if holdout else FIT).items():
        for target in targets:
            for source in SOURCES[kind]:
                if source != target:
                    yield kind, source, target, variant, False
        if variant in ("shell", "cloud"):
            yield kind, SOURCES[kind][0], targets[0], variant, True


def rows_of(
    kind: str, source: str, target: str, variant: str, turned_round: bool
) -> Iterator[dict[str, Any]]:
    """One row for each part that was answered, and for each other one of its kind."""
    settings = settings_for("recommended")
    names = (target, source) if turned_round else (source, target)
    one = scan(kind, names[0], variant if turned_round else "model")
    other = scan(kind, names[1], "model" if turned_round else variant)
    fit = study_pair(one, other, settings).surface
    here, registered = fit.source, fit.registered
    true_here = true_parts(kind, names[0], here.points)
    true_there = true_parts(kind, names[1], fit.target.points)
    inferred = fit.inferred >= 0
    mine, theirs = parts_of(here), parts_of(registered)
    common = {"kind": kind, "source": names[0], "target": names[1], "variant": variant, "told": inferred}
    counts = [sorts(kind, name) for name in names]
    wholes, carried = fit.registration.scanned, fit.carried
    if carried is None:
        return
    area = area_of(registered)
    for part in np.flatnonzero(mine.area > SMALL).tolist():
        answers = fit.correspondences.target_parts(part).tolist()
        if not answers:
            continue
        truth = _most(true_here[labels_of(here) == part])
        strict = counts[0].get(sort(truth)) == counts[1].get(sort(truth)) and not free(truth)
        right = _right(np.isin(labels_of(registered), answers), true_there, area, truth, strict)
        evidence = evidence_of_counterpart(here, [part], registered, answers, wholes, inferred, carried)
        yield {**common, "part": truth, "question": "answer", "right": right, "evidence": evidence.tolist()}
        alike = choices_for(mine, part, theirs, answers).tolist()
        for choice in dict.fromkeys([*alike, _BODY]):  # what is of no such size is no other one either
            if choice not in answers and len(answers) == 1:
                right = _right(labels_of(registered) == choice, true_there, area, truth)
                evidence = evidence_of_same_kind(registered, answers[0], choice, wholes, inferred)
                yield {
                    **common,
                    "part": truth,
                    "question": "other",
                    "right": right,
                    "evidence": evidence.tolist(),
                }


def sorts(kind: str, name: str) -> dict[str, int]:
    names = member_of(kind, name).part_names
    return {sort(each): sum(sort(other) == sort(each) for other in names) for each in names}


def free(name: str) -> bool:
    """Whether any of the sort will do: a rotor may stand as it likes."""
    return name.startswith("blade")


def _most(names: np.ndarray) -> str:
    known, count = np.unique(names, return_counts=True)
    return str(known[count.argmax()])


def _right(mine: Bools, true: np.ndarray, area: Floats, truth: str, strict: bool | None = None) -> bool:
    """Whether samples are the part that is meant, or one of its sort on its side, or any of its sort."""
    name = _most(true[mine])
    fits = name == truth if strict else sort(name) == sort(truth)
    fits &= strict is None or side(name) == side(truth)
    both = area[mine & (true == name)].sum()
    return bool(fits and both >= PURE * area[mine].sum() and both >= WHOLE * area[true == name].sum())


def parts(options: argparse.Namespace) -> None:
    """Write the evidence of all parts."""
    with Path(options.file).open("a", encoding="utf-8") as file:
        for variant in options.variants.split(",") if options.variants else VARIANTS:
            for holdout in (False, True):
                for pair in pairs(variant, holdout):
                    try:
                        for row in rows_of(*pair):
                            file.write(json.dumps({**row, "held": holdout}) + "\n")
                    except UppliedError as error:
                        print(*pair, error)
                    file.flush()


def fit(options: argparse.Namespace) -> None:
    """Calibrate and judge both questions."""
    rows = [json.loads(line) for line in Path(options.file).read_text(encoding="utf-8").splitlines()]
    for question in ("answer", "other"):
        some = [row for row in rows if row["question"] == question]
        evidence = np.minimum(np.array([row["evidence"][: len(CAPS)] for row in some]), CAPS)
        right, holdout = (np.array([row[name] for row in some], bool) for name in ("right", "held"))
        known = np.empty(len(some))
        for half in (holdout, ~holdout):  # each is judged by what was calibrated on the other
            known[half] = _probability(evidence[half], _calibrated(evidence[~half], right[~half]))
        print(f"\n{question}: {len(some)} parts, {holdout.sum()} of them of structures that nobody built")
        _print_judged("each half judged by the other", known, right)
        for variant in VARIANTS:
            which = np.array([row["variant"] == variant for row in some])
            if which.any():
                sure = which & (known >= LEAST)
                print(f"  {variant:8} {which.sum():4} parts, right {100 * right[which].mean():5.1f} %, "
                      f"said {100 * known[which].mean():5.1f} %; "
                      f"{100 * sure.sum() / which.sum():5.1f} % pass, "
                      f"wrong {(sure & ~right).sum()}")  # fmt: skip
        print("constants, from all:", tuple(round(float(x), 2) for x in _calibrated(evidence, right)))


def _calibrated(evidence: Floats, right: Bools) -> Floats:
    """Logistic regression with weights of at least 0 and a ridge on them, in units of their caps."""

    def loss(values: Floats) -> float:
        margin = (values[0] - (evidence / CAPS) @ values[1:]) * np.where(right, 1, -1)
        return float(np.logaddexp(0, -margin).sum() + RIDGE * (values[1:] ** 2).sum())

    start = np.ones(1 + len(CAPS))
    weights = minimize(loss, start, bounds=[(None, None), *[(0, None)] * len(CAPS)], method="L-BFGS-B").x
    return np.asarray(weights / np.array([1.0, *CAPS]))


def _probability(evidence: Floats, model: Floats) -> Floats:
    return np.asarray(1 / (1 + np.exp(evidence @ model[1:] - model[0])))


def _print_judged(name: str, known: Floats, right: Bools) -> None:
    """What was said and what was right, by what was said."""
    print(f"  {name}: {len(right)} parts, right {100 * right.mean():.1f} %")
    for low, high in ((0, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 0.97), (0.97, 1.01)):
        some: Ints = np.flatnonzero((known >= low) & (known < high))
        if len(some):
            top = min(100 * high, 100)
            print(f"    {100 * low:3.0f} to {top:3.0f} %: {len(some):4} parts, "
                  f"said {100 * known[some].mean():5.1f}, right {100 * right[some].mean():5.1f}")  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, run in (("parts", parts), ("fit", fit)):
        command = commands.add_parser(name)
        command.add_argument("file")
        command.set_defaults(run=run)
        if run is parts:
            command.add_argument("--variants", default="")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
