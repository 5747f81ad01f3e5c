"""What a page says first of a plan: resolution in millimetres, and what is relative to size says so."""

from __future__ import annotations

import pytest

from upplied.outputs.pairs import warnings_of
from upplied.outputs.verdicts import resolution, verdict

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
RESOLUTION = "14.8 mm/px (demonstrated 7.9 mm/px; as fine on 3.2 % of the surface)"


@pytest.mark.parametrize(("mode", "for_its_size"), [("scaled", True), ("kept", False), ("gsd 8 mm", False)])
def test_the_verdict_is_one_sentence_and_says_what_is_relative_to_size(mode: str, for_its_size: bool) -> None:
    headline = verdict(ROW | {"standoff_mode": mode}, 2.0)["headline"]
    size = ", relative to the structure's size" if for_its_size else ""
    shown = f"shows 99.6 % of the inspected surface at the demonstrated quality{size}, at {RESOLUTION}"
    assert headline == f"The plan {shown} and stays 3.0 m clear of the structure (limit 2 m)."


def test_figures_that_are_not_known_are_not_said() -> None:
    for unknown in (None, float("nan")):
        assert resolution(ROW | {"gsd_mm_p50": unknown}) == ""
        assert resolution(ROW | {"gsd_demonstrated_mm_p50": unknown}) == "14.8 mm/px"
        within = resolution(ROW | {"gsd_within_pct": unknown})
        assert within == RESOLUTION.replace("; as fine on 3.2 % of the surface", "")


def test_warnings_are_sentences_and_names_stay_as_they_are() -> None:
    texts = '["the scan is open", "part_0: not scanned.", "b747-v1 is large"]'
    assert warnings_of({"warnings": texts}) == [
        "The scan is open.",
        "part_0: not scanned.",
        "b747-v1 is large.",
    ]
