"""Matchings of parts against the best of all assignments, tried one by one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from made_clouds import counterparts

from upplied.planning.correspondence.part_assignment import Matching, like_shape, match_parts, with_named
from upplied.planning.surface.parts import Parts, blades, sides
from upplied.records import Floats

DIAGONAL = 100.0


def parts(
    low: Floats, size: Floats, touching: Sequence[tuple[int, int]] = (), area: Floats | None = None
) -> Parts:
    """Boxes; areas follow from their faces."""
    high, number = low + size, len(low)
    faces = 2 * (size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0])
    near = np.zeros((number, number), bool)
    for one, other in touching:
        near[one, other] = near[other, one] = True
    side = sides(low, high, low.min(axis=0), high.max(axis=0)) * np.nan
    extent = np.sort(size, axis=1)[:, ::-1]
    share = faces / faces.sum() if area is None else area
    blade = blades(extent, share, low + size / 2)
    return Parts(low, high, share, near, extent, np.ones(number, bool), side, blade)


def apart(one: Parts, a: int, other: Parts, b: int) -> float:
    middles = (one.low[a] + one.high[a]) / 2, (other.low[b] + other.high[b]) / 2
    return float(np.linalg.norm(middles[0] - middles[1])) / DIAGONAL


def cost(source: Parts, target: Parts, partner: Sequence[int]) -> float:
    """What an assignment costs, pair by pair and neighbour by neighbour; inf where it is not allowed."""
    total = 0.0
    for a, b in enumerate(partner):
        if b < 0:
            total += 2 * np.sqrt(source.area[a])
            continue
        mine, theirs = source.high[a] - source.low[a], target.high[b] - target.low[b]
        ratio = np.abs(np.log(np.maximum(mine, 1.0) / np.maximum(theirs, 1.0)))
        size = abs(np.log(source.area[a] / target.area[b]))
        distance = apart(source, a, target, b)
        if ratio.max() >= np.log(1.8) or distance >= 0.2 or size >= np.log(3):
            return np.inf
        total += distance
    for a, c in itertools.combinations(range(len(partner)), 2):
        b, d = partner[a], partner[c]
        if source.touching[a, c]:
            weight = np.sqrt(source.area[a] * source.area[c])
            if b < 0 or d < 0:
                total += 0.6 * weight
            else:
                here = (source.low + source.high)[c] - (source.low + source.high)[a]
                there = (target.low + target.high)[d] - (target.low + target.high)[b]
                shifted = np.linalg.norm(here - there) / 2 / DIAGONAL
                total += 0.6 * weight * (float(not target.touching[b, d]) + shifted)
        elif b >= 0 and d >= 0 and target.touching[b, d]:
            total += 0.6 * np.sqrt(target.area[b] * target.area[d])
    return total


def assignments(number: int, others: int) -> list[tuple[int, ...]]:
    every = itertools.product(range(-1, others), repeat=number)
    return [each for each in every if len({b for b in each if b >= 0}) == sum(b >= 0 for b in each)]


def never(mine: Sequence[int], theirs: Sequence[int]) -> bool:
    return False


@pytest.mark.parametrize("seed", range(12))
def test_no_exchange_or_move_makes_an_assignment_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    number, others = int(rng.integers(3, 5)), int(rng.integers(3, 5))
    low, size = rng.uniform(0, 14, (number, 3)), rng.uniform(3, 9, (number, 3))
    order = rng.permutation(max(number, others))[:others] % number
    there = low[order] + rng.normal(0, 3, (others, 3)), size[order] * rng.uniform(0.7, 1.4, (others, 3))
    links = [pair for pair in itertools.combinations(range(number), 2) if rng.random() < 0.5]
    links_there = [pair for pair in itertools.combinations(range(others), 2) if rng.random() < 0.5]
    source, target = parts(low, size, links), parts(*there, links_there)
    matching = match_parts(source, target, DIAGONAL, never)
    partner = [next(iter(counterparts(matching, part)), -1) for part in range(number)]
    least = cost(source, target, partner)
    assert np.isfinite(least)
    for other in assignments(number, others):
        changed = [part for part in range(number) if other[part] != partner[part]]
        exchange = len(changed) == 2 and sorted(other) == sorted(partner)
        move = len(changed) == 1 and other[changed[0]] >= 0
        if exchange or move:
            assert cost(source, target, other) >= least - 1e-9, (partner, other)


@pytest.mark.parametrize("seed", range(12))
def test_without_neighbours_the_assignment_is_the_best_of_all(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    number, others = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    low, size = rng.uniform(0, 12, (number, 3)), rng.uniform(3, 9, (number, 3))
    order = rng.integers(0, number, others)
    target = parts(
        low[order] + rng.normal(0, 4, (others, 3)), size[order] * rng.uniform(0.7, 1.4, (others, 3))
    )
    source = parts(low, size)
    matching = match_parts(source, target, DIAGONAL, never)
    partner = [next(iter(counterparts(matching, part)), -1) for part in range(number)]
    best = min(cost(source, target, each) for each in assignments(number, others))
    assert cost(source, target, partner) == pytest.approx(best, abs=1e-9)
    assert len(matching) == sum(b >= 0 for b in partner)


def one_box(size: list[float], area: float = 0.2) -> Parts:
    big = [60.0, 20.0, 10.0]
    return parts(np.array([[0.0, 0, 0], [70, 0, 0]]), np.array([big, size]), area=np.array([0.8, area]))


@pytest.mark.parametrize(
    ("size", "alike"),
    [
        ([10.0, 6, 6], True),
        ([17.9, 6, 6], True),
        ([18.1, 6, 6], False),
        ([5.6, 6, 6], True),
        ([5.5, 6, 6], False),
    ],
)
def test_boxes_of_like_extents_are_alike(size: list[float], alike: bool) -> None:
    source = one_box([10.0, 6, 6])
    assert like_shape(source, 1, one_box(size), DIAGONAL).tolist() == ([1] if alike else [])
    matching = match_parts(source, one_box(size), DIAGONAL, never)
    assert counterparts(matching, 1) == ([1] if alike else [])
    agreed = match_parts(source, one_box(size), DIAGONAL, lambda mine, theirs: (mine, theirs) == ([1], [1]))
    assert counterparts(agreed, 1) == [1]


def test_small_extents_are_compared_to_a_floor() -> None:
    """An extent of 0.5 counts as 1 of 100; beyond 1.8 times that the surfaces are asked, beyond 3 none is."""
    agrees = [0.5, 6, 6], [1.7, 6, 6]
    assert counterparts(match_parts(one_box(agrees[0]), one_box(agrees[1]), DIAGONAL, never), 1) == [1]
    assert counterparts(match_parts(one_box(agrees[0]), one_box([2.9, 6, 6]), DIAGONAL, never), 1) == []
    thick = one_box([3.1, 6, 6])
    assert counterparts(match_parts(one_box(agrees[0]), thick, DIAGONAL, lambda *_: True), 1) == []


def test_areas_differ_by_less_than_three() -> None:
    source = one_box([10.0, 6, 6], 0.2)
    assert counterparts(match_parts(source, one_box([10.0, 6, 6], 0.59), DIAGONAL, never), 1) == [1]
    assert counterparts(match_parts(source, one_box([10.0, 6, 6], 0.61), DIAGONAL, never), 1) == []


def test_pins_overrule_likeness() -> None:
    source, target = one_box([10.0, 6, 6]), one_box([2.0, 2, 2])
    pinned = match_parts(source, target, DIAGONAL, never, {1: 1})
    assert counterparts(pinned, 1) == [1] and counterparts(pinned, 0) == [0]
    crossed = match_parts(source, target, DIAGONAL, never, {1: 0})
    assert counterparts(crossed, 1) == [0] and counterparts(crossed, 0) == []
    assert len(crossed) == 1


@pytest.mark.parametrize(
    ("name", "pinned", "source", "target"),
    [
        ([0, 0, -1, 2], {}, [0, 1, 2], [0, 0, 1, 2]),  # two pieces of a hull, and what boxes left alone
        ([0, 0, -1, -1], {}, [0, 1, -1], [0, 0, 1, -1]),
        ([1, 0, -1, 2], {}, [0, 1, 2], [0, -1, 1, 2]),  # what boxes matched is named otherwise
        ([0, 1, -1, 2], {}, [0, 1, 2], [0, -1, 1, 2]),  # the same of a part that is named by nothing
        ([0, 0, -1, 2], {0: 0, 2: 0}, [0, 1, -1], [0, -1, 1, -1]),  # the user said something else
    ],
)
def test_what_boxes_leave_is_matched_by_name(
    name: list[int], pinned: dict[int, int], source: list[int], target: list[int]
) -> None:
    known = Matching(np.array([0, 1, -1]), np.array([0, -1, 1, -1]))
    matching = with_named(known, np.array(name), np.zeros((4, 3)), row_of_boxes(4), pinned)
    assert matching.source_class.tolist() == source and matching.target_class.tolist() == target


def test_two_pieces_of_one_name_are_one_class() -> None:
    known = Matching(np.array([-1, 0]), np.array([-1, 0, -1]))
    matching = with_named(known, np.array([0, 1, 0]), np.zeros((3, 2)), row_of_boxes(3), {})
    assert counterparts(matching, 0) == [0, 2] and counterparts(matching, 1) == [1]


@pytest.mark.parametrize(
    ("fin", "elsewhere", "pinned", "classes"),
    [
        (0.08, 0.0, {}, [0, 1, 1, 1, -1]),  # a T-tail: a fin and two stabilisers, but no mast beside them
        (0.01, 0.0, {}, [0, -1, -1, -1, -1]),  # most of it is something else
        (0.08, 0.09, {}, [0, -1, -1, -1, -1]),  # most of the fin comes elsewhere
        (0.08, 0.0, {1: 2}, [0, -1, -1, -1, -1]),  # the user said something else of the fin
    ],
)
def test_parts_that_make_up_one_correspond_to_it(
    fin: float, elsewhere: float, pinned: dict[int, int], classes: list[int]
) -> None:
    known = Matching(np.array([0, -1, -1, -1, -1]), np.array([0, -1, -1]))
    shares = np.array([[0.7, elsewhere, 0, 0, 0], [0, fin, 0.04, 0.04, 0.005], [0.0] * 5])
    target = replace(row_of_boxes(3), area=np.array([0.7, 0.2, 0.1]))
    matching = with_named(known, np.full(3, -1), shares, target, pinned)
    assert matching.source_class.tolist() == classes
    assert matching.target_class.tolist() == [0, max(classes) if 1 in classes else -1, -1]
    assert known.source_class.tolist() == [0, -1, -1, -1, -1]  # as it was


def row_of_boxes(number: int) -> Parts:
    """Boxes in a row, none of which is known to have a mirror image."""
    return parts(np.arange(number)[:, None] * [10.0, 0, 0], np.full((number, 3), 5.0))
