"""How much a plan depends on chance: pairs of like kind, planned again from inputs that mean the same.

    python bench/stability.py run OUT.jsonl [--budget SECONDS] [--pairs WORD ...] [--variants A,B]
    python bench/stability.py run OUT.jsonl --strangers
    python bench/stability.py run OUT.jsonl --families [--strangers]
    python bench/stability.py table OUT.jsonl [OTHER.jsonl]

`run` appends a line of JSON for each pair and variant, and leaves out those that are there, so it goes on
where it was stopped. Pairs come in a shuffled order of which any beginning is a fair sample: parts take
turns. Variants are in bench/stability_variants.py, pairs in bench/stability_pairs.py. Where the gates refuse,
the pair is planned again with the gates open. With ``--kernel plain`` everything is computed with the
plainest instructions, and the pair as given is variant ``kernel``. `table` prints what the planner is judged
by, for both halves and each part, and with OTHER what changed in the rows that are in both.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

_MARK = "UPPLIED_BENCH_KERNEL"


def main() -> None:
    """Plan, or print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    what = parser.add_subparsers(dest="what", required=True)
    run = what.add_parser("run", help="plan and append rows")
    run.add_argument("out", type=Path)
    run.add_argument("--budget", type=float, default=float("inf"), help="seconds, after which no pair begins")
    run.add_argument("--pairs", nargs="+", default=[], metavar="WORD", help="pairs whose name holds one")
    run.add_argument("--variants", default="", help="by commas; all where not given")
    run.add_argument("--half", choices=("tune", "report"))
    run.add_argument("--sample", nargs=2, type=int, metavar=("N", "SEED"), help="the first N of an order")
    run.add_argument("--shuffle", type=int, default=0, metavar="SEED", help="of the order of the pairs")
    run.add_argument("--strangers", action="store_true", help="pairs of other kinds, as given")
    run.add_argument("--families", action="store_true", help="pairs of the families of bench/families.py")
    run.add_argument("--real", action="store_true", help="no generated structures")
    run.add_argument("--unflown", action="store_true", help="flights round other real structures alone")
    run.add_argument("--processes", type=int, default=1)
    run.add_argument("--kernel", choices=("plain",), help=argparse.SUPPRESS)
    table = what.add_parser("table", help="print what was found")
    table.add_argument("out", type=Path)
    table.add_argument("other", type=Path, nargs="?")
    table.add_argument("--worst", type=int, default=6, help="rows named of each sort")
    options = parser.parse_args()
    if options.what == "table":
        from stability_changes import print_changes
        from stability_read import compared
        from stability_table import print_table

        print_table(compared(options.out), options.worst)
        if options.other:
            print_changes(compared(options.out), compared(options.other), options.worst)
        return
    if options.kernel:
        _plainly()
    _run(options)


def _plainly() -> None:
    """Begin again with the plainest instructions that the libraries can be told to use."""
    if os.environ.get(_MARK):
        return
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    features = [name for name in __cpu_dispatch__ if __cpu_features__.get(name)]
    plain = {
        _MARK: "plain",
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": " ".join(features),
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    }
    os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **plain})


def _run(options: argparse.Namespace) -> None:
    from stability_pairs import meshes, pairs
    from stability_variants import MORE, VARIANTS

    began = time.monotonic()
    default = ("kernel",) if options.kernel else ("given",) if options.strangers else VARIANTS
    variants = options.variants.split(",") if options.variants else list(default)
    if unknown := set(variants) - set(VARIANTS + MORE):
        raise SystemExit(f"unknown variants: {', '.join(unknown)}; known: {', '.join(VARIANTS + MORE)}")
    if "kernel" in variants and not options.kernel:
        raise SystemExit("variant kernel needs --kernel plain")
    count, seed = options.sample or (None, options.shuffle)
    chosen = [
        pair
        for pair in pairs(options.strangers, seed, options.families, options.unflown)
        if options.half in (None, pair.half)
        and not (options.real and "-random-" in pair.name)
        and (not options.pairs or any(word in pair.name for word in options.pairs))
    ][:count]
    keys = {(row["pair"], row["variant"]) for row in read(options.out)}
    jobs = [(pair, [one for one in variants if (pair.name, one) not in keys]) for pair in chosen]
    jobs = [(pair, some) for pair, some in jobs if some]
    if not options.families and not meshes():
        print("no real structures found (UPPLIED_REAL_DATA): generated ones alone", flush=True)
    print(f"{len(chosen)} pairs, {sum(len(some) for _, some in jobs)} rows to plan", flush=True)
    with options.out.open("a", encoding="utf-8") as file:
        for number, rows in enumerate(_planned(jobs, options.processes, began + options.budget), 1):
            rows_done = []
            for row in rows:
                print(json.dumps(row), file=file, flush=True)
                rows_done.append(f"{row['variant']} {_words(row)}")
            name = row["pair"]
            print(f"{time.monotonic() - began:6.0f} s {number:5d} {name}: {' '.join(rows_done)}", flush=True)


def _words(row: dict[str, Any]) -> str:
    shown = row.get("measures", {}).get("coverage_inspected_pct")
    figure = "-" if shown is None else f"{shown:.1f}"
    return figure if row["status"] == "ok" else f"({row['status']} {figure})"


def _planned(jobs: list[Any], processes: int, until: float) -> Iterator[Iterable[dict[str, Any]]]:
    from stability_rows import all_rows_of, rows_of, warm_up

    if processes == 1:
        warm_up()
        for pair, variants in jobs:
            if time.monotonic() > until:
                return
            yield rows_of(pair, variants)
        return
    with ProcessPoolExecutor(processes, initializer=warm_up) as pool:
        waiting: list[Any] = []
        rest = iter(jobs)
        while True:
            while len(waiting) < processes and time.monotonic() < until and (one := next(rest, None)):
                waiting.append(pool.submit(all_rows_of, *one))
            if not waiting:
                return
            yield waiting.pop(0).result()


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a file; a line that was cut off is left out."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


if __name__ == "__main__":
    main()
