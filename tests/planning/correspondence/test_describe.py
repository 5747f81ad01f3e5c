"""Parts and places in words, and the summary of a matching."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.planning.correspondence.naming import place_in, place_of, summary_of
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.surface.parts import Parts
from upplied.records import Floats


def parts_at(middles: list[tuple[float, float, float]], area: list[float], half: float = 0.5) -> Parts:
    at = np.array(middles, float)
    number = len(at)
    return Parts(at - half, at + half, np.array(area), np.zeros((number, number), bool), np.ones((number, 3)),
                 np.ones(number, bool), np.zeros((number, 2)), np.zeros(number, bool))  # fmt: skip


def test_a_place_is_named_beyond_a_twelfth_from_the_middle() -> None:
    whole = replace(
        parts_at([(0, 0, 0)] * 4, [1.0] * 4), low=np.full((4, 3), -5.0), high=np.full((4, 3), 5.0)
    )
    low, high = whole.low.copy(), whole.high.copy()
    for part, middle in enumerate([(0.81, 0.79, -0.79), (-0.9, 4, 3), (0, -0.81, -4)], 1):
        low[part], high[part] = np.array(middle) - 0.1, np.array(middle) + 0.1
    parts = replace(whole, low=low, high=high)
    assert [place_of(parts, part) for part in range(4)] == ["middle", "front", "rear left high", "right low"]


def test_a_section_is_the_third_with_most_weight() -> None:
    whole = np.array([[0.0, 0, 0], [9, 9, 9]])
    points = np.array([[1.0, 4, 4], [1, 4, 4], [8, 8, 1], [4, 4, 4], [9, 9, 9]])

    def at(weight: Floats) -> tuple[str, list[int]]:
        place, there = place_in(whole, points, weight)
        return place, np.flatnonzero(there).tolist()

    assert at(np.array([1.0, 1, 1.5, 1, 1])) == ("the rear section", [0, 1])
    assert at(np.array([1.0, 1, 3, 1, 1])) == ("the front left low section", [2])
    assert at(np.array([1.0, 1, 1, 3, 1])) == ("the middle section", [3])
    assert at(np.array([1.0, 1, 1, 1, 3])) == ("the front left high section", [4])
    flat = place_in(np.array([[0.0, 0, 2], [9, 9, 2]]), np.array([[1.0, 1, 2]]), np.ones(1))
    assert flat[0] == "the rear right low section"


def test_the_summary_tells_what_was_matched_and_what_is_left() -> None:
    source = parts_at([(0, 0, 0), (9, 0, 0), (0, 9, 0)], [0.7, 0.1, 0.2])
    target = parts_at([(0, 0, 0), (9, 0, 0), (0, 0, 9), (0, -9, 0)], [0.9, 0.009, 0.05, 0.011])
    matching = Matching(np.array([0, -1, -1]), np.array([0, -1, -1, -1]))
    label = np.repeat([0, 1, 2], [4, 4, 2])
    gone = np.array([1, 1, 0, 0, 1, 1, 1, 0, 1, 1], bool)
    assert summary_of(source, matching, label, gone, target) == (
        "1 of 3 parts matched one to one; no counterpart on the target: part_2 (rear left, 20.0 % of the "
        "surface), part_1 (front right, 10.0 % of the surface); only on the target: part_2 (rear left high), "
        "part_3 (rear right low)"
    )
    nothing = Matching(np.full(3, -1), np.full(4, -1))
    assert summary_of(source, nothing, label, np.zeros(10, bool), target) == "0 of 3 parts matched one to one"


def test_of_many_without_counterpart_six_are_named() -> None:
    source = parts_at([(float(at), 0, 0) for at in range(9)], [0.2] + [0.1] * 8)
    matching, label = Matching(np.full(9, -1), np.array([-1])), np.arange(9)
    summary = summary_of(source, matching, label, np.ones(9, bool), parts_at([(0, 0, 0)], [1.0]))
    assert summary.count("part_") == 6 and summary.endswith(" and 3 more")
    six = summary_of(source, matching, label, np.arange(9) < 6, parts_at([(0, 0, 0)], [1.0]))
    assert six.count("part_") == 6 and "more" not in six


def test_a_twelfth_itself_is_the_middle() -> None:
    whole = replace(
        parts_at([(0, 0, 0)] * 2, [1.0] * 2), low=np.full((2, 3), -50.0), high=np.full((2, 3), 50.0)
    )
    low, high = whole.low.copy(), whole.high.copy()
    low[1], high[1] = np.array([8.0, 8.5, -8.0]) - 1, np.array([8.0, 8.5, -8.0]) + 1
    assert place_of(replace(whole, low=low, high=high), 1) == "left"
