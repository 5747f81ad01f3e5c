"""Does the shape find the right flight, is what it foresees true, and how long does it take?

Every real structure is flown round once by the simulated pilot and asked for, without its own flight.
"Right" is what a person says who looked at the structures (bench/acceptance.py); the declared kind, which
is coarser, is counted besides. Both are asked twice: with the declared kinds, and by shape alone.

python bench/recommend.py --catalog FOLDER      a catalog that is kept, so that a second run is quick
python bench/recommend.py --plan 20             also plan 20 pairs, and compare what was foreseen
"""

from __future__ import annotations

import argparse
import tempfile
import time

import numpy as np
from acceptance import _real, truth_of
from scipy.stats import spearmanr

from upplied.catalog import Catalog, open_catalog
from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.planning.plan import plan_transfer
from upplied.recommend.ranking import Recommendation, recommend
from upplied.recommend.shapes import ShapeFeatures, ShapeLibrary, unlikeness
from upplied.records import Structure
from upplied.samples.pilot import fly

_INSPECTIONS = {
    "airplane": ("fuselage", "wings", "engine_left"),
    "wind_turbine": ("tower",),
    "ship": ("hull",),
    "yacht": ("hull",),
    "bridge": ("piers",),
}
_MANY = 10_000

Answers = dict[str, list[Recommendation]]


def main() -> None:
    """Print who ranks first, the rank correlation and the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--catalog", default="", help="folder of the catalog; default: a temporary one")
    parser.add_argument("--plan", type=int, default=0, help="how many of the pairs are planned")
    options = parser.parse_args()
    structures = {one.structure_id: one for one in _real()}
    if not structures:
        raise SystemExit("no real structures found (UPPLIED_REAL_DATA)")
    with tempfile.TemporaryDirectory() as folder:
        catalog = open_catalog(options.catalog or folder)
        _fill(catalog, list(structures.values()))
        answers = _answers(catalog, structures, "first")
        _answers(catalog, structures, "again")
        _print_ranks(structures, answers, "declared kinds counted")
        _print_ranks(structures, _answers(catalog, structures, "by shape", False), "by shape alone")
        _print_many()
        if options.plan:
            _print_foreseen(catalog, structures, answers, options.plan)


def _fill(catalog: Catalog, structures: list[Structure]) -> None:
    catalog.add_structures(structures)
    flights = []
    for structure in structures:
        flown = 0
        for inspection in (*_INSPECTIONS.get(structure.kind, ()), "sides"):
            if inspection == "sides" and flown:
                break
            try:
                flights.append(fly(structure, inspection))
                flown += 1
            except RefusedError:
                continue
    catalog.add_demonstrations(flights)
    print(f"{len(structures)} structures, {len(flights)} flights")


def _answers(catalog: Catalog, structures: dict[str, Structure], when: str, by_kind: bool = True) -> Answers:
    seconds, answers = [], {}
    for name in structures:
        began = time.process_time()
        ranking = recommend(catalog, name, 100, by_kind)
        seconds.append(time.process_time() - began)
        answers[name] = [one for one in ranking if one.verdict != "own"]
    print(f"asked {when}: {np.median(seconds):.2f} CPU s (median), {max(seconds):.2f} at most")
    return answers


def _print_ranks(structures: dict[str, Structure], answers: Answers, how: str) -> None:
    print(f"\n{how}")
    titles = ("same form", "any form of the kind", "verdict is fits", "the declared kind")
    counted = {title: [0, 0] for title in titles}
    for name, ranking in answers.items():
        truths = {
            other: truth_of(structures[name], one) for other, one in structures.items() if other != name
        }
        first, kind = ranking[0], structures[name].kind
        right = truths[first.source_id] != "cross"
        declared = any(one.kind == kind for other, one in structures.items() if other != name)
        for title, counts, answers in (
            ("same form", right, "same" in truths.values()),
            ("any form of the kind", right, set(truths.values()) != {"cross"}),
            ("verdict is fits", right, first.verdict == "fits"),
            ("the declared kind", first.kind == kind, declared),
        ):
            if answers:
                counted[title][0] += counts
                counted[title][1] += 1
        if not right:
            print(f"  {name}: {ranking[0].source_id} is first ({ranking[0].verdict}), of another kind")
    for title, (right_ones, number) in counted.items():
        share = 100 * right_ones / max(number, 1)
        print(f"right kind first, {title:22}{right_ones:4d} of {number:3d} = {share:.1f} %")


def _print_many() -> None:
    """The comparison of one shape with many, on features drawn at random."""
    rng = np.random.default_rng(0)
    words = rng.integers(np.iinfo(np.int64).min, np.iinfo(np.int64).max, (_MANY, 27))
    facing = rng.dirichlet(np.ones(5), (_MANY, 3)).reshape(_MANY, 15)
    library = ShapeLibrary(rng.uniform(1, 100, (_MANY, 3)), words, words | np.roll(words, 1), facing)
    shape = ShapeFeatures(library.extent_m[0], library.occupied[0], library.near[0], library.facing[0])
    began = time.process_time()
    unlikeness(shape, library)
    print(f"{_MANY} shapes compared in {1e3 * (time.process_time() - began):.0f} CPU ms")


def _print_foreseen(
    catalog: Catalog, structures: dict[str, Structure], answers: Answers, number: int
) -> None:
    """Plan some pairs, spread evenly over what was foreseen, and compare."""
    pairs = [
        (name, one)
        for name, ranking in answers.items()
        for one in ranking
        if one.verdict in ("fits", "doubtful") and np.isfinite(one.predicted_seen_pct)
    ]
    pairs.sort(key=lambda pair: (pair[1].predicted_seen_pct, pair[0], pair[1].demonstration_id))
    chosen = [pairs[index] for index in np.unique(np.linspace(0, len(pairs) - 1, number).astype(int))]
    rows, settings = [], settings_for("recommended")
    for name, one in chosen:
        flight = catalog.demonstration(one.demonstration_id)
        plan = plan_transfer(flight, structures[one.source_id], structures[name], settings, catalog.cache)
        rows.append((one.predicted_seen_pct, plan.measures.coverage_seen_pct))
        print(
            f"  {one.demonstration_id} > {name}: foreseen {rows[-1][0]:.0f}, achieved {rows[-1][1]:.1f} %",
            flush=True,
        )
    foreseen, achieved = np.array(rows).T
    ok = np.isfinite(achieved)
    rank = spearmanr(foreseen[ok], achieved[ok])
    print(f"rank correlation {rank.statistic:.2f} (p {rank.pvalue:.2g}) over {ok.sum()} planned of {len(ok)}")


if __name__ == "__main__":
    main()
