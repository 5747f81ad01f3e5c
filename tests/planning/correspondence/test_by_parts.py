"""Each step from laid parts to counterparts, against its definition one point at a time."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.planning.correspondence.coherent_point_drift import Patch
from upplied.planning.correspondence.correspondences import (
    _claimed,
    _continues,
    _off,
    _on_adjacent_parts,
    _on_skin,
    _smooth_field,
    _without,
    carried_by,
    facing_nearest,
)
from upplied.planning.correspondence.part_assignment import Matching
from upplied.planning.surface.parts import Parts
from upplied.records import Bools, Cloud, Displacement, Floats, Ints

DIAGONAL, FACING = 20.0, 0.03 * 20.0


def patch(number: int, seed: int, labels: list[int]) -> Patch:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(number, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Patch(rng.uniform(0, 10, (number, 3)), normals, rng.choice(labels, number))


def parts(touching: Bools, body: Bools | None = None) -> Parts:
    number = len(touching)
    zeros = np.zeros((number, 3))
    stands = np.ones(number, bool) if body is None else body
    area, none = np.full(number, 1 / number), np.zeros(number, bool)
    return Parts(zeros, zeros + 1, area, touching, zeros + 1, stands, zeros[:, :2], none)


def apart(one: Patch, here: int, other: Patch, there: int) -> float:
    """How far a point is from another, a right angle between their normals counting as a length."""
    shift = one.points[here] - other.points[there]
    turn = FACING * (one.normals[here] - other.normals[there])
    return float(np.sqrt(shift @ shift + turn @ turn))


def cosines(warped: Patch, fixed: Patch, index: Ints) -> Floats:
    return np.array([a @ b for a, b in zip(warped.normals, fixed.normals[index], strict=True)])


def test_the_nearest_of_the_partner_part_that_faces_the_same_way() -> None:
    warped, fixed = patch(60, 0, [-1, 0, 1]), patch(80, 1, [-1, 0, 1])
    partners = facing_nearest(warped, fixed, DIAGONAL)
    for here, there in enumerate(partners):
        own = warped.label[here]
        theirs = [at for at in range(80) if own < 0 or fixed.label[at] == own]
        assert there == min(theirs, key=lambda at: apart(warped, here, fixed, at))


def test_distance_from_a_skin_is_along_its_normal() -> None:
    grid = np.array([[x, y, 0.0] for x in range(4) for y in range(4)])
    plane = Patch(grid, np.tile([0.0, 0, 1], (16, 1)), np.zeros(16, int))
    off = np.array([[0.3, 0.2, 1.0], [2.4, 1, -3]])
    assert _off(Patch(off, np.tile([0.0, 0, 1], (2, 1)), np.zeros(2, int)), plane, DIAGONAL) == pytest.approx(
        2
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_face_of_an_adjacent_part_is_taken_where_the_partner_has_none_like_it(seed: int) -> None:
    warped, fixed = patch(150, 2 + seed, [-1, 0, 1, 2]), patch(200, 9 + seed, [-1, 0, 1, 2])
    part = np.where(fixed.label >= 0, fixed.label, np.random.default_rng(seed).integers(3, 5, 200))
    touching = np.zeros((5, 5), bool)
    touching[0, 3] = touching[3, 0] = touching[0, 1] = touching[1, 0] = touching[1, 4] = touching[4, 1] = True
    index = np.random.default_rng(seed).permuted(facing_nearest(warped, fixed, DIAGONAL))
    own = np.array([np.flatnonzero(fixed.label == label)[0] if label >= 0 else 0 for label in warped.label])
    index = np.where(fixed.label[index] == warped.label, index, own)
    partners = _on_adjacent_parts(warped, fixed, index, part, parts(touching), DIAGONAL)
    adjacent = {-1: [], 0: [3, 1], 1: [0, 4], 2: []}
    moved = 0
    for here in range(150):
        label, before = int(warped.label[here]), int(index[here])
        theirs = [at for at in range(200) if part[at] in adjacent[label] and fixed.label[at] != label]
        best = min(theirs, key=lambda at: apart(warped, here, fixed, at), default=-1)
        faces_away = cosines(warped, fixed, index)[here] < 0.7
        nearer = best >= 0 and apart(warped, here, fixed, best) < 0.5 * apart(warped, here, fixed, before)
        assert partners[here] == (best if faces_away and nearer else before)
        moved += bool(faces_away and nearer)
    assert 10 < moved < 120


def test_a_target_sample_is_taken_within_two_spacings_of_a_matched_part() -> None:
    fixed, on_skin = patch(80, 3, [-1, 0, 1]), patch(40, 4, [0]).points
    label = np.repeat([-1, 0, 1, 2], 10)
    claimed = _claimed(on_skin, label, fixed, 1.5)
    for at in range(80):
        near = [
            np.linalg.norm(on_skin[of] - fixed.points[at]) for of in np.flatnonzero(label == fixed.label[at])
        ]
        assert claimed[at] == (fixed.label[at] >= 0 and min(near) < 2 * 1.5)
    assert 0 < claimed[fixed.label == 0].sum() < (fixed.label == 0).sum() and claimed[fixed.label == 1].any()


def test_what_continues_a_skin_is_no_part_of_its_own() -> None:
    touching = np.zeros((4, 4), bool)
    touching[3, [0, 1]] = touching[[0, 1], 3] = touching[2, 0] = touching[0, 2] = touching[3, 2] = True
    known = parts(touching, np.array([True, True, True, False]))
    continues = _continues(known, Matching(np.array([1, 0, -1, -1]), np.array([0, 1])))
    assert continues.tolist() == [[False, False], [False, False], [False, False], [True, True]]
    none = _continues(known, Matching(np.full(4, -1), np.full(2, -1)))
    assert none.shape == (4, 1) and not none.any()


@pytest.mark.parametrize("seed", range(3))
def test_without_counterpart_is_what_lies_far_off_and_parts_of_which_most_finds_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fixed = patch(300, 20 + seed, [0])
    index = rng.integers(0, 300, 120)
    far = rng.choice([0.2, 0.45, 0.8, 1.2], 120)[:, None]
    way = rng.normal(size=(120, 3))
    points = fixed.points[index] + far * way / np.linalg.norm(way, axis=1, keepdims=True)
    tilted = fixed.normals[index] + rng.choice([0.0, 1.5], (120, 1)) * rng.normal(size=(120, 3))
    normals = tilted / np.linalg.norm(tilted, axis=1, keepdims=True)
    part = np.repeat(np.arange(8), 15)  # odd: no share is half
    warped = Patch(points, normals, rng.choice([-1, 0], 120, p=[0.8, 0.2]))
    taken = rng.random(120) < 0.1
    source = Cloud(points, normals, np.ones(120), part)
    without = _without(warped, fixed, index, taken, source, DIAGONAL)
    distance, cosine = np.linalg.norm(points - fixed.points[index], axis=1), cosines(warped, fixed, index)
    good = [cosine[at] > 0.3 and distance[at] < 0.5 and not taken[at] for at in range(120)]
    for at in range(120):
        share = np.mean([good[of] for of in range(120) if part[of] == part[at]])
        assert without[at] == (warped.label[at] < 0 and (distance[at] > 1.0 or share < 0.5))
    assert 0.2 < without.mean() < 0.9


def test_on_the_skin_no_farther_than_a_spacing_from_a_sample() -> None:
    fixed = Patch(np.array([[1.0, 1, 1]]), np.array([[0.0, 0, 1]]), np.zeros(1, int))
    points = np.array([[4.0, 5, 3], [1, 1, 9]])
    index = np.zeros(2, int)
    np.testing.assert_allclose(_on_skin(points, fixed, index, 2.5), [[2.5, 3, 1], [1, 1, 1]], atol=1e-12)
    np.testing.assert_allclose(_on_skin(points, fixed, index, 50), [[4, 5, 1], [1, 1, 1]], atol=1e-12)


def ball(middle: list[float], radius: float, number: int) -> tuple[Floats, Floats]:
    turn = np.pi * (1 + np.sqrt(5)) * (np.arange(number) + 0.5)
    height = 1 - (2 * np.arange(number) + 1) / number
    ring = np.sqrt(1 - height**2)
    unit = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    return np.array(middle) + radius * unit, unit


def test_a_part_moves_only_where_that_brings_it_clearly_nearer() -> None:
    there = [ball([0, 0, 0], 3, 700), ball([14, 0, 0], 2, 650)]
    here = [there[0], ball([14.5, 0, 0], 2, 650)]
    label = np.repeat([0, 1], [700, 650])
    placed, fixed = (Patch(*(np.concatenate(of) for of in zip(*side, strict=True)), label)
                     for side in (here, there))  # fmt: skip
    order = np.random.default_rng(0).permutation(len(label))  # every beginning is spread evenly
    placed, fixed, label = placed.rows(order), fixed.rows(order), label[order]
    field, smooth = _smooth_field(placed, fixed, DIAGONAL)
    same = np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3))
    control = field.control
    carrier = Displacement(
        *same, smooth, control.points, control.label, field.weights, field.reach_m, np.ones(2)
    )
    carried = carried_by(carrier, placed)
    np.testing.assert_allclose(carried.points[label == 0], placed.points[label == 0], atol=1e-6)
    off = np.abs(np.linalg.norm(carried.points[label == 1] - [14.0, 0, 0], axis=1) - 2)
    before = np.abs(np.linalg.norm(placed.points[label == 1] - [14.0, 0, 0], axis=1) - 2)
    assert off.mean() < 0.3 * before.mean()
    np.testing.assert_allclose(carried.normals, placed.normals)
    assert np.array_equal(carried.label, label)
