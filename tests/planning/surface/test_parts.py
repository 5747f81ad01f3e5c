"""Laws of parts and of their matching."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import counterparts

from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.naming import place_of
from upplied.planning.correspondence.part_alignment import aligned_parts
from upplied.planning.correspondence.part_assignment import match_parts
from upplied.planning.surface.parts import labels_of, mesh_pieces, part_labels, parts_of
from upplied.records import Cloud, Structure

DIAGONAL = 100.0


def brick(low: tuple[float, float, float], size: tuple[float, float, float], number: int = 200) -> np.ndarray:
    """Points on the surface of a box."""
    rng = np.random.default_rng(abs(hash((low, size))) % 2**32)
    points = rng.random((number, 3))
    axis = rng.integers(3, size=number)
    points[np.arange(number), axis] = rng.integers(2, size=number)
    return np.array(low) + points * size


def cloud(*bricks: np.ndarray) -> Cloud:
    label = np.repeat(np.arange(len(bricks)), [len(points) for points in bricks])
    points = np.concatenate(bricks)
    return Cloud(points, area_m2=np.ones(len(points)), part=label)


def faced(*bricks: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Cloud:
    """Boxes with normals, dense enough to feel each other."""
    points = [brick(low, size, 1500) for low, size in bricks]
    normals = []
    for (low, size), each in zip(bricks, points, strict=True):
        at = (each - low) / size - 0.5
        axis = np.abs(at).argmax(axis=1)
        normals.append(np.sign(at[np.arange(len(at)), axis])[:, None] * np.eye(3)[axis])
    whole = cloud(*points)
    return Cloud(whole.points, np.concatenate(normals), whole.area_m2, whole.part)


def never(parts: object, partners: object) -> bool:
    return False


HULL = brick((0, 0, 0), (90, 20, 10), 800)
LEFT, RIGHT = brick((30, 25, 0), (9, 4, 4)), brick((30, -9, 0), (9, 4, 4))


def test_pieces_are_those_of_the_mesh() -> None:
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    near, far = np.array([5, 0, 0]), np.array([9, 0, 0])
    vertices = np.concatenate([triangle, triangle + near, triangle + near, triangle + far])
    pieces = mesh_pieces(Structure("s", "k", vertices, np.arange(12).reshape(4, 3)))
    assert pieces[1] == pieces[2]  # not welded in the file, but at the same place
    assert len(set(pieces.tolist())) == 3


def test_labels_are_ordered_by_area_and_small_pieces_join_what_is_near() -> None:
    crumbs = [brick((30 + k, 26, 4), (0.3, 0.3, 0.3), 2) for k in range(5)]
    points = np.concatenate([LEFT, HULL, *crumbs])
    piece = np.repeat(np.arange(7), [len(LEFT), len(HULL), *[2] * 5])
    label = part_labels(points, np.ones(len(points)), piece)
    assert set(label.tolist()) == {0, 1}
    assert (label[: len(LEFT)] == 1).all() and (label[len(LEFT) : len(LEFT) + len(HULL)] == 0).all()
    assert (label[-10:] == 1).all()


def test_halves_of_a_nacelle_are_one_part_and_a_wing_is_not_its_engine() -> None:
    front, rear = brick((30, 25, 0), (5, 4, 4)), brick((35, 25, 0), (5, 4, 4))
    points = np.concatenate([HULL, front, rear])
    piece = np.repeat(np.arange(3), [len(HULL), len(front), len(rear)])
    label = part_labels(points, np.ones(len(points)), piece)
    assert set(label.tolist()) == {0, 1}


def test_a_cloud_without_labels_is_one_part() -> None:
    one = Cloud(HULL)
    assert len(parts_of(one)) == 1 and not labels_of(one).any()


def test_the_nearer_engine_is_not_taken_for_the_one_of_its_place() -> None:
    source = cloud(HULL, brick((30, 25, 0), (9, 4, 4)), brick((20, 38, 0), (9, 4, 4)))
    # Both engines moved out, so that the inner one now lies nearest to where the outer one was.
    target = cloud(HULL, brick((18, 45, 0), (9, 4, 4)), brick((24, 36, 0), (9, 4, 4)))
    matching = match_parts(parts_of(source), parts_of(target), DIAGONAL, never)
    assert counterparts(matching, 1) == [2] and counterparts(matching, 2) == [1]


def test_a_fairing_takes_no_engine() -> None:
    engine, fairing = brick((30, 25, 0), (5, 4, 4), 200), brick((29, 22, 2), (4, 1, 1), 20)
    inner, outer = brick((30, 26, 0), (5, 4, 4), 200), brick((22, 34, 0), (5, 4, 4), 200)
    matching = match_parts(
        parts_of(cloud(HULL, engine, fairing)), parts_of(cloud(HULL, inner, outer)), DIAGONAL, never
    )
    assert counterparts(matching, 1) == [1]  # though both would find a partner if the fairing took it
    assert counterparts(matching, 2) == []


def test_a_strip_that_sticks_out_does_not_widen_a_part() -> None:
    engine = brick((30, 25, 0), (9, 4, 4), 300)
    strip = np.column_stack([np.full(12, 34.0), np.linspace(15, 25, 12), np.full(12, 3.5)])
    whole = Patch(engine, np.tile([0.0, 0, 1], (300, 1)), np.zeros(300, int))
    moved = engine + np.array([2.0, 3.0, 0.0])
    longer = np.concatenate([moved, strip])
    partner = Patch(longer, np.tile([0.0, 0, 1], (312, 1)), np.zeros(312, int))
    np.testing.assert_allclose(aligned_parts(whole, partner, np.empty(0, np.int64)).points, moved, atol=0.3)


def test_a_part_more_stays_without_partner() -> None:
    source, target = cloud(HULL, LEFT, RIGHT), cloud(HULL, LEFT)
    matching = match_parts(parts_of(source), parts_of(target), DIAGONAL, never)
    assert counterparts(matching, 1) == [1] and counterparts(matching, 2) == []
    assert matching.source_class[2] == -1


WIDE = brick((0, 0, 0), (90, 20, 10), 3000)


def test_a_part_of_one_side_answers_to_none_in_the_middle_nor_across() -> None:
    belly, one_side = brick((30, 8, -4), (9, 4, 4)), brick((32, 10.5, 10), (9, 4, 4))
    other_side = brick((32, 5.5, 10), (9, 4, 4))
    source = parts_of(cloud(WIDE, brick((30, 17, -4), (9, 4, 4)), brick((30, -1, -4), (9, 4, 4))))
    matching = match_parts(source, parts_of(cloud(WIDE, belly)), DIAGONAL, never)
    assert counterparts(matching, 0) == [0]
    assert counterparts(matching, 1) == counterparts(matching, 2) == []
    pair = parts_of(cloud(WIDE, one_side, other_side))
    # Crossed over they would lie as near to their partners, and the order of the rows says nothing.
    swapped = parts_of(cloud(WIDE, other_side, one_side))
    matching = match_parts(pair, swapped, DIAGONAL, never)
    assert counterparts(matching, 1) == [2] and counterparts(matching, 2) == [1]
    lone = match_parts(pair, parts_of(cloud(WIDE, other_side)), DIAGONAL, never)
    assert counterparts(lone, 2) == [1] and counterparts(lone, 1) == []


def test_what_has_no_mirror_image_may_stand_on_the_other_side() -> None:
    crane, moved = brick((30, 14, 10), (4, 4, 8)), brick((30, 2, 10), (4, 4, 8))
    matching = match_parts(parts_of(cloud(WIDE, crane)), parts_of(cloud(WIDE, moved)), DIAGONAL, never)
    assert counterparts(matching, 1) == [1]


def test_no_tier_is_left_out_in_the_middle() -> None:
    hull = brick((0, 0, 0), (90, 20, 10), 3000)
    four = [brick((10, 2, 10 + 4 * tier), (60, 16, 4), 900) for tier in range(4)]
    three = [brick((10, 2, 10 + 5 * tier), (60, 16, 5), 900) for tier in range(3)]
    matching = match_parts(parts_of(cloud(hull, *four)), parts_of(cloud(hull, *three)), DIAGONAL, never)
    assert [counterparts(matching, part) for part in range(5)] == [[0], [1], [2], [3], []]


def test_a_wing_is_no_turned_fuselage() -> None:
    fuselage, wing = brick((0, -3, 0), (60, 6, 3), 600), brick((25, -29, 5), (6, 58, 2), 600)
    tall, engine = brick((0, -3, 0), (60, 6, 10), 600), brick((25, -29, 5), (6, 3, 2))
    matching = match_parts(parts_of(cloud(fuselage, wing)), parts_of(cloud(tall, engine)), DIAGONAL, never)
    assert counterparts(matching, 0) == counterparts(matching, 1) == []


def test_what_stands_on_its_neighbours_is_a_body_and_what_continues_their_skin_is_none() -> None:
    hull = ((0.0, 0.0, 0.0), (40.0, 10.0, 6.0))
    cabin, panel = ((10.0, 2.0, 6.0), (20.0, 6.0, 2.0)), ((40.0, 0.0, 0.0), (8.0, 10.0, 6.0))
    whole = faced(hull, cabin, panel)
    assert whole.normals is not None and whole.part is not None and whole.area_m2 is not None
    outer = np.ones(len(whole.points), bool)
    outer[whole.part == 0] = whole.normals[whole.part == 0, 0] != 1  # open where the deck goes on
    outer[whole.part == 1] = whole.points[whole.part == 1, 2] > 6.05  # its floor is not seen
    outer[whole.part == 2] = whole.normals[whole.part == 2, 2] == 1  # a part of the deck
    skin = Cloud(whole.points[outer], whole.normals[outer], whole.area_m2[outer], whole.part[outer])
    assert parts_of(skin).body.tolist() == [True, True, False]


def test_pins_are_kept() -> None:
    source, target = cloud(HULL, LEFT, RIGHT), cloud(HULL, LEFT, RIGHT)
    matching = match_parts(parts_of(source), parts_of(target), DIAGONAL, never, {1: 2})
    assert counterparts(matching, 1) == [2]


def test_order_of_the_target_does_not_matter() -> None:
    source, target = cloud(HULL, LEFT, RIGHT), cloud(RIGHT, HULL, LEFT)
    matching = match_parts(parts_of(source), parts_of(target), DIAGONAL, never)
    assert [counterparts(matching, part) for part in range(3)] == [[1], [2], [0]]


@pytest.mark.parametrize("agrees", [True, False])
def test_two_halves_answer_to_a_whole_only_where_the_surfaces_agree(agrees: bool) -> None:
    whole = brick((30, -40, 3), (10, 80, 1))
    halves = brick((30, -40, 3), (10, 39, 1)), brick((30, 1, 3), (10, 39, 1))
    matching = match_parts(
        parts_of(cloud(HULL, whole)), parts_of(cloud(HULL, *halves)), DIAGONAL,
        lambda parts, partners: agrees and len(parts) + len(partners) == 3,
    )  # fmt: skip
    assert counterparts(matching, 1) == ([1, 2] if agrees else [])


def test_places_in_words() -> None:
    parts = parts_of(cloud(HULL, LEFT, RIGHT, brick((80, 8, 15), (4, 4, 4))))
    assert place_of(parts, 0) == "low"
    assert place_of(parts, 1).split() == ["rear", "left", "low"]
    assert place_of(parts, 2).split() == ["rear", "right", "low"]
    assert place_of(parts, 3).split() == ["front", "high"]
