"""Laws of the drift: rest where nothing moved, no creeping, parts kept apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import slow_after

from upplied.planning.correspondence.coherent_point_drift import Patch, _kernel, drift, farthest_points

FIELDS = ("points", "normals", "label")


def sphere(number: int = 250, radius: float = 5.0) -> Patch:
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(number)
    height = np.linspace(-1, 1, number) * (1 - 1 / number)
    ring = np.sqrt(1 - height**2)
    unit = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])
    return Patch(radius * unit, unit, np.full(number, -1))


def moved(patch: Patch, shift: list[float]) -> Patch:
    return Patch(patch.points + np.array(shift), patch.normals, patch.label)


def test_at_rest_where_nothing_moved() -> None:
    patch = sphere()
    field = drift(patch, patch, 17.0)
    assert np.abs(field.at(patch.points, patch.label)).max() < 0.02 * 5


def test_a_shift_is_followed() -> None:
    patch = sphere()
    field = drift(patch, moved(patch, [0.5, 0, 0]), 17.0)
    there = patch.points + field.at(patch.points, patch.label)
    off = np.abs(np.linalg.norm(there - [0.5, 0, 0], axis=1) - 5)
    assert np.mean(off) < 0.05  # on the moved sphere, from 0.25 m off on average
    assert (field.at(patch.points[np.abs(patch.points[:, 0]) > 4], np.full(1, -1))[:, 0] > 0.3).all()


def test_featureless_skin_does_not_creep() -> None:
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.random((400, 2)) * 10, np.zeros(400)])
    normals = np.tile([0.0, 0, 1], (400, 1))
    moving = Patch(flat[:200], normals[:200], np.full(200, -1))
    fixed = Patch(flat[200:], normals[200:], np.full(200, -1))
    creep = drift(moving, fixed, 14.0).at(flat, np.full(400, -1))
    assert np.abs(creep).max() < 1e-6


def test_parts_pull_only_their_partner() -> None:
    patch = replace(sphere(), label=np.zeros(250, int))
    partner, nearer = moved(patch, [0, 0.6, 0]), replace(moved(patch, [0, -0.1, 0]), label=np.ones(250, int))
    both = Patch(*(np.concatenate([getattr(p, n) for p in (partner, nearer)]) for n in FIELDS))
    alone = drift(patch, partner, 17.0).at(patch.points, patch.label)
    np.testing.assert_allclose(drift(patch, both, 17.0).at(patch.points, patch.label), alone, atol=1e-9)


def test_opposite_skins_do_not_pull() -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.random((200, 2)) * 10, np.zeros(200)])
    up = np.tile([0.0, 0, 1], (200, 1))
    moving = Patch(flat, up, np.full(200, -1))
    both = Patch(
        np.concatenate([flat + np.array([0, 0, 0.4]), flat - np.array([0, 0, 0.2])]),
        np.concatenate([up, -up]),
        np.full(400, -1),
    )
    lifted = drift(moving, both, 14.0).at(flat, moving.label)[:, 2]
    assert lifted.mean() == pytest.approx(0.4, abs=0.05)


def test_farthest_points_are_those_of_brute_force() -> None:
    points = np.random.default_rng(2).normal(size=(120, 3))
    chosen = [int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    while len(chosen) < 30:
        gaps = ((points[:, None] - points[None, chosen]) ** 2).sum(axis=2).min(axis=1)
        chosen.append(int(gaps.argmax()))
    assert farthest_points(points, 30).tolist() == chosen
    assert sorted(farthest_points(points, 500).tolist()) == list(range(120))


def test_a_displacement_is_felt_in_its_own_part_alone():
    """What moves an engine moves the engine's other points and not the wing beside it."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    label = np.array([0, 0, 1])
    felt = _kernel(points, label, points[:1], label[:1], 2.0)
    own = np.exp(-1 / 8)
    assert felt[:, 0] == pytest.approx([1, own, 0])


@pytest.mark.ci
@pytest.mark.parametrize("labelled", slow_after(1, [False, True]))
def test_a_displacement_is_that_of_the_plain_system(labelled: bool) -> None:
    """All unknowns at once, one equation for each coordinate of each control point, and no modes."""
    rng = np.random.default_rng(1)
    one, other = sphere(90), sphere(160, 5.4)
    stretch = np.array([1.0, 1.2, 0.8])
    moving = replace(one, label=np.where(labelled & (one.points[:, 0] > 0), 0, -1))
    fixed = Patch(other.points * stretch + [0.3, 0, 0.2], other.normals, rng.integers(0, 2, 160) - 1)
    size, number = 17.0, len(moving)
    kernel = _kernel(moving.points, moving.label, moving.points, moving.label, 0.12 * size)
    stiffness = np.where(moving.label >= 0, 3.0, 0.5)
    here, weights = moving.points, np.zeros((number, 3))
    for width in np.geomspace(0.04, 0.006, 16) * size:
        share = np.zeros((number, len(fixed)))
        for m in range(number):
            for n in range(len(fixed)):
                if moving.label[m] in (-1, fixed.label[n]):
                    apart = np.sum((here[m] - fixed.points[n]) ** 2)
                    alike = moving.normals[m] @ fixed.normals[n]
                    share[m, n] = np.exp(4 * (alike - 1) - apart / (2 * width**2))
        share /= share.sum(axis=0) + 1e-3
        system, pulls = np.zeros((3 * number, 3 * number)), np.zeros((number, 3))
        for m in range(number):
            metric = np.einsum("n,ni,nj->ij", share[m], fixed.normals, fixed.normals)
            pull = np.einsum("n,ni,nj,nj->i", share[m], fixed.normals, fixed.normals, fixed.points)
            pulls[m] = pull - metric @ moving.points[m]
            system[3 * m : 3 * m + 3] = np.kron(kernel[m], metric)
            system[3 * m : 3 * m + 3, 3 * m : 3 * m + 3] += stiffness[m] * np.eye(3)
        weights = np.linalg.solve(system, pulls.reshape(-1)).reshape(number, 3)
        here = moving.points + kernel @ weights
    actual = drift(moving, fixed, size).at(moving.points, moving.label)
    largest = np.linalg.norm(kernel @ weights, axis=1).max()
    assert largest > 0.3
    assert np.linalg.norm(actual - kernel @ weights, axis=1).max() < 0.005 * largest
