"""What a page says first of a plan: resolution in millimetres, and what is relative to size says so."""

from __future__ import annotations

import pytest

from upplied.outputs.verdicts import fineness, verdict

ROW = {
    "status": "ok",
    "flyable": True,
    "coverage_inspected_pct": 99.6,
    "min_clearance_m": 3.0,
    "gsd_mm_p50": 14.8,
    "gsd_mm_p95": 16.5,
    "gsd_demonstrated_mm_p50": 7.9,
    "gsd_demonstrated_mm_p95": 9.1,
    "gsd_within_pct": 3.2,
}
SENTENCE = (
    "Resolution 14.8 mm/px (95 %: 16.5), demonstrated 7.9 mm/px (95 %: 9.1); 3.2 % of the surface as fine."
)


@pytest.mark.parametrize(("mode", "for_its_size"), [("scaled", True), ("kept", False), ("gsd 8 mm", False)])
def test_what_is_relative_to_size_says_so_beside_the_millimetres(mode: str, for_its_size: bool) -> None:
    headline = verdict(ROW | {"standoff_mode": mode}, 2.0)["headline"]
    assert headline.endswith(SENTENCE)
    assert "as well as the demonstration" in headline
    assert ("as well as the demonstration, relative to the structure's size" in headline) == for_its_size


@pytest.mark.parametrize("missing", ["gsd_mm_p50", "gsd_mm_p95", "gsd_demonstrated_mm_p50"])
def test_figures_that_are_not_known_are_not_said(missing: str) -> None:
    assert fineness(ROW | {missing: None}) == fineness(ROW | {missing: float("nan")}) == ""
    assert fineness(ROW | {"gsd_within_pct": None}) == SENTENCE.replace("; 3.2 % of the surface as fine", "")
