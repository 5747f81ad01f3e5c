"""Parts of a surface of one piece: names, contacts and shapes on made patches."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.planning.correspondence.coherent_point_drift import Patch, farthest_points, spread_over
from upplied.planning.correspondence.correspondences import by_parts, facing_nearest
from upplied.planning.correspondence.label_transfer import (
    carried,
    has_parts,
    parts_like,
)
from upplied.planning.surface.parts import pieces_tell_parts
from upplied.records import Cloud, Floats, Ints, Registration

Box = tuple[list[float], list[float]]
SAME = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)


def box(low: list[float], size: list[float], step: float) -> tuple[Floats, Floats]:
    points, normals = [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        steps = [np.arange(step / 2, size[other], step) for other in others]
        for end in (0, 1):
            grid = np.array(np.meshgrid(*steps)).reshape(2, -1).T
            at = np.zeros((len(grid), 3))
            at[:, axis], at[:, others] = end * size[axis], grid
            points.append(np.array(low) + at)
            normals.append(np.tile(np.eye(3)[axis] * (2 * end - 1), (len(grid), 1)))
    return np.concatenate(points), np.concatenate(normals)


def cloud(*boxes: Box, step: float = 1.0, labelled: bool = True) -> tuple[Cloud, Ints]:
    surfaces = [box(*each, step) for each in boxes]
    label = np.repeat(np.arange(len(surfaces)), [len(points) for points, _ in surfaces])
    points, normals = (np.concatenate(of) for of in zip(*surfaces, strict=True))
    return Cloud(points, normals, np.full(len(points), step**2), label if labelled else None), label


BODY: Box = ([0, -4, 0], [60, 8, 6])
LEFT: Box = ([30, 6, 1], [8, 5, 4])
RIGHT: Box = ([30, -11, 1], [8, 5, 4])


def test_what_is_nearest_after_the_displacement_gives_the_name() -> None:
    known, label = cloud(BODY, LEFT, RIGHT)
    whole, _ = cloud(BODY, LEFT, RIGHT, labelled=False)
    assert has_parts(known) and not has_parts(whole)
    assert not has_parts(Cloud(known.points, part=np.zeros(len(known), int)))
    assert (carried(whole, known) == label).mean() > 0.99


def test_what_nothing_comes_near_has_no_name() -> None:
    known, label = cloud(BODY, LEFT, RIGHT)
    whole, there = cloud(BODY, LEFT, RIGHT, ([10, 30, 1], [8, 5, 4]), labelled=False)
    names = carried(whole, known)
    assert (names[there == 3] == -1).mean() > 0.9
    assert (names[there < 3] == label).mean() > 0.95


def test_pieces_that_lie_apart_tell_no_parts() -> None:
    """A scan of which the middle is missing is two pieces, which say no more of its parts than one."""
    assert pieces_tell_parts(cloud(BODY, ([30, 4, 1], [8, 5, 4]), ([30, -9, 1], [8, 5, 4]))[0])
    assert not pieces_tell_parts(cloud(BODY)[0])
    assert not pieces_tell_parts(cloud(([0, -4, 0], [25, 8, 6]), ([35, -4, 0], [25, 8, 6]))[0])
    pod, other = ([30, 4, 1], [2, 1, 2]), ([30, 60, 1], [60, 8, 6])
    assert pieces_tell_parts(cloud(BODY, pod, other)[0])  # more than two fifths touch
    assert not pieces_tell_parts(cloud(BODY, pod, other, ([30, 90, 1], [60, 8, 6]))[0])


def test_stretches_are_named_and_parted() -> None:
    known, label = cloud(BODY, LEFT, RIGHT)
    whole, skin = cloud(([0, -4, 0], [60, 8, 6]), ([29, 6.4, 1.2], [8, 5, 4]), ([29, -11.4, 1.2], [8, 5, 4]),
                        labelled=False)  # fmt: skip
    labels = parts_like(whole, skin, known)
    assert np.array_equal(labels, label)


def test_another_of_a_kind_is_a_part_wherever_it_lies() -> None:
    known, _ = cloud(BODY, LEFT, RIGHT)
    outer: Box = ([10, 25, 1], [8, 5, 4])
    whole, skin = cloud(BODY, LEFT, RIGHT, outer, labelled=False)
    labels = parts_like(whole, skin, known)
    assert len(set(labels[skin == 3].tolist())) == 1
    assert not np.isin(labels[skin == 3][0], labels[skin != 3])


def test_crumbs_in_the_air_are_one_part_that_answers_to_none() -> None:
    known, label = cloud(BODY, LEFT, RIGHT)
    whole, skin = cloud(BODY, LEFT, RIGHT, labelled=False)
    ghosts = np.array([[5.0, 30, 20], [5.5, 30, 20], [50, -30, 9]])
    assert whole.normals is not None and whole.area_m2 is not None
    dirty = Cloud(
        np.vstack([whole.points, ghosts]),
        np.vstack([whole.normals, whole.normals[:3]]),
        np.append(whole.area_m2, [1, 1, 1]),
    )
    labels = parts_like(dirty, np.append(skin, [3, 3, 4]), known)
    assert np.array_equal(labels[:-3], label) and (labels[-3:] == label.max() + 1).all()


def test_each_point_finds_a_sample_of_its_class_that_faces_alike() -> None:
    up, down = [0.0, 0, 1], [0.0, 0, -1]
    places = np.array([[0.0, 0, 0], [0, 0, 1], [5, 0, 0], [0, 0.4, 0]])
    fixed = Patch(places, np.array([up, down, up, up]), np.array([0, 0, 0, 1]))
    near = np.array([[0.0, 0, 0.6], [0, 0, 0.6], [0, 0.3, 0], [0, 0.3, 0]])
    patch = Patch(near, np.array([up, down, up, up]), np.array([0, 0, 0, -1]))
    assert facing_nearest(patch, fixed, 100.0).tolist() == [0, 1, 0, 3]
    assert facing_nearest(patch, fixed, 1e-6).tolist() == [1, 1, 0, 3]


def test_points_that_lie_far_from_each_other() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(60, 3)) * [4, 2, 1]
    known = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    while len(known) < 20:
        known.append(int(np.linalg.norm(points[:, None] - points[known], axis=2).min(axis=1).argmax()))
    assert farthest_points(points, 20).tolist() == known
    assert sorted(farthest_points(points, 99)) == list(range(60))
    whole = Cloud(points)
    assert spread_over(whole, 5).tolist() == known[:5]
    assert spread_over(whole, 20).tolist() == known and spread_over(whole, 8).tolist() == known[:8]
    assert len(spread_over(whole, 99)) == 60


def test_a_structure_answers_to_itself_sample_by_sample() -> None:
    here, _ = cloud(BODY, LEFT, RIGHT)
    correspondences = by_parts(here, here, SAME)
    off = np.linalg.norm(correspondences.target_points - here.points, axis=1)
    assert (correspondences.target_index == np.arange(len(here))).mean() > 0.97 and off.max() < 0.5
    assert correspondences.distance_m == pytest.approx(off, abs=1e-9)
    assert correspondences.source_class is not None and [
        correspondences.target_parts(part).tolist() for part in range(3)
    ] == [
        [0],
        [1],
        [2],
    ]
    assert correspondences.summary.startswith("3 of 3 parts matched one to one")


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_engines_elsewhere_are_followed_and_what_is_gone_is_none(degrees: float) -> None:
    here, label = cloud(BODY, LEFT, RIGHT, ([50, -1, 6], [4, 2, 9]))
    turn = Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
    there, _ = cloud(BODY, ([25, 8, 1], [8, 5, 4]), ([25, -13, 1], [8, 5, 4]))
    assert there.normals is not None
    turned = Cloud(there.points @ turn, there.normals @ turn, there.area_m2, there.part)
    correspondences = by_parts(
        here, turned, Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True, turn=turn)
    )
    laid = correspondences.target_points @ turn.T
    for part, shift in ((1, [-5.0, 2, 0]), (2, [-5.0, -2, 0])):
        assert np.linalg.norm(laid[label == part] - here.points[label == part] - shift, axis=1).max() < 0.6
    fin = label == 3
    assert (correspondences.target_index[fin] == -1).mean() > 0.8
    assert np.isnan(correspondences.distance_m[fin]).mean() > 0.8 and np.isnan(laid[fin, 0]).mean() > 0.8
    assert "no counterpart on the target: part_3 (front high" in correspondences.summary
    assert (correspondences.target_index[label == 0] >= 0).all()


def test_a_pin_sends_a_part_where_it_is_meant() -> None:
    here, label = cloud(BODY, LEFT, RIGHT)
    correspondences = by_parts(here, here, SAME, {1: 2})
    assert (label[correspondences.target_index[label == 1]] == 2).all()
