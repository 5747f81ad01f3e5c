"""The figures of the fifteen sample rows, kept with the version of the method that gave them.

    python bench/results.py

Writes ``tests/data/results.json``. A test plans the rows again: where they moved, the method's version
must be raised (`METHOD_VERSION` in `upplied/planning/correspondence/memo.py`) and the figures kept anew.
"""

from __future__ import annotations

import json
from pathlib import Path

from transfers import Transfer, transfers

from upplied.config import settings_for
from upplied.planning.plan import METHOD_VERSION, plan_transfer

FILE = Path(__file__).resolve().parents[1] / "tests" / "data" / "results.json"
PRESETS = ("recommended", "paper")
#: What is kept, and how far it may be off: by so much, or by so large a share of itself where that is more.
#: It is what a plan may vary by while it means the same, since processors round otherwise in the last digit.
TOLERANCE = {
    "coverage_paper_pct": (1.0, 0.0),
    "coverage_seen_pct": (1.0, 0.0),
    "coverage_inspected_pct": (1.0, 0.0),
    "frechet_z": (0.02, 0.05),
    "min_clearance_m": (0.1, 0.02),
    "path_length_m": (2.0, 0.02),
    "duration_s": (2.0, 0.02),
}


def figures(transfer: Transfer, preset: str) -> dict[str, float | str]:
    """The rounded figures of one row, and whether it was accepted."""
    plan = plan_transfer(transfer.demonstration, transfer.source, transfer.target, settings_for(preset))
    measured = {name: round(getattr(plan.measures, name), 2) for name in TOLERANCE}
    return {"status": plan.status} | {name: value for name, value in measured.items() if value == value}


def moved(stored: dict[str, float | str], now: dict[str, float | str]) -> list[str]:
    """Which figures differ by more than they may, in words."""
    lines = []
    for name in sorted(stored.keys() | now.keys()):
        before, after = stored.get(name), now.get(name)
        if isinstance(before, float | int) and isinstance(after, float | int):
            least, share = TOLERANCE[name]
            if abs(after - before) > max(least, share * abs(before)):
                lines.append(f"{name} {before} became {after}")
        elif before != after:
            lines.append(f"{name} {before} became {after}")
    return lines


def main() -> None:
    """Plan every row and keep its figures."""
    rows = {
        f"{each.published.title}, {preset}": figures(each, preset)
        for each in transfers()
        for preset in PRESETS
    }
    text = json.dumps({"method_version": METHOD_VERSION, "rows": rows}, indent=1, sort_keys=True)
    FILE.write_text(text + "\n", encoding="utf-8")
    print(f"{len(rows)} rows of method {METHOD_VERSION} kept in {FILE}")


if __name__ == "__main__":
    main()
