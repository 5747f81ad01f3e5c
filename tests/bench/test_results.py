"""Results do not move unless the version of the method is raised: the sample rows are kept as figures."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import pytest

from upplied.planning.plan import METHOD_VERSION

BENCH = Path(__file__).parents[2] / "bench"
FAST = ("cube sides > cuboid", "cruise hull > yacht 2", "bridge 1 piers > bridge 2")
RULE = "raise METHOD_VERSION in upplied/planning/correspondence/memo.py and run `python bench/results.py`"


@pytest.fixture(scope="module")
def results():
    sys.path.insert(0, str(BENCH))
    try:
        yield importlib.import_module("results")
    finally:
        sys.path.remove(str(BENCH))


def check(results, title: str, preset: str) -> None:
    from transfers import transfers

    stored = json.loads(results.FILE.read_text(encoding="utf-8"))
    (transfer,) = (each for each in transfers(only=title) if each.published.title == title)
    moved = results.moved(stored["rows"][f"{title}, {preset}"], results.figures(transfer, preset))
    assert not moved, f"{title}, {preset}: {'; '.join(moved)}. If that is meant: {RULE}"


def test_the_figures_are_those_of_this_version(results):
    stored = json.loads(results.FILE.read_text(encoding="utf-8"))
    assert stored["method_version"] == METHOD_VERSION, "the version was raised: run `python bench/results.py`"
    assert {f"{title}, recommended" for title in FAST} <= set(stored["rows"])


def test_published_figures_are_those_of_this_version():
    """They are drawn by what a user's quickstart calls: taken in from files, planned, measured."""
    published = (BENCH.parent / "docs" / "pictures" / "measured.md").read_text(encoding="utf-8")
    assert f"version {METHOD_VERSION} of the method" in published, "the version was raised: make pictures"


@pytest.mark.ci
@pytest.mark.parametrize("title", FAST)
def test_results_have_not_moved(results, title):
    check(results, title, "recommended")


@pytest.mark.slow
def test_no_result_that_is_kept_has_moved(results):
    for row in json.loads(results.FILE.read_text(encoding="utf-8"))["rows"]:
        check(results, *row.rsplit(", ", 1))


def test_moved_figures_are_told(results):
    figures = {"status": "ok", "duration_s": 100.0, "frechet_z": 0.5}
    assert results.moved(figures, dict(figures)) == []
    assert results.moved(figures, {**figures, "duration_s": 101.0, "frechet_z": 0.52}) == []
    assert results.moved(figures, {**figures, "duration_s": 103.0}) == ["duration_s 100.0 became 103.0"]
    assert results.moved(figures, {**figures, "frechet_z": 0.53}) == ["frechet_z 0.5 became 0.53"]
    assert results.moved(figures, {**figures, "status": "refused"}) == ["status ok became refused"]
    assert results.moved(figures, {"status": "ok", "duration_s": 100.0}) == ["frechet_z 0.5 became None"]
    large = {"frechet_z": 2.87, "duration_s": 1000.0, "coverage_inspected_pct": 98.0}
    near = {"frechet_z": 2.75, "duration_s": 1015.0, "coverage_inspected_pct": 97.1}
    assert results.moved(large, near) == []
    moved = results.moved(large, {"frechet_z": 2.67, "duration_s": 1025.0, "coverage_inspected_pct": 96.9})
    assert [each.split()[0] for each in moved] == ["coverage_inspected_pct", "duration_s", "frechet_z"]
