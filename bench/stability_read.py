"""The rows of bench/stability.py, read again, and what each says."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from stability import read

CLEARANCE_M = 0.01  # below what is promised, that is no rounding
_OVERSTATED_M = 0.02  # of the plan's own figure over that of the ruler
NAN = float("nan")


@dataclass(frozen=True)
class Row:
    """A line of the file."""

    values: dict[str, Any]

    def figure(self, name: str) -> float:
        """A measure of the plan, or of the one that was forced; NaN where there is none."""
        value = self.values.get("measures", {}).get(name, self.values.get(name))
        return NAN if value is None else float(value)

    @property
    def key(self) -> tuple[str, str]:
        """Pair and variant."""
        return self.values["pair"], self.values["variant"]

    @property
    def accepted(self) -> bool:
        """Whether the gates as they are let it pass."""
        return self.values["status"] == "ok"

    @property
    def planned(self) -> bool:
        """Whether there is a path, with the gates open where they refuse."""
        return "path" in self.values

    @property
    def shown(self) -> float:
        """Inspected coverage, percent, with the gates open where they refuse; 0 where there is no path."""
        return self.figure("coverage_inspected_pct") if self.planned else 0.0

    @property
    def attained(self) -> float:
        """Inspected coverage over what is attainable, percent."""
        able = 100 - self.figure("inspected_unattainable_pct")
        return 100 * self.figure("coverage_inspected_pct") / able if able > 0 else NAN

    @property
    def attained_there(self) -> float:
        """The same of what the target has: surface without a counterpart counts neither way, percent."""
        able = 100 - self.figure("inspected_unattainable_pct")
        able -= self.figure("inspected_without_counterpart_pct")
        return 100 * self.figure("coverage_inspected_pct") / able if able > 0 else NAN

    @property
    def axis_lost(self) -> float:
        """Points of time by which the camera points less at the inspected part than the demonstration's."""
        return 100 * (self.figure("axis_demonstration") - self.figure("axis_plan"))

    @property
    def short_m(self) -> float:
        """By how much the path comes nearer than promised, to the structure or the ground, m."""
        short = self.figure("promised_m") - self.figure("clearance_m")
        low = self.figure("promised_above_ground_m") - self.figure("above_ground_m")
        return float(np.nanmax([short, low, -1e9]))

    @property
    def overstated(self) -> bool:
        """Whether the plan says that it keeps farther off than the ruler finds."""
        return self.figure("min_clearance_m") > self.figure("clearance_m") + _OVERSTATED_M

    @cached_property
    def path(self) -> np.ndarray:
        """(N, 3) m."""
        from stability_rows import unpacked

        return unpacked(self.values["path"])


@dataclass(frozen=True)
class Rows:
    """Rows of a file by pair and variant, without those that never flew."""

    by_key: dict[tuple[str, str], Row]

    def chosen(self, test: Callable[[dict[str, Any]], bool]) -> Rows:
        """Those that pass a test of their values."""
        return Rows({key: row for key, row in self.by_key.items() if test(row.values)})

    @cached_property
    def good(self) -> list[Row]:
        """Like-kind rows that were planned or refused."""
        return [
            row
            for row in self.by_key.values()
            if row.values["status"] != "crash" and not row.values["stranger"]
        ]

    @cached_property
    def unvaried(self) -> list[Row]:
        """Those of the pairs as given."""
        return [row for row in self.good if row.values["variant"] == "given"]

    @cached_property
    def beside(self) -> list[tuple[Row, Row]]:
        """Each variant with its pair as given."""
        known = {row.values["pair"]: row for row in self.unvaried}
        return [
            (row, known[row.values["pair"]])
            for row in self.good
            if row.values["variant"] != "given" and row.values["pair"] in known
        ]

    @cached_property
    def families(self) -> list[list[Row]]:
        """The variants of each pair, those of at least two."""
        by_pair: dict[str, list[Row]] = {}
        for row in self.good:
            by_pair.setdefault(row.values["pair"], []).append(row)
        return [rows for rows in by_pair.values() if len(rows) > 1]


def compared(path: Path) -> Rows:
    """The rows of a file."""
    rows = [Row(values) for values in read(path) if values["status"] != "not flown"]
    return Rows({row.key: row for row in rows})


def apart(one: Row, other: Row) -> float:
    """Frechet distance of two paths over the median stand-off of the second, percent."""
    from upplied.planning.geometry.frechet import frechet

    reference = other.figure("standoff_m")
    if not reference > 0:
        reference = one.figure("standoff_m")
    return 100 * frechet(one.path, other.path, 1e-4) / reference if reference > 0 else NAN


def finite(values: Iterable[float]) -> np.ndarray:
    """Those that are numbers."""
    array = np.array(list(values), float)
    return array[~np.isnan(array)]
