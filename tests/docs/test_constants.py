"""The planner's numbers: each has a row, those that were chosen a reason, and they stay few."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "making"))
import constants

# May fall and not rise: fewer than eighty is the goal, so that somebody can hold them in the head.
MOST_TUNED = 68


def test_every_number_has_a_row_and_every_row_a_number():
    known = {each.row for each in (*constants.settings(), *constants.constants())}
    rows = constants.table()
    assert known == set(rows), "add the row to docs/making/constants.csv, or remove it"
    assert {row["sort"] for row in rows.values()} <= set(constants.SORTS)


def test_every_number_within_a_function_is_known():
    rows = constants.table(constants.LITERALS)
    assert constants.literals() == {name: row["values"] for name, row in rows.items()}, (
        "a number that decides something belongs at the head of its module, others in literals.csv"
    )
    assert {row["sort"] for row in rows.values()} <= set(constants.SORTS)
    assert all(row["reason"] for row in rows.values())


def test_few_numbers_are_tuned_and_each_says_why():
    assert constants.counts()["tuned"] <= MOST_TUNED
    rows = constants.table()
    for each in (*constants.settings(), *constants.constants()):
        if rows[each.row]["sort"] in ("tuned", "fitted"):
            assert each.reason or rows[each.row]["reason"], f"{each.label} says no reason"


def test_a_number_without_a_row_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    module = tmp_path / "carry" / "made_up.py"
    module.parent.mkdir()
    module.write_text("def far(x):\n    return x > 0.37 * 2 and x[7] < 5\n")
    monkeypatch.setattr(constants, "PLANNING", tmp_path)
    assert constants.literals() == {"carry.made_up.far": "0.37 5"}


@pytest.mark.ci
def test_the_page_tells_of_every_number():
    page = constants.constants_page()
    for each in (*constants.settings(), *constants.constants()):
        assert f"`{each.row}`" in page
    for name in constants.literals():
        assert f"in `{name}`" in page
