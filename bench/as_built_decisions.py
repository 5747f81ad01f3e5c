"""What is decided for scans before a plan is made: silently wrong decisions are counted.

    python bench/as_built_decisions.py write FILE [--kinds airliner,ship] [--seeds 31-36] [--variants shell]
                                                  [--siblings samples,real] [--source shell]
    python bench/as_built_decisions.py real FILE [--kinds airliner] [--variants shell,cloud]
    python bench/as_built_decisions.py judge FILE... [--curve PICTURE.svg]

`write` takes each case as far as it is decided whether and where to fly (`plan.decided`), which costs a tenth
of a plan, and writes a line of JSON: what share of the inspected surface corresponds to the right part of the
generator, how much of each right part that reaches, how much of it was scanned, what was said. Flights of
other kinds are asked for as well. `judge` counts all. A decision is silently wrong where neither a refusal
nor a warning names the part and less than 80 % of what corresponds, or less than 80 % of what the
demonstration shows of its part, is on a right one.

With `--siblings` other structures may tell the parts of scans: the samples as modelled, though never the one
that an airliner was made from (`samples`), others that nobody built (`random`) and real meshes (`real`); of
all of them the nearest in proportions. With `--source` the source was scanned as well.

`real` takes flights round samples to real meshes, remeshed in the same ways; right is what is decided for the
mesh as modelled, whose pieces tell its parts.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from as_built_cases import CASES, RIGHT, SOURCE, Case, flown, learn, present, truth
from as_built_siblings import nearest_of, pool, siblings_for
from scans import VARIANTS, real_names, scan

from upplied.config import settings_for
from upplied.planning.plan import decided
from upplied.records import Structure

_FOR_STRANGERS = ("shell", "cloud")
_WHOLE = 0.9  # share of a part that was scanned, from which it is there
_SURE = (0.0, 0.5, 0.8, 0.9, 0.97, 1.01)  # bins of what was said


class Memory:
    """Remembers what is found out about sources; `prune` forgets what was asked for once only."""

    def __init__(self) -> None:
        self.known: dict[tuple[str, str], Any] = {}
        self.again: set[tuple[str, str]] = set()

    def __call__(self, stage: str, record_type: type, key: str, compute: Callable[[], Any]) -> Any:
        if (stage, key) in self.known:
            self.again.add((stage, key))
        else:
            self.known[stage, key] = compute()
        return self.known[stage, key]

    def prune(self) -> None:
        self.known = {key: value for key, value in self.known.items() if key in self.again}


def decisions(options: argparse.Namespace) -> None:
    """Write what is decided in each case."""
    path = Path(options.file[0])
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    names = {tuple(json.loads(line)["case"]) for line in lines}
    memo = Memory()
    with path.open("a", encoding="utf-8") as file:
        for kind, target, variant in targets_of(options):
            siblings, source = siblings_for(kind, target, variant, options.siblings), options.source
            own = [
                (number, partial(_row, kind, case, siblings=siblings, source_as=source))
                for number, case in enumerate(CASES[kind])
            ]
            for number, row in [*own, *_strangers(kind, variant, options)]:
                name = (kind, SOURCE[kind], target, variant, number)
                if name not in names:
                    file.write(json.dumps({"case": name, **row(target, variant, memo)}) + "\n")
                    file.flush()
            memo.prune()


def real(options: argparse.Namespace) -> None:
    """Write what is decided for scans of real meshes, where their pieces tell what is right."""
    memo = Memory()
    variants = options.variants.split(",") if options.variants else VARIANTS
    with Path(options.file[0]).open("a", encoding="utf-8") as file:
        for kind in options.kinds.split(",") if options.kinds else CASES:
            for target, case in itertools.product(real_names(kind), range(len(CASES[kind]))):
                for variant in dict.fromkeys(("model", *variants)):
                    row = _row(kind, CASES[kind][case], target, variant, memo)
                    labelled = variant != "model" or row["status"] == "ok"
                    name = (kind, SOURCE[kind], target, variant, case)
                    file.write(json.dumps({"case": name, "untold": not labelled, **row}) + "\n")
                    file.flush()
                    if not labelled:
                        break
            memo.prune()


def _strangers(
    kind: str, variant: str, options: argparse.Namespace
) -> Iterator[tuple[str, Callable[..., dict[str, Any]]]]:
    """The flights of the other kinds, on some scans, with names for their rows."""
    for other in CASES if variant in _FOR_STRANGERS else ():
        for inspection in dict.fromkeys(case.inspection for case in CASES[other] if other != kind):
            yield f"{other} {inspection}", partial(_stranger, kind, other, inspection, options)


def _stranger(
    kind: str,
    other: str,
    inspection: str,
    options: argparse.Namespace,
    target: str,
    variant: str,
    memo: Memory,
) -> dict[str, Any]:
    """What is decided for a flight of another kind; asked for all the same, it is to be refused."""
    source, settings = scan(other, SOURCE[other], options.source), settings_for("recommended")
    there = replace(scan(kind, target, variant), kind=other)
    some = nearest_of(there, pool(other, "", options.siblings), other)
    plan, _ = decided(flown(other, inspection), source, there, settings, memo, some)
    return {
        "stranger": True,
        "inspection": inspection,
        "asked": f"on a {kind}",
        "status": plan.status,
        "reason": plan.reason,
        "forecast": plan.measures.acceptance_probability,
    }


def targets_of(options: argparse.Namespace) -> Iterator[tuple[str, str, str]]:
    """Kind, structure that nobody built, and scan of it, as the options choose."""
    first, last = (int(each) for each in options.seeds.split("-"))
    kinds = options.kinds.split(",") if options.kinds else list(CASES)
    variants = options.variants.split(",") if options.variants else VARIANTS
    for seed, variant, kind in itertools.product(range(first, last + 1), variants, kinds):
        yield kind, f"r{seed}", variant


def _row(
    kind: str,
    case: Case,
    target: str,
    variant: str,
    memo: Memory,
    siblings: Sequence[Structure] = (),
    source_as: str = "model",
) -> dict[str, Any]:
    source = scan(kind, SOURCE[kind], source_as)
    settings = settings_for("recommended", correspondence=case.correspondence)
    there = scan(kind, target, variant)
    plan, takes = decided(flown(kind, case.inspection), source, there, settings, memo, siblings)
    if takes and "/" in target and variant == "model":
        learn(kind, case, target, takes)
    named = any("part_" in warning for warning in plan.warnings)
    known = plan.measures.counterpart_probability
    return {
        "inspection": case.inspection,
        "asked": case.label,
        "present": present(kind, case, target, variant),
        "status": "warned" if plan.status == "ok" and named else plan.status,
        "reason": plan.reason or "; ".join(plan.warnings),
        "forecast": plan.measures.acceptance_probability,
        "sure": None if np.isnan(known) else known,
        "flown": [list(one.flown) for one in plan.counterparts],
        "told_by": plan.parts_told_by,
        **(truth(kind, case, target, variant, takes) if takes else {"right": 0.0, "reach": 0.0}),
    }


def is_wrong(row: dict[str, Any]) -> bool:
    """Whether what is decided is not on the right part, or leaves out much of it."""
    return bool(row["right"] < RIGHT or row["reach"] < RIGHT)


def is_silent(row: dict[str, Any]) -> bool:
    """Whether a decision is wrong and nothing says so."""
    return row["status"] == "ok" and is_wrong(row)


def judge(options: argparse.Namespace) -> None:
    """Count decisions by variant and by what is asked, and what was said by what was right."""
    rows = [
        json.loads(line)
        for file in options.file
        for line in Path(file).read_text(encoding="utf-8").splitlines()
    ]
    others = [row for row in rows if row.get("stranger")]
    untold = sum(bool(row.get("untold")) for row in rows)
    rows = [row for row in rows if not row.get("stranger") and not row.get("untold")]
    groups: dict[str, Callable[[dict[str, Any]], str]] = {
        "variant": lambda row: row["case"][3],
        "kind, inspection, asked": lambda row: f"{row['case'][0]} {row['inspection']} {row['asked']}",
        "all": lambda row: "all",
    }
    for title, of in groups.items():
        print(f"{title:72}{'n':>5}{'ok':>6}{'warned':>8}{'refused':>9}{'right %':>9}{'silently wrong':>16}"
              f"{'there, refused':>16}")  # fmt: skip
        for name in dict.fromkeys(map(of, rows)):
            some = [row for row in rows if of(row) == name]
            ok, warned, refused = (
                sum(row["status"] == status for row in some) for status in ("ok", "warned", "refused")
            )
            right = [row["right"] for row in some if row["status"] == "ok"]
            mean = 100 * np.mean(right) if right else np.nan
            there = [row["status"] == "refused" for row in some if row["present"] >= _WHOLE]
            counted = f"{len(some):5}{ok:6}{warned:8}{refused:9}{mean:9.1f}{sum(map(is_silent, some)):16}"
            print(f"{name:72}{counted}{sum(there):10} of {len(there)}")
    _print_decisions(rows)
    if options.curve:
        Path(options.curve).write_text(_curve(rows), encoding="utf-8")
    taken = [row for row in others if row["status"] != "refused"]
    print(f"not judged, since the mesh as modelled is not planned for without a doubt: {untold}")
    print(f"flights of other kinds: {len(taken)} of {len(others)} taken")
    for row in taken:
        print("TAKEN", *row["case"], row["asked"], f"forecast {row['forecast']:.2f}")
    for row in rows:
        if is_silent(row):
            text = f"right {row['right']:.2f} reach {row['reach']:.2f} sure {row['sure']}"
            print("SILENT", *row["case"], row["inspection"], row["asked"], text, row["flown"])


def _print_decisions(rows: Sequence[dict[str, Any]]) -> None:
    """How often what was said to be so certain was right."""
    known = [row for row in rows if row["sure"] is not None]
    for low, high in itertools.pairwise(_SURE):
        some = [row for row in known if low <= row["sure"] < high]
        if some:
            sure_pct = 100 * np.mean([row["sure"] for row in some])
            right = 100 * np.mean([row["right"] >= RIGHT for row in some])
            print(f"said {100 * low:3.0f} to {min(100 * high, 100):3.0f} %: {len(some):4} decisions, "
                  f"said {sure_pct:5.1f}, right {right:5.1f}")  # fmt: skip


def _curve(rows: Sequence[dict[str, Any]]) -> str:
    """What was said to be so certain against what was right of it, as a picture (SVG)."""
    known = [row for row in rows if row["sure"] is not None]
    dots = []
    for low, high in itertools.pairwise(_SURE):
        some = [row for row in known if low <= row["sure"] < high]
        if some:
            sure = float(np.mean([row["sure"] for row in some]))
            right = float(np.mean([row["right"] >= RIGHT for row in some]))
            x, y = 40 + 300 * sure, 320 - 300 * right
            dots.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{3 + len(some) ** 0.4:.1f}"/>'
                f'<text x="{x:.1f}" y="{y + 20 + 13 * (len(dots) % 3):.1f}">{len(some)}</text>'
            )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 360 360" font-size="11">'
        '<rect width="360" height="360" fill="white"/>'
        '<path d="M40 20V320H340M40 320L340 20" fill="none" stroke="#888"/>'
        f'<g fill="#1f5fa8">{"".join(dots)}</g>'
        '<text x="190" y="350" text-anchor="middle">said, 0 to 100 %</text>'
        '<text x="16" y="170" text-anchor="middle" transform="rotate(-90 16 170)">right</text></svg>\n'
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, run in (("write", decisions), ("real", real), ("judge", judge)):
        command = commands.add_parser(name)
        command.add_argument("file", nargs="+" if run is judge else 1)
        command.set_defaults(run=run)
        if run is judge:
            command.add_argument("--curve", default="", help="where to draw what was said by what was right")
        if run is decisions:
            command.add_argument("--seeds", default="31-33")
            command.add_argument("--siblings", default="", help="samples, random, real")
            command.add_argument("--source", default="model", help="how the source is given: shell, cut20")
        if run is not judge:
            command.add_argument("--kinds", default="")
            command.add_argument("--variants", default="")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
