"""What of a scan is the structure: ground, clutter and neighbours that were put there are found again."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from random_members import random_member

from upplied.geometry.separation import CLASSES, Separation, separated, structure_alone
from upplied.records import Structure
from upplied.samples.fleet import member

_CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
_BOX = np.array([t for a, b, c, d in _SIDES for t in ((a, b, c), (a, c, d))])


@cache
def scanned(name: str, slope: float = 0.0) -> tuple[Structure, np.ndarray]:
    """A structure on ground, with a hut beside it and boxes in the air, and the class of each triangle."""
    of, rng = member(name).structure, np.random.default_rng(0)
    low, high, size = of.vertices.min(axis=0), of.vertices.max(axis=0), of.diagonal_m
    side = np.linspace(-1.0, 1.0, 100) * 0.9 * size
    x, y = np.meshgrid(side, side, indexing="ij")
    middle = np.array([*((low + high) / 2)[:2], low[2] - 0.3])
    ground = np.stack([x, y, slope * x], axis=-1).reshape(-1, 3) + middle
    at = np.arange(100 * 100).reshape(100, 100)
    halves = [(at[:-1, :-1], at[1:, :-1], at[1:, 1:]), (at[:-1, :-1], at[1:, 1:], at[:-1, 1:])]
    meshes = [(of.vertices, of.triangles, 0)]
    meshes.append((ground, np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves]), 1))
    hut = np.array([(low + high)[0] / 2, high[1] + 0.3 * size, low[2] - 0.2])
    meshes.append((hut + 0.05 * size * _CUBE, _BOX, 3))
    for _ in range(8):
        in_air = high + rng.uniform(0.05, 0.2, 3) * size
        meshes.append((in_air + 0.004 * size * _CUBE, _BOX, 2))
    first = np.cumsum([0, *(len(vertices) for vertices, _, _ in meshes)])
    vertices = np.vstack([vertices for vertices, _, _ in meshes])
    triangles = np.vstack([corner + at for (_, corner, _), at in zip(meshes, first[:-1], strict=True)])
    label = np.concatenate([np.full(len(corner), name) for _, corner, name in meshes])
    return replace(of, vertices=vertices + rng.normal(0, 0.03, vertices.shape), triangles=triangles), label


@cache
def found_in(name: str, slope: float = 0.0) -> Separation:
    """What is separated of the scan."""
    return separated(scanned(name, slope)[0])


def _area(of: Structure) -> np.ndarray:
    corners = of.vertices[of.triangles]
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


@pytest.mark.parametrize(
    ("name", "slope"),
    [("a320-v1", 0.0), ("turbine-1-v1", 0.02), ("bridge-1-v1", 0.02), ("cruise-v1", 0.02), ("cube-v1", 0.0)],
)
def test_ground_clutter_and_a_hut_are_told_from_the_structure(name: str, slope: float) -> None:
    scene, true = scanned(name, slope)
    parts = found_in(name, slope)
    confused = np.zeros((4, 4))
    np.add.at(confused, (true, parts.label), _area(scene))
    right = np.diag(confused) / confused.sum(axis=1)
    assert right[0] > 0.95 and right[1] > 0.99
    assert right[3] > 0.7  # but its floor, which lies on the ground
    assert confused[1:, 0].sum() < 0.01 * confused[0, 0]  # what is left is the structure
    of, slack = member(name).structure, 0.05 + slope * 0.2 * member(name).structure.diagonal_m
    assert parts.ground_z_m == pytest.approx(of.vertices[:, 2].min() - 0.3, abs=slack)


ALONE = ["a320-v1", "beluga-v1", "turbine-1-v1", "bridge-1-v1", "cruise-v1", "yacht-1-v1", "cube-v1", ""]


@pytest.mark.parametrize("name", ALONE)
def test_of_a_structure_alone_nothing_is_taken_away(name: str) -> None:
    of = member(name).structure if name else random_member("ship", 5).structure
    parts = separated(of)  # no deck, roof or belly is taken for ground
    assert not parts.texts and parts.ground_z_m is None and (parts.label == 0).all()


def test_a_cloud_is_separated_as_its_mesh_is() -> None:
    scene, _ = scanned("a320-v1")
    rng = np.random.default_rng(1)
    area = _area(scene)
    which = rng.choice(len(area), 200_000, p=area / area.sum())
    weight = rng.dirichlet([1, 1, 1], len(which))
    points = np.einsum("nk,nkj->nj", weight, scene.vertices[scene.triangles[which]])
    cloud = replace(scene, vertices=points, triangles=np.empty((0, 3), np.int64))
    of_cloud = separated(cloud)
    there = of_cloud.label
    assert (there == found_in("a320-v1").label[which]).mean() > 0.99
    vertices, triangles, normals = structure_alone(cloud, of_cloud)
    assert len(vertices) == (there == 0).sum() and not len(triangles) and normals is None


def test_what_is_kept_has_the_triangles_of_the_structure() -> None:
    scene, parts = scanned("bridge-1-v1", 0.02)[0], found_in("bridge-1-v1", 0.02)
    vertices, triangles, _ = structure_alone(scene, parts)
    assert np.array_equal(vertices[triangles], scene.vertices[scene.triangles[parts.label == 0]])
    assert len(CLASSES) == len(parts.area_m2) and parts.area_m2.sum() == pytest.approx(_area(scene).sum())
