"""What the rows of bench/stability.py say, for both halves and each part, and the worst rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from stability_read import CLEARANCE_M, Row, Rows, apart, finite

PARTS = ("engine", "fuselage", "wings", "tower", "hull", "sides", "piers")
Figures = dict[str, str]


def figures(rows: Rows) -> Figures:
    """The figures of one column, as text."""
    good, unvaried, beside = rows.good, rows.unvaried, rows.beside
    accepted = [row for row in unvaried if row.accepted]
    every = [row for row in good if row.accepted]
    both = [(row, first) for row, first in beside if row.accepted and first.accepted]
    forced = [(row, first) for row, first in beside if row.planned and first.planned]
    able = [row for row in unvaried if row.shown >= 90]
    strangers = [row for row in rows.by_key.values() if row.values["stranger"]]
    crashes = sum(row.values["status"] == "crash" for row in rows.by_key.values())
    boxed = [row.figure("box_inspected_pct") - row.shown for row in accepted]
    planned = [row for row in good if row.planned]
    cold = [row.figure("cpu_s") for row in good if row.values["cold"]]
    warm = [row.figure("cpu_s") for row in good if not row.values["cold"]]
    drift = [abs(row.shown - first.shown) for row, first in both]
    drifted = [abs(row.shown - first.shown) for row, first in forced]
    spread = [max(shown) - min(shown) for shown in _shown(rows.families, lambda row: row.accepted)]
    spread_open = [max(shown) - min(shown) for shown in _shown(rows.families, lambda row: row.planned)]
    frechet = [apart(*one) for one in both]
    attained, attained_all = ([row.attained for row in some] for some in (accepted, every))
    lost = [row.axis_lost for row in accepted]
    ruled = [row.short_m for row in planned]
    return {
        "pairs / rows / crashed": f"{len(unvaried)}/{len(rows.by_key)}/{crashes}",
        "accepted as given": _of(len(accepted), len(unvaried)),
        "FLIPS of variants, % (<= 1)": _share(row.accepted != first.accepted for row, first in beside),
        "INSPECTED within 1 point of given, % (>= 95)": _share(d <= 1 for d in drift),
        "  largest difference, points (<= 3)": _most(drift),
        "  spread of a pair: median, largest": _pair(spread, np.median, np.max),
        "  refused too: within 1 point, %": _share(d <= 1 for d in drifted),
        "  refused too: spread, median, largest": _pair(spread_open, np.median, np.max),
        "FRECHET / stand-off, %: median (<= 5)": _at(frechet, 50),
        "  95th percentile": _at(frechet, 95),
        "  largest (<= 20)": _most(frechet),
        "refused with gates open, too": _of(sum(not row.planned for row in unvaried), len(unvaried)),
        "SHOWS 90 if let: accepted, % (>= 95)": _counted(row.accepted for row in able),
        "ACCEPTED, shows < 60, % (<= 1)": _share(row.shown < 60 for row in every),
        "INSPECTED / attainable, mean (98.5)": _mean(attained),
        "  5th percentile (95)": _at(attained, 5),
        "  all variants: mean": _mean(attained_all),
        "  all variants: 5th percentile": _at(attained_all, 5),
        "  where it has a counterpart: mean": _mean([row.attained_there for row in accepted]),
        "  5th percentile, with a counterpart": _at([row.attained_there for row in accepted], 5),
        "BELOW BOX by > 1 point (0)": _counted(value > 1 for value in boxed if not math.isnan(value)),
        "  mean gain on box, points": _mean([-value for value in boxed]),
        "AXIS: demonstrations, median %": _at(
            [100 * row.figure("axis_demonstration") for row in accepted], 50
        ),
        "  plans, median %": _at([100 * row.figure("axis_plan") for row in accepted], 50),
        "  lost: median, 95th, points": _pair(lost, np.median, lambda some: np.percentile(some, 95)),
        "  lost > 10 points (0)": _counted(value > 10 for value in lost if not math.isnan(value)),
        "STRANGERS accepted (0)": _of(sum(row.accepted for row in strangers), len(strangers)),
        "CLEARANCE short of promise (0)": _of(sum(s > CLEARANCE_M for s in ruled), len(ruled)),
        "  most, m": _most([value for value in ruled if value > CLEARANCE_M]),
        "  own figure above the ruler's": _of(sum(row.overstated for row in planned), len(planned)),
        "TURNING of camera, mean ratio": _mean([row.figure("camera_turn_ratio") for row in accepted]),
        "CPU-s cold: mean, median (<= 1.5)": _pair(cold, np.mean, np.median),
        "CPU-s, flight known: mean": _mean(warm),
    }


def _shown(families: Iterable[list[Row]], test: Callable[[Row], bool]) -> list[list[float]]:
    families_shown = [
        [row.shown for row in rows if test(row) and not math.isnan(row.shown)] for rows in families
    ]
    return [shown for shown in families_shown if len(shown) > 1]


def _of(number: int, total: int) -> str:
    return f"{number}/{total}" if total else "-"


def _share(values: Iterable[bool]) -> str:
    numbers = list(values)
    return f"{100 * np.mean(numbers):.1f}" if numbers else "-"


def _counted(values: Iterable[bool]) -> str:
    numbers = list(values)
    return _of(sum(numbers), len(numbers))


def _at(values: Sequence[float], percentile: float) -> str:
    numbers = finite(values)
    return f"{np.percentile(numbers, percentile):.1f}" if len(numbers) else "-"


def _most(values: Sequence[float]) -> str:
    numbers = finite(values)
    return f"{numbers.max():.1f}" if len(numbers) else "-"


def _mean(values: Sequence[float]) -> str:
    numbers = finite(values)
    return f"{numbers.mean():.2f}" if len(numbers) else "-"


def _pair(values: Sequence[float], *functions: Callable[[np.ndarray], Any]) -> str:
    numbers = finite(values)
    return " ".join(f"{function(numbers):.1f}" for function in functions) if len(numbers) else "-"


def print_table(rows: Rows, worst: int) -> None:
    """The figures by half and by part, then the worst rows."""
    columns = {
        "all": rows,
        "tune": rows.chosen(lambda row: row["half"] == "tune"),
        "report": rows.chosen(lambda row: row["half"] == "report"),
        "real": rows.chosen(lambda row: not row["generated"]),
    }
    kinds = {row.values["kind"] for row in rows.by_key.values()}
    for part in (*PARTS, *sorted(kinds - set(PARTS))):
        columns[part] = rows.chosen(lambda row, part=part: row["kind"] == part)  # type: ignore[misc]
    table = {name: figures(some) for name, some in columns.items() if some.by_key}
    width = max([12, *(len(name) + 2 for name in table)])
    print(f"{'':46}" + "".join(f"{name:>{width}}" for name in table))
    for figure in next(iter(table.values()), {}):
        print(f"{figure:46}" + "".join(f"{column[figure]:>{width}}" for column in table.values()))
    _print_worst(rows, worst)


def _print_worst(rows: Rows, worst: int) -> None:
    def named(title: str, entries: list[tuple[float, Row, str]]) -> None:
        entries = sorted((one for one in entries if not math.isnan(one[0])), key=lambda one: -one[0])[:worst]
        if entries:
            print(f"\n{title}")
        for value, row, more in entries:
            print(f"  {value:8.1f}  {row.values['pair']} [{row.values['variant']}] {more}")

    beside, accepted = rows.beside, [row for row in rows.good if row.accepted]
    both = [(row, first) for row, first in beside if row.accepted and first.accepted]
    named(
        "flips, points shown apart",
        [
            (abs(row.shown - first.shown), row, (row if first.accepted else first).values["reason"][:110])
            for row, first in beside
            if row.accepted != first.accepted
        ],
    )
    named(
        "inspected, points from as given",
        [(abs(r.shown - f.shown), r, f"{f.shown:.1f} > {r.shown:.1f}") for r, f in both],
    )
    named("path, % of the stand-off from as given", [(apart(row, first), row, "") for row, first in both])
    refused = [row for row in rows.unvaried if not row.accepted and row.shown >= 90]
    named("refused, and would show, %", [(row.shown, row, row.values["reason"][:110]) for row in refused])
    named("least attained, points short", [(100 - row.attained, row, "") for row in accepted])
    named(
        "below box scaling, points",
        [(row.figure("box_inspected_pct") - row.shown, row, "") for row in rows.unvaried if row.accepted],
    )
    named("axis lost, points", [(row.axis_lost, row, "") for row in rows.unvaried if row.accepted])
    named(
        "short of the promised clearance, m",
        [(r.short_m, r, "") for r in rows.good if r.planned and r.short_m > CLEARANCE_M],
    )
    crashes = [row for row in rows.by_key.values() if row.values["status"] == "crash"]
    named("crashes", [(0.0, row, row.values["reason"][:140]) for row in crashes])
    strangers = [row for row in rows.by_key.values() if row.values["stranger"] and row.accepted]
    named("strangers accepted, inspected %", [(row.shown, row, "") for row in strangers])
