"""What changed between two files of bench/stability.py, in the rows that are in both."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from stability_read import Row, Rows, apart, finite


def print_changes(before: Rows, after: Rows, worst: int) -> None:
    """What changed from one file to the other, in rows that are in both."""
    shared = _shared(before, after)
    print(f"\n{len(shared)} rows in both; changes are second less first")
    if not shared:
        return
    gained = sum(b.accepted and not a.accepted for a, b in shared)
    lost = sum(a.accepted and not b.accepted for a, b in shared)
    print(f"accepted: {gained} more, {lost} no longer")
    both = [(a, b) for a, b in shared if a.accepted and b.accepted]
    forced = [(a, b) for a, b in shared if a.planned and b.planned]
    measures: dict[str, Callable[[Row], float]] = {
        "inspected, points": lambda row: row.shown,
        "inspected / attainable, points": lambda row: row.attained,
        "unattainable, points": lambda row: row.figure("inspected_unattainable_pct"),
        "axis lost, points": lambda row: row.axis_lost,
        "camera turned, ratio": lambda row: row.figure("camera_turn_ratio"),
        "duration, s": lambda row: row.figure("duration_s"),
        "clearance, m": lambda row: row.figure("clearance_m"),
        "CPU-s": lambda row: row.figure("cpu_s"),
    }
    print(f"{'':34}{'mean':>9}{'median':>9}{'5th':>9}{'95th':>9}   (accepted in both, {len(both)} rows)")
    for name, measure in measures.items():
        _print_change(name, finite(measure(b) - measure(a) for a, b in both))
    _print_change("inspected, refused too, points", finite(b.shown - a.shown for a, b in forced))
    _print_change("path, % of the stand-off", finite(apart(b, a) for a, b in both))
    families: dict[str, list[float]] = {}
    for a, b in forced:
        families.setdefault(a.values["pair"], []).append(b.shown - a.shown)
    medians = {pair: float(np.nanmedian(some)) for pair, some in families.items() if not np.isnan(some).all()}
    _print_change("inspected, median of each pair", finite(medians.values()))
    order = sorted(medians, key=lambda pair: medians[pair])
    for title, some in (("lost most", order[:worst]), ("gained most", order[::-1][:worst])):
        print(f"{title}, median of a pair's variants, refused too:")
        for pair in some:
            print(f"  {medians[pair]:+8.1f}  {pair} ({len(families[pair])} rows)")
    rows = sorted(forced, key=lambda one: one[1].shown - one[0].shown)
    print("worst rows:")
    for a, b in rows[:worst]:
        print(
            f"  {b.shown - a.shown:+8.1f}  {a.values['pair']} [{a.values['variant']}] "
            f"{a.shown:.1f} > {b.shown:.1f}"
        )


def _shared(before: Rows, after: Rows) -> list[tuple[Row, Row]]:
    """Rows of both; another kernel's are beside those as given where the first file has no such rows."""
    rows_changed = []
    for (pair, variant), row in after.by_key.items():
        first = before.by_key.get((pair, variant))
        if first is None and variant == "kernel":
            first = before.by_key.get((pair, "given"))
        if first is not None and "crash" not in (row.values["status"], first.values["status"]):
            rows_changed.append((first, row))
    return rows_changed


def _print_change(name: str, values: np.ndarray) -> None:
    if not len(values):
        return
    cells = [values.mean(), *np.percentile(values, [50, 5, 95])]
    print(f"{name:34}" + "".join(f"{value:9.2f}" for value in cells))
