"""What corresponds on one side of structures that are their own mirror images does so on the other side."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import BoxOf, boxes, counterparts

from upplied.planning.correspondence import part_alignment
from upplied.planning.correspondence.part_alignment import matched
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.surface.parts import images
from upplied.records import Cloud

BODY: BoxOf = ([0, -2, 0], [60, 4, 4])
NEAR = [([20, 6, 0], [6, 3, 3]), ([20, -9, 0], [6, 3, 3])]  # engines, left and right
FAR = [([10, 15, 0], [6, 3, 3]), ([10, -18, 0], [6, 3, 3])]
WING, RIGHT = ([24, 2, 1], [10, 30, 1]), ([24, -32, 1], [10, 30, 1])
LARGE: BoxOf = ([0, -8, -4], [90, 16, 12])
INNER, TIP = ([24, -20, 1], [10, 18, 1]), ([24, -32, 1], [10, 12, 1])


def on_both_sides(source: Cloud, target: Cloud, here: list[int], there: list[int]) -> Matching:
    matching = Matching(np.array(here), np.array(there))
    return part_alignment._on_both_sides(matching, source, target)


def test_each_sample_has_its_image_on_a_structure_that_is_its_own() -> None:
    craft = boxes(BODY, *NEAR)
    across = images(craft)[:, 1]
    known = across >= 0
    assert known.mean() > 0.95 and (images(boxes(BODY, NEAR[0], *FAR[:1]))[:, 1] == -1).all()
    off = craft.points[across[known]] - craft.points[known] * [1, -1, 1]
    assert np.linalg.norm(off, axis=1).max() < 0.015 * np.linalg.norm([60, 18, 4]) + 1e-9
    assert np.array_equal(craft.part[across[known]] == 1, craft.part[known] == 2)  # type: ignore[index]


@pytest.mark.parametrize("swapped", [False, True])
def test_the_engine_across_from_one_that_is_matched_is_matched_with_the_one_across(swapped: bool) -> None:
    craft = boxes(BODY, *NEAR, *FAR)
    here, there = [0, 1, -1, -1, -1], [0, 1, -1, -1, -1]
    if swapped:  # the near one was matched with the far one
        there = [0, -1, -1, 1, -1]
    matching = on_both_sides(craft, craft, here, there)
    expected = [[0], [3], [4], [], []] if swapped else [[0], [1], [2], [], []]
    assert [counterparts(matching, part) for part in range(5)] == expected


def test_the_tip_of_a_wing_that_is_a_piece_of_its_own_on_one_side_belongs_to_the_wings() -> None:
    """Else that side's inner wing alone would be inspected, and all of it shown."""
    source, target = boxes(LARGE, ([24, -32, 1], [10, 64, 1])), boxes(LARGE, WING, INNER, TIP)
    matching = on_both_sides(source, target, [0, 1], [0, 1, 1, -1])
    assert matching.target_class.tolist() == [0, 1, 1, 1] and matching.source_class.tolist() == [0, 1]
    matching = on_both_sides(target, source, [0, 1, 1, -1], [0, 1])
    assert matching.source_class.tolist() == [0, 1, 1, 1]


def test_what_is_most_of_a_structure_lies_on_no_side() -> None:
    """Else all of a bridge would be one, and correspond to all of another for certain."""
    source, target = boxes(BODY, ([24, -32, 1], [10, 64, 1])), boxes(BODY, WING, INNER, TIP)
    assert on_both_sides(source, target, [-1, 0], [-1, 0, 0, -1]).target_class.tolist() == [-1, 0, 0, -1]


def test_what_lies_in_the_middle_is_of_no_side_and_joins_nothing() -> None:
    craft = boxes(BODY, *NEAR, ([54, -0.5, 4], [6, 1, 9]))
    matching = on_both_sides(craft, craft, [0, 1, 2, -1], [0, 1, 2, -1])
    assert matching.target_class.tolist() == [0, 1, 2, -1]


def test_a_structure_that_is_not_its_own_mirror_image_tells_nothing() -> None:
    craft = boxes(BODY, *NEAR)
    other = boxes(BODY, NEAR[0], ([20, -9, 0], [6, 3, 3]), ([0, -40, 0], [60, 8, 4]))
    assert on_both_sides(craft, other, [0, 1, -1], [0, 1, -1, -1]).target_class.tolist() == [0, 1, -1, -1]
    assert on_both_sides(other, craft, [0, 1, -1, -1], [0, 1, -1]).target_class.tolist() == [0, 1, -1]


def test_nothing_matched_tells_nothing() -> None:
    craft = boxes(BODY, *NEAR)
    assert len(on_both_sides(craft, craft, [-1, -1, -1], [-1, -1, -1])) == 0


def test_what_the_user_named_is_flown_on_that_side_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    craft, known = boxes(BODY, *NEAR), Matching(np.array([0, 1, -1]), np.array([0, 1, -1]))
    monkeypatch.setattr(part_alignment, "match_parts", lambda *_: known)
    assert matched(craft, craft, {1: 1}) is known
    assert counterparts(matched(craft, craft), 2) == [2]
