"""Each step by which parts are told by likeness, on samples that are counted by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.planning.correspondence.label_transfer import (
    _alike,
    _compact,
    _covered,
    _fits,
    _floating,
    _named,
    _size_and_reach,
    _with_others,
    connected,
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


def named(stretch: Ints, name: Ints, at: tuple[float, float] = (0.0, 50.0)) -> Ints:
    """Names after `_named`; the parts 0 and 1 lie at two places of the x-axis, and samples on their own."""
    number = len(name)
    where = np.array(at)[name]
    points = np.column_stack([where, np.arange(number) % 10, np.arange(number) // 10 % 2]).astype(float)
    whole = Cloud(points, np.tile(UP, (number, 1)), np.ones(number))
    return _named(whole, stretch, name, replace(whole, part=name))


def test_few_samples_of_a_stretch_are_named_as_most_of_it() -> None:
    skin = np.repeat([0, 1, 2], [100, 600, 20])
    name = np.concatenate([np.repeat([0, 1], [86, 14]), np.repeat([1, 0], [571, 29]), np.ones(20, int)])
    names = named(skin, name)
    assert (names[skin == 0] == 0).all()  # fourteen are few of any stretch
    assert (names[skin == 1] == 1).all()  # and fewer than a twentieth of a large one
    assert (names[skin == 2] == 1).all()
    name[85], name[670] = 1, 0
    assert np.array_equal(named(skin, name), name)  # fifteen are not, nor thirty of six hundred


def test_what_lies_hardly_farther_from_what_most_are_named_is_named_so_as_well() -> None:
    skin, name = np.zeros(100, int), np.repeat([0, 1], [60, 40])
    assert np.array_equal(named(skin, name, (0.0, 2.1)), name)
    assert (named(skin, name, (0.0, 1.9)) == 0).all()  # within two spacings


def test_samples_of_one_name_that_touch_are_one_part() -> None:
    pairs = np.array([[0, 1], [1, 2], [2, 3], [4, 5]])
    labels = connected(pairs, np.array([7, 7, 8, 8, 9, 9]))
    groups = [set(np.flatnonzero(labels == part).tolist()) for part in np.unique(labels)]
    assert sorted(map(sorted, groups)) == [[0, 1], [2, 3], [4, 5]]
    assert len(np.unique(connected(np.empty((0, 2), int), np.zeros(3, int)))) == 3


def test_a_part_up_to_a_fifth_of_the_diagonal_may_stand_elsewhere_as_well() -> None:
    whole, label = cloud(
        patch((0, 0, 0), 100, 1), patch((0, 5, 0), 20, 1), patch((40, 5, 0), 22, 1), patch((80, 5, 0), 14, 1)
    )
    assert [np.unique(label[mine]).tolist() for mine in _compact(whole, label)] == [[1]]
    wider = replace(whole, points=whole.points * np.where(label == 0, 1.1, 1.0)[:, None])
    assert [np.unique(label[mine]).tolist() for mine in _compact(wider, label)] == [[1], [2]]


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
    assert _alike(whole, label == 0, label == 1) == alike
    assert not _alike(whole, label == 0, np.ones(len(whole), bool))  # it would be like itself


@pytest.mark.parametrize(
    ("area", "alike"), [(1.0, True), (1.49, True), (1.51, False), (0.67, True), (0.66, False)]
)
def test_what_is_alike_has_an_area_within_a_ratio(area: float, alike: bool) -> None:
    points, label = cloud(ell((0, 0, 0)), ell((50, 0, 0)))
    whole = Cloud(points.points, points.normals, np.where(label == 1, area, 1.0))
    assert _alike(whole, label == 0, label == 1) == alike


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


@pytest.mark.parametrize(
    ("spread", "area", "reach"), [(100.0, 0.25, 5.0), (10.0, 0.25, 0.5), (10.0, 4.0, 2.0)]
)
def test_near_is_a_twentieth_of_the_size_or_a_spacing(spread: float, area: float, reach: float) -> None:
    points = np.array([[0.0, 0, 0], [spread, 0, 0], [0, 0, 400.0]])
    mine = np.array([True, True, False])
    assert _size_and_reach(Cloud(points, None, np.full(3, area)), mine) == pytest.approx((spread, reach))


HULL = patch((0, 0, 0), 80, 40)


def others(labels: Ints, skin: Ints, before: Ints) -> list[list[int]]:
    """Of which stretches the parts are that are new."""
    new = [part for part in np.unique(labels) if (before[labels == part] != part).any()]
    return sorted(np.unique(skin[labels == part]).tolist() for part in new)


def test_what_lies_far_and_is_like_a_compact_part_is_another_of_its_kind() -> None:
    """An engine was named; its likes lie about, one of them in two stretches, and so does something else."""
    whole, skin = cloud(HULL, ell((5, 60, 9)), ell((60, 60, 9)), patch((30, 60, 9), 3, 12), ell((90, 0, 9)))
    label = np.where(skin == 1, 1, 0)
    skin = np.where((skin == 4) & (whole.points[:, 1] > 1.5), 5, skin)  # the arm is a stretch of its own
    labels = _with_others(whole, skin, label, skin >= 2)
    assert others(labels, skin, label) == [[2], [4, 5]]
    assert np.array_equal(labels == 1, label == 1)
    # What the displacement brings something onto is no other one, whatever its shape.
    assert others(_with_others(whole, skin, label, skin == 3), skin, label) == []
    half = (skin == 2) & (np.cumsum(skin == 2) <= 0.5 * (skin == 2).sum())
    assert others(_with_others(whole, skin, label, half), skin, label) == []


def test_what_a_part_covers_of_a_larger_stretch_is_no_part() -> None:
    """A tail lies on a wing as well as on another tail, and a pylon may be a piece of the wing's skin."""
    tail, wing = patch((0, 0, 0), 12, 6), patch((40, 0, 0), 40, 20)
    whole, skin = cloud(tail, wing, patch((100, 0, 0), 12, 5), patch((100, 5, 0), 12, 1))
    template, taken = skin == 0, skin == 0
    skin = np.where(skin == 3, 1, skin)  # a strip beside another tail is of the wing's stretch
    covered = _covered(whole, skin, template, skin == 2, taken)
    assert np.array_equal(covered, whole.points[:, 0] >= 100)
    edge = skin == 2
    assert np.array_equal(_covered(whole, np.where(edge, 1, skin), template, edge, taken), edge)
