"""Each step by which parts are told by likeness, on samples that are counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.correspondence.label_transfer import (
    _alike,
    _compact,
    _connected,
    _fits,
    _floating,
    _is_alone,
    _named_stretches,
    _others_alike,
)
from upplied.records import Cloud, Floats, Ints

UP = np.array([0.0, 0, 1])


def patch(low: tuple[float, float, float], columns: int, rows: int, step: float = 1.0) -> Floats:
    """A level grid."""
    x, y = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step, indexing="ij")
    return np.array(low) + np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])


def cloud(*patches: Floats, normals: Floats | None = None) -> tuple[Cloud, Ints]:
    points = np.concatenate(patches)
    label = np.repeat(np.arange(len(patches)), [len(each) for each in patches])
    facing = np.tile(UP, (len(points), 1)) if normals is None else normals
    return Cloud(points, facing, np.ones(len(points))), label


def test_crumbs_that_touch_nothing_float() -> None:
    whole, piece = cloud(patch((0, 0, 0), 20, 20), patch((0, 0, 9), 7, 2), patch((0, 0, 20), 5, 3))
    assert np.array_equal(_floating(whole), piece == 1)  # fourteen samples do, fifteen do not
    touching, piece = cloud(patch((0, 0, 0), 20, 20), patch((0, 0, 1.99), 7, 2))
    assert not _floating(touching).any()
    alone, _ = cloud(patch((0, 0, 0), 3, 3))
    assert not _floating(alone).any()  # the largest never does
    large, piece = cloud(patch((0, 0, 0), 100, 100), patch((0, 0, 9), 19, 1), patch((0, 0, 20), 21, 1))
    assert np.array_equal(_floating(large), piece == 1)  # a five-hundredth, of many


def test_a_stretch_has_one_name_from_three_fifths_of_its_area_on() -> None:
    area = np.array([0.59, 0.41, 0.6, 0.2, 0.2, 5.0])
    skin, name = np.array([0, 0, 1, 1, 1, 2]), np.array([0, 1, 2, 0, 1, 1])
    whole = Cloud(np.zeros((6, 3)), None, area)
    assert _named_stretches(whole, skin, name).tolist() == [0, 1, 2, 2, 2, 1]


def test_samples_of_one_name_that_touch_are_one_part() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 3], [4, 5]])
    found = _connected(pairs, np.array([7, 7, 8, 8, 9, 9]))
    groups = [set(np.flatnonzero(found == part).tolist()) for part in np.unique(found)]
    assert sorted(map(sorted, groups)) == [[0, 1], [2, 3], [4, 5]]
    assert len(np.unique(_connected(np.empty((0, 2), int), np.zeros(3, int)))) == 3


def test_a_part_up_to_a_fifth_of_the_diagonal_may_stand_elsewhere_as_well() -> None:
    whole, label = cloud(
        patch((0, 0, 0), 100, 1), patch((0, 5, 0), 20, 1), patch((40, 5, 0), 22, 1), patch((80, 5, 0), 14, 1)
    )
    found = _compact(whole, label, 100.0)
    assert [np.unique(label[mine]).tolist() for mine in found] == [[1]]
    assert [np.unique(label[mine]).tolist() for mine in _compact(whole, label, 110.0)] == [[1], [2]]


def test_a_stretch_is_alone_where_it_is_most_of_its_part() -> None:
    label = np.array([0, 0, 0, 0, 0, 1, 1])
    assert _is_alone(label, np.array([1, 1, 1, 1, 0, 0, 0], bool))
    assert not _is_alone(label, np.array([1, 1, 1, 0, 0, 0, 0], bool))
    assert _is_alone(label, np.array([1, 0, 0, 0, 0, 1, 1], bool))  # two of three lie in the other part


def ell(at: tuple[float, float, float], flip: tuple[float, float, float] = (1, 1, 1)) -> Floats:
    """A foot and an arm on one side of it."""
    own = np.concatenate([patch((0, 0, 0), 8, 2), patch((0, 2, 0), 2, 6)])
    return own * np.array(flip) + np.array(at)


@pytest.mark.parametrize(
    ("flip", "alike"),
    [((1, 1, 1), True), ((1, -1, 1), True), ((-1, 1, 1), True), ((-1, -1, 1), False)],
)
def test_likeness_is_up_to_a_shift_and_a_mirror(flip: tuple[float, float, float], alike: bool) -> None:
    whole, label = cloud(ell((0, 0, 0)), ell((50, 30, 7), flip))
    assert _alike(whole, label == 0, label == 1, 0.5) == alike
    assert not _alike(whole, label == 0, np.ones(len(whole), bool), 0.5)  # it would be like itself


@pytest.mark.parametrize(
    ("area", "alike"), [(1.0, True), (1.49, True), (1.51, False), (0.67, True), (0.66, False)]
)
def test_what_is_alike_has_an_area_within_a_ratio(area: float, alike: bool) -> None:
    points, label = cloud(ell((0, 0, 0)), ell((50, 0, 0)))
    whole = Cloud(points.points, points.normals, np.where(label == 1, area, 1.0))
    assert _alike(whole, label == 0, label == 1, 0.5) == alike


@pytest.mark.parametrize(("off", "fits"), [(38, True), (41, False)])
def test_most_samples_either_way_must_lie_near_and_face_alike(off: int, fits: bool) -> None:
    here = patch((0, 0, 0), 10, 10)
    there = here + np.array([30.0, 0, 0])
    facing = np.tile(UP, (100, 1))
    order = np.random.default_rng(0).permutation(np.setdiff1d(np.arange(100), [0, 99]))[:off]
    turned = facing.copy()
    turned[order] = [np.sin(1.1), 0, np.cos(1.1)]  # 63 deg
    assert _fits(here, facing, there, turned, 0.5) == fits
    assert _fits(here, turned, there, facing, 0.5) == fits
    near = facing.copy()
    near[order] = [np.sin(0.9), 0, np.cos(0.9)]
    assert _fits(here, facing, there, near, 0.5)


def test_near_is_a_twentieth_of_the_size_or_a_spacing() -> None:
    here = patch((0, 0, 0), 11, 11)
    size = np.hypot(10, 10)
    lifted = here.copy()
    inner = (np.abs(here[:, :2] - 5) <= 4.5).all(axis=1)
    for height, step, fits in (
        (0.045 * size, 0.1, True),
        (0.075 * size, 0.1, False),
        (0.075 * size, 1.2, True),
    ):
        lifted[inner, 2] = height
        # The middle of the boxes is laid on the middle, so that half of the height is left on either side.
        frame = np.vstack([lifted, [[0, 0, -height]]])
        ends = np.vstack([here, [[0, 0, -height], [0, 0, height]]])
        up = np.tile(UP, (len(ends), 1))
        assert _fits(frame, up[: len(frame)], ends, up, step) == fits, (height, step)


def test_stretches_like_a_compact_part_become_parts_of_their_own() -> None:
    """An engine was named, its like lies unnamed on a large hull, and so does something else."""
    hull = patch((0, 0, 0), 80, 40)
    pieces = hull, ell((5, 60, 9)), ell((60, 60, 9)), patch((30, 60, 9), 3, 12), ell((90, 0, 9))
    whole, skin = cloud(*pieces)
    label = np.where(skin == 1, 1, 0)
    found = _others_alike(whole, skin, label, 0.5)
    assert np.array_equal(found == 1, skin == 1)
    assert np.array_equal(found == 0, (skin == 0) | (skin == 3))
    assert len(np.unique(found[skin == 2])) == 1 and len(np.unique(found[skin == 4])) == 1
    assert found[skin == 2][0] != found[skin == 4][0]
