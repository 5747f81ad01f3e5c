"""Names of parts: landmarks, numbers and places, on parts that are known."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import BoxOf
from made_clouds import boxes as sampled_boxes

from upplied.config import CorrespondenceSettings
from upplied.errors import RefusedError, SettingsError
from upplied.planning.correspondence.correspondences import correspond, nearest
from upplied.planning.correspondence.naming import choices_for, pinned_parts, side_of
from upplied.planning.surface.parts import parts_of
from upplied.records import Cloud, Floats, Registration


def boxes(*shapes: BoxOf) -> Cloud:
    return sampled_boxes(*shapes, number=400)


HULL: BoxOf = ((0, -5, 0), (80, 10, 8))
SIZE = (5.0, 3.0, 3.0)
#: A body, two engines on each side (inner further ahead), one on top in the middle, and a large fin.
TARGET = boxes(HULL, ((50, 12, 0), SIZE), ((30, 30, 0), SIZE), ((50, -15, 0), SIZE), ((30, -33, 0), SIZE),
               ((2, -1.5, 20), SIZE), ((70, -1, 8), (10.0, 2.0, 15.0)))  # fmt: skip
SOURCE = boxes(HULL, ((40, 20, 0), SIZE), ((40, -23, 0), SIZE), ((2, -1.5, 20), SIZE),
               ((40, -33, 0), (1.0, 1.0, 1.0)), ((40, 32, 0), (1.0, 1.0, 1.0)))  # fmt: skip
SAME = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)


def pinned(
    *pairs: tuple[str, str], registration: Registration = SAME, target: Cloud = TARGET
) -> dict[int, int]:
    there = registration.to_target(np.array([52.0, 13.5, 1.5]))
    marks = {"mine": (42.0, 21.0, 1.0)}, {"inner_one": tuple(there.tolist())}
    return pinned_parts(SOURCE, target, registration, pairs, *marks)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("place", "part"),
    [("outer", 2), ("inner", 1), ("right_outer", 4), ("right", 3), ("inner_right", 3), ("left_inner", 1),
     ("front", 1), ("rear", 2), ("high", 1), ("part_4", 4), ("part_0", None), ("inner_one", 1)],
)  # fmt: skip
def test_places_choose_among_parts_of_the_shape(place: str, part: int | None) -> None:
    if part is None:
        with pytest.raises(
            RefusedError, match=r"there lies part_0 of the target with .* part_1 of the source"
        ):
            pinned(("mine", place))
    else:
        assert pinned(("mine", place)) == {1: part}
        assert pinned(("part_1", place)) == {1: part}


def test_the_other_side_is_the_other_sides() -> None:
    assert pinned(("part_2", "outer")) == {2: 4} and pinned(("part_2", "left_outer")) == {2: 2}
    assert pinned(("part_3", "high")) == {3: 5}  # in the middle stays in the middle
    assert pinned(("mine", "outer"), ("part_2", "inner")) == {1: 2, 2: 3}


def test_no_place_means_a_part_that_is_named_by_another_kind_or_of_another_size() -> None:
    """The outer left part is of an engine's shape, but a displacement brings a piece of the hull onto it."""
    marks, outer = {"mine": (42.0, 21.0, 1.0)}, (("mine", "outer"),)
    label = TARGET.part
    assert label is not None

    def choice(names: list[int], target: Cloud = TARGET) -> dict[int, int]:
        return pinned_parts(SOURCE, target, SAME, outer, marks, {}, named=np.array(names)[target.part])

    assert choice([0, 1, -1, 2, -1, 3, -1]) == {1: 2}  # nothing came near it: another one of its kind
    assert choice([0, 1, 2, 2, -1, 3, -1]) == {1: 2}  # its mirrored one is of its kind
    assert choice([0, 1, 0, 2, -1, 3, -1]) == {1: 1}
    small = boxes(HULL, ((50, 12, 0), SIZE), ((30, 30, 0), (4.0, 2.2, 2.2)), ((50, -15, 0), SIZE))
    assert choice([-1, -1, -1, -1], small) == {1: 2}
    assert choice([0, 1, -1, 2], small) == {1: 1}  # half the size of the one that corresponds


def test_places_are_asked_where_the_target_is_laid() -> None:
    half_turn = np.diag([-1.0, -1.0, 1.0])
    turned = Cloud(TARGET.points @ half_turn, TARGET.normals @ half_turn, TARGET.area_m2, TARGET.part)  # type: ignore[operator]
    fit = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, turn=half_turn)
    assert pinned(("mine", "outer"), ("part_2", "inner_one"), registration=fit, target=turned) == {1: 2, 2: 1}


def test_names_that_mean_nothing_are_told() -> None:
    with pytest.raises(
        SettingsError, match=r"names no part of the source structure.*landmarks \(mine\), part_0 to part_5"
    ):
        pinned(("theirs", "outer"))
    with pytest.raises(SettingsError, match=r"inner_one\), part_0 to part_6 or places among left, right"):
        pinned(("mine", "outermost"))
    for bad in ("part_6", "part_x", "6"):
        with pytest.raises(SettingsError, match="of the source"):
            pinned((bad, "outer"))
    with pytest.raises(RefusedError, match="no part of the target has the shape and size"):
        pinned(("mine", "outer"), target=boxes(HULL, ((70, -1, 8), (10.0, 2.0, 15.0))))
    with pytest.raises(SettingsError, match="none declared"):
        pinned_parts(SOURCE, TARGET, SAME, (("mine", "outer"),), {}, {})


def test_sides_begin_beyond_a_twentieth_of_the_width() -> None:
    parts = parts_of(TARGET)
    assert [side_of(parts, part) for part in range(7)] == [0, 1, 1, -1, -1, 0, 0]


def test_choices_are_of_the_shape_those_on_the_own_side_first() -> None:
    source, target = parts_of(SOURCE), parts_of(TARGET)
    assert choices_for(source, 1, target).tolist() == [1, 2, 3, 4, 5]
    assert choices_for(source, 2, target).tolist() == [3, 4, 1, 2, 5]
    assert choices_for(source, 1, target, [2]).tolist() == [1, 2, 3, 4, 5]
    larger = parts_of(
        boxes(HULL, ((50, 12, 0), SIZE), ((30, 30, 0), (6.2, 3.9, 3.9)), ((30, -33, 0), (5.4, 3.2, 3.2)),
              ((2, -1.5, 20), SIZE), ((70, -1, 8), (10.0, 2.0, 15.0)))
    )  # fmt: skip
    assert choices_for(source, 1, larger).tolist() == [1, 2, 3, 4]
    assert choices_for(source, 1, larger, [1]).tolist() == [1, 3, 4]
    assert choices_for(source, 1, larger, [1, 2]).tolist() == [1, 2, 3, 4]


def brute(points: Floats, others: Floats) -> tuple[list[int], list[float]]:
    apart = np.linalg.norm(points[:, None] - others, axis=2)
    return apart.argmin(axis=1).tolist(), apart.min(axis=1).tolist()


def test_the_published_counterpart_is_the_nearest_point() -> None:
    rng = np.random.default_rng(1)
    here, there = Cloud(rng.normal(size=(30, 3))), Cloud(rng.normal(size=(40, 3)))
    fit = Registration(np.array([2.0, 1.0, 0.5]), np.eye(3), np.array([0.1, 0.2, 0.3]), 0.0, True)
    index, distance = brute(here.points, fit.to_demo(there.points))
    for actual in (
        nearest(here, there, fit),
        correspond(here, there, fit, CorrespondenceSettings(method="parts")),
    ):
        assert actual.target_index.tolist() == index
        assert actual.distance_m == pytest.approx(distance)
        assert np.array_equal(actual.target_points, there.points[index])
        assert actual.summary == "nearest of 40 target points for each of 30"
    by_nearest = correspond(SOURCE, TARGET, SAME, CorrespondenceSettings(method="nearest"))
    assert by_nearest.target_index.tolist() == brute(SOURCE.points, TARGET.points)[0]
    by_parts = correspond(SOURCE, TARGET, SAME, CorrespondenceSettings(method="parts"))
    assert by_parts.source_class is not None
