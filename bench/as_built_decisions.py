"""What is decided for scans before a plan is made: silently wrong decisions are counted.

    python bench/as_built_decisions.py write FILE [--kinds airliner,ship] [--seeds 31-36] [--variants shell]
    python bench/as_built_decisions.py judge FILE

`write` takes each case as far as it is decided whether and where to fly, which costs a tenth of a plan,
and writes a line of JSON: what share of the inspected surface corresponds to the right part of the generator,
how much of each right part that reaches, and what was said. `judge` counts them. A decision is silently wrong
where neither a refusal nor a warning names the part and less than 80 % of what corresponds, or less than 80 %
of what the demonstration shows of its part, is on a right one.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from as_built import side, sort
from scans import VARIANTS, made, scan, true_parts
from scipy.spatial import cKDTree

from upplied.config import settings_for
from upplied.errors import UppliedError
from upplied.planning.carry.counterparts import counterparts_of, doubts, least_probability, undecided
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import Take, takes_of
from upplied.planning.geometry.boxes import spacing
from upplied.planning.surface.samples import surface_samples
from upplied.records import Bools, Demonstration, Floats
from upplied.samples.pilot import fly
from upplied.scene import scene_of

Asked = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One inspection, what is asked, and the parts of the target that are right."""

    inspection: str
    asked: Asked
    right: Callable[[str], bool]  # of the name of a part of the generator
    every: bool = False  # whether each of the right parts must be reached, not one of them


def _is(name: str) -> Callable[[str], bool]:
    return lambda other: other == name


def _of(name: str) -> Callable[[str], bool]:
    return lambda other: sort(other) == name


def _left_engine(other: str) -> bool:
    return sort(other) == "engine" and side(other) == "left"


#: By kind: sources, and what is asked of each of them.
SOURCES = {
    "airliner": "a320-v1",
    "wind_turbine": "turbine-1-v1",
    "bridge": "bridge-1-v1",
    "ship": "cruise-v1",
}
CASES = {
    "airliner": (
        Case("engine_left", {}, _left_engine),
        Case("engine_left", {"repeat": "each"}, _of("engine"), every=True),
        Case("engine_left", {"counterparts": (("engine_left", "outer"),)}, _left_engine),
        Case("wings", {}, _of("wing"), every=True),
        Case("fuselage", {}, _is("fuselage")),
    ),
    "wind_turbine": (Case("tower", {}, _is("tower")),),
    "bridge": (
        Case("piers", {}, _of("pier")),
        Case("piers", {"repeat": "each"}, _of("pier"), every=True),
    ),
    "ship": (Case("hull", {}, _is("hull")),),
}
RIGHT = 0.8  # of what corresponds, or of what the demonstration shows, that must be on a right part
_LOOKED_AT = 0.4  # attention from which a sample was inspected
_MAIN = 0.1  # share of what was inspected from which a part is meant
_REACH = 2.5  # spacings: a sample of the target this near a counterpart is reached
_THERE = 0.01  # of the diagonal: a clean sample this near the scan's surface was scanned
CLEARANCE_M = 2.0  # that `recommended` keeps


class _Kept:
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
    path = Path(options.file)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    done = {tuple(json.loads(line)["case"]) for line in lines}
    memo = _Kept()
    with path.open("a", encoding="utf-8") as file:
        for kind, target, variant in _targets(options):
            for number, case in enumerate(CASES[kind]):
                name = (kind, SOURCES[kind], target, variant, number)
                if name not in done:
                    row = _decided(kind, case, target, variant, memo)
                    file.write(json.dumps({"case": name, **row}) + "\n")
                    file.flush()
            memo.prune()


def _targets(options: argparse.Namespace) -> Iterator[tuple[str, str, str]]:
    first, last = (int(each) for each in options.seeds.split("-"))
    kinds = options.kinds.split(",") if options.kinds else list(CASES)
    variants = options.variants.split(",") if options.variants else VARIANTS
    for seed, variant, kind in itertools.product(range(first, last + 1), variants, kinds):
        yield kind, f"r{seed}", variant


def _decided(kind: str, case: Case, target: str, variant: str, memo: _Kept) -> dict[str, Any]:
    source = made(kind, SOURCES[kind]).structure
    settings = settings_for("recommended", correspondence=case.asked)
    asked = {"inspection": case.inspection, "asked": str(case.asked or "once")}
    there = scan(kind, target, variant)
    try:
        pair = study_pair(source, there, settings, memo)
        takes = takes_of(_flown(kind, case.inspection), pair, settings, memo)
    except UppliedError as refusal:
        return {**asked, "status": "refused", "reason": str(refusal)}
    found = counterparts_of(takes, settings)
    reason = undecided(found, settings)
    if not pair.surface.registration.accepted:
        reason = reason or f"gate: {pair.surface.registration.reason}"
    status = "refused" if reason else "warned" if doubts(found) else "ok"
    known = least_probability(found)
    return {
        **asked,
        "status": status,
        "reason": reason or "; ".join(doubts(found)),
        "told": pair.surface.told,
        "sure": None if np.isnan(known) else known,
        "flown": [list(one.flown) for one in found],
        **_truth(kind, case, target, takes),
    }


_FLOWN: dict[tuple[str, str], Demonstration] = {}


def _flown(kind: str, inspection: str) -> Demonstration:
    if (kind, inspection) not in _FLOWN:
        _FLOWN[kind, inspection] = fly(made(kind, SOURCES[kind]).structure, inspection, seed=2)
    return _FLOWN[kind, inspection]


def _truth(kind: str, case: Case, target: str, takes: Sequence[Take]) -> dict[str, Any]:
    """Share of what corresponds that is on a right part, how much of each that reaches, how much is there."""
    on_right, counted, reached = 0.0, 0.0, np.empty((0, 3))
    shown = 1.0
    for take in takes:
        cloud, fit = take.pair.surface.source, take.pair.surface
        area = np.ones(len(cloud)) if cloud.area_m2 is None else cloud.area_m2
        name = true_parts(kind, SOURCES[kind], cloud.points)
        looked = take.inspection.attention.weight > _LOOKED_AT
        main = _meant(case, name, looked, area)
        shown = min(shown, float(area[main].sum() / area[np.isin(name, np.unique(name[main]))].sum()))
        points = fit.correspondences.target_points[main]
        known = np.isfinite(points[:, 0])
        there = true_parts(kind, target, points[known])
        good = np.array([case.right(str(each)) for each in there], bool)
        on_right += float(area[main][known][good].sum())
        counted += float(area[main][known].sum())
        reached = np.vstack([reached, points[known]])
    reach = _reach(kind, case, target, takes[0], reached, shown)
    return {"right": on_right / max(counted, 1e-9), "counted": counted > 0, **reach}


def _meant(case: Case, name: np.ndarray, looked: Bools, area: Floats) -> Bools:
    """Which samples of the source are inspected and on a part of the sort that is meant."""
    of_sort = np.array([case.right(str(each)) or sort(str(each)) in _SORTS[case.inspection] for each in name])
    return np.asarray(looked & of_sort & (area > 0), bool)


_SORTS = {"engine_left": ("engine",), "wings": ("wing",), "fuselage": ("fuselage",), "tower": ("tower",),
          "piers": ("pier",), "hull": ("hull",)}  # fmt: skip


def _reach(kind: str, case: Case, target: str, take: Take, reached: Floats, shown: float) -> dict[str, Any]:
    """Least share of a right part, of what the demonstration shows of its own, that has a counterpart."""
    clean = surface_samples(made(kind, target).structure, scene_of(made(kind, target).structure),
                            settings_for("recommended").clouds)  # fmt: skip
    name = true_parts(kind, target, clean.points)
    scanned = take.pair.surface.target
    there = cKDTree(scanned.points).query(clean.points)[0] < max(
        2 * spacing(scanned), _THERE * made(kind, target).structure.diagonal_m
    )
    near = np.zeros(len(clean), bool)
    if len(reached):
        near = cKDTree(reached).query(clean.points)[0] < _REACH * spacing(clean)
    area = np.ones(len(clean)) if clean.area_m2 is None else clean.area_m2
    shares, present = [], []
    for each in np.unique(name):
        if case.right(str(each)):
            mine = name == each
            present.append(float(area[mine & there].sum() / area[mine].sum()))
            shares.append(float(area[mine & near].sum() / max(area[mine & there].sum(), 1e-9)))
    some = (min if case.every else max)(shares, default=0.0)
    return {"reach": some / max(shown, 1e-9), "present": (min if case.every else max)(present, default=0.0)}


def is_silent(row: dict[str, Any]) -> bool:
    """Whether a decision is wrong and nothing says so."""
    return row["status"] == "ok" and (row["right"] < RIGHT or row["reach"] < RIGHT)


def judge(options: argparse.Namespace) -> None:
    """Count decisions by variant and by what is asked."""
    rows = [json.loads(line) for line in Path(options.file).read_text(encoding="utf-8").splitlines()]
    groups: dict[str, Callable[[dict[str, Any]], str]] = {
        "variant": lambda row: row["case"][3],
        "kind, inspection, asked": lambda row: f"{row['case'][0]} {row['inspection']} {row['asked']}",
        "all": lambda row: "all",
    }
    for title, of in groups.items():
        print(f"{title:72}{'n':>5}{'ok':>6}{'warned':>8}{'refused':>9}{'right %':>9}{'silently wrong':>16}")
        for name in dict.fromkeys(map(of, rows)):
            some = [row for row in rows if of(row) == name]
            ok, warned, refused = (
                sum(row["status"] == status for row in some) for status in ("ok", "warned", "refused")
            )
            right = [row["right"] for row in some if row["status"] == "ok"]
            mean = 100 * np.mean(right) if right else np.nan
            silent = sum(map(is_silent, some))
            print(f"{name:72}{len(some):5}{ok:6}{warned:8}{refused:9}{mean:9.1f}{silent:16}")
    for row in rows:
        if is_silent(row):
            said = f"right {row['right']:.2f} reach {row['reach']:.2f} sure {row['sure']}"
            print("SILENT", *row["case"], row["inspection"], row["asked"], said, row["flown"])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, run in (("write", decisions), ("judge", judge)):
        command = commands.add_parser(name)
        command.add_argument("file")
        command.set_defaults(run=run)
        if run is decisions:
            command.add_argument("--kinds", default="")
            command.add_argument("--seeds", default="31-33")
            command.add_argument("--variants", default="")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
