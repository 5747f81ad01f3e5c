"""Whether all of a kind were found: on a hull with pods, of which some are missing or named as nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from made_clouds import boxes

from upplied.planning.carry.forecast import odd_number
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.label_transfer import unnamed_like
from upplied.planning.demonstration.repetition import Take
from upplied.planning.surface.parts import parts_of
from upplied.records import Cloud, Correspondences, Ints, Registration

HULL, POD = ([0, -4, 0], [60, 8, 6]), [6.0, 2, 2]
LEFT, RIGHT, OUTER = ([20, 9, 0], POD), ([20, -11, 0], POD), ([40, 25, 0], POD)
SOURCE = boxes(HULL, LEFT, RIGHT, number=400)


def doubt(
    target: Cloud,
    part: int,
    classes: list[int],
    parts: set[int],
    carried: Ints | None = None,
    inferred: int = 1,
) -> str:
    """What is odd about the pods where these classes of the target's parts are given."""
    index = np.zeros(len(SOURCE), np.int64)
    match = Correspondences(
        index, np.zeros(len(SOURCE)), SOURCE.points, "", np.arange(3), np.array(classes, np.int64)
    )
    fit = Fit(
        source=SOURCE, target=target, correspondences=match, inferred=inferred, carried=carried,
        registration=Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True),
    )  # fmt: skip
    pair = SimpleNamespace(surface=fit, target=SimpleNamespace(structure_id="there"))
    here = parts_of(SOURCE)
    return odd_number(cast(Take, SimpleNamespace(pair=pair)), part, here, parts_of(target).on(here), parts)


def test_fewer_on_the_own_side_than_on_the_other_are_odd() -> None:
    third = boxes(HULL, LEFT, RIGHT, OUTER, number=400)
    sentence = doubt(third, 2, [0, 1, 2, -1], {1, 2, 3})
    assert sentence.startswith(
        "of parts like the inspected one 1 lie on its side of there and 2 on the other"
    )
    assert doubt(third, 1, [0, 1, 2, -1], {1, 2, 3}) == ""
    assert doubt(third, 2, [0, 1, 2, 1], {1, 2, 3}) == ""  # two pieces of the left one
    assert doubt(third, 2, [0, 1, 2, -1], {1, 2}) == ""  # the third is none of its kind
    assert doubt(third, 0, [0, 1, 2, -1], {0}) == ""  # the hull lies in the middle


@pytest.mark.parametrize(("inferred", "odd"), [(1, True), (0, True), (-1, False)])
def test_what_no_name_explains_and_is_of_its_size_may_be_another(inferred: int, odd: bool) -> None:
    """The outer pod was scanned as a piece of the hull, and the displacement brought nothing near it."""
    scan = boxes(HULL, LEFT, RIGHT, OUTER, number=400)
    assert scan.part is not None
    named = np.where(scan.part == 3, -1, scan.part)
    one = Cloud(scan.points, scan.normals, scan.area_m2, np.where(scan.part == 3, 0, scan.part))
    sentence = doubt(one, 1, [0, 1, 2], {1, 2}, named, inferred)
    assert sentence == (
        "something on there is of the size of the inspected part, and may be another one" if odd else ""
    )
    assert doubt(one, 1, [0, 1, 2], {1, 2}, one.part, inferred) == ""
    assert doubt(one, 1, [0, 1, 2], {1, 2}, None, inferred) == ""


def lone(size: list[float], hull: tuple[float, float, float] = (60, 8, 6)) -> bool:
    """Whether a box of a size, scanned as a piece of a hull so long, may be another pod."""
    scan = boxes(([0, -4, 0], hull), LEFT, ([20, 25, 0], size), number=1500)
    assert scan.part is not None
    named = np.where(scan.part == 2, -1, scan.part)
    one = Cloud(scan.points, scan.normals, scan.area_m2, np.where(scan.part == 2, 0, scan.part))
    return unnamed_like(one, named, scan.part == 1)


def test_it_is_of_the_size_along_each_axis_and_a_small_piece_of_its_part() -> None:
    assert lone(POD) and lone([9.0, 3, 2]) and lone([4.0, 2, 2])
    assert not lone([14.0, 2, 2]) and not lone([6.0, 2, 0.8]) and not lone([2.5, 2, 2])
    assert not lone(POD, (3, 3, 3))  # most of what was found there: it was asked as a part
