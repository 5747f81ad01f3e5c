"""Fine samples where it matters: how many, where, for how much surface, and what they leave alone."""

from __future__ import annotations

import numpy as np
import pytest

from upplied.config import CloudSettings
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.pair import grained
from upplied.planning.surface.samples import FINE, beside, surface_samples, with_fine
from upplied.records import Cloud, Floats, Structure
from upplied.samples.fleet import member


def structure_and_cloud(name: str = "a320-v1") -> tuple[Structure, Cloud]:
    structure = member(name).structure
    return structure, surface_samples(structure, scene_of(structure), CloudSettings())


def one_part(cloud: Cloud, part: int) -> np.ndarray:
    assert cloud.part is not None
    return cloud.part == part


def off_surface(structure: Structure, points: Floats) -> float:
    return float(scene_of(structure).apart(points).max())


@pytest.mark.parametrize("part", [3, 5])
def test_a_part_has_enough_samples_however_small_it_is(part: int) -> None:
    structure, cloud = structure_and_cloud()
    zone = one_part(cloud, part)
    assert 0 < zone.sum() < FINE
    fine, even = with_fine(structure, scene_of(structure), cloud, zone)
    mine = zone[even]
    assert mine.sum() > 0.9 * FINE
    assert off_surface(structure, fine.points) < 1e-3
    area = cloud.areas[zone].sum()
    assert fine.areas[mine].sum() == pytest.approx(area, rel=0.1)
    # They face as the even samples beside them do, and no part is lost.
    assert ((fine.outward * cloud.outward[even]).sum(axis=1) > 0).mean() > 0.99
    assert fine.part is not None and set(fine.part) == set(cloud.part)  # type: ignore[arg-type]


def test_elsewhere_the_even_samples_stay() -> None:
    structure, cloud = structure_and_cloud()
    zone = one_part(cloud, 3)
    fine, even = with_fine(structure, scene_of(structure), cloud, zone)
    far = np.flatnonzero(~beside(cloud, zone))
    place = {tuple(point): row for row, point in enumerate(fine.points)}
    rows = [place[tuple(point)] for point in cloud.points[far]]
    assert np.array_equal(even[rows], far) and np.array_equal(fine.areas[rows], cloud.areas[far])


def test_what_has_enough_samples_or_means_nothing_stays_as_it_is() -> None:
    structure, cloud = structure_and_cloud()
    for zone in (np.zeros(len(cloud), bool), np.ones(len(cloud), bool)):
        fine, even = with_fine(structure, scene_of(structure), cloud, zone)
        assert fine is cloud and np.array_equal(even, np.arange(len(cloud)))


def test_the_same_seed_gives_the_same_samples_and_other_parts_another_key() -> None:
    structure, cloud = structure_and_cloud()
    zone, clouds = one_part(cloud, 3), CloudSettings()
    one, two = (grained(structure, cloud, zone, clouds) for _ in range(2))
    assert one.key == two.key and np.array_equal(one.cloud.points, two.cloud.points)
    whole = Cloud(cloud.points, cloud.normals, cloud.area_m2, np.zeros(len(cloud), np.int64))
    assert grained(structure, whole, zone, clouds).key != one.key


@pytest.mark.ci
def test_of_a_cloud_its_own_points_are_taken() -> None:
    structure, cloud = structure_and_cloud()
    rng = np.random.default_rng(0)
    many = surface_samples(structure, scene_of(structure), CloudSettings(surface_samples=30_000))
    order = rng.permutation(len(many))
    scan = Structure("scan", "airplane", many.points[order], np.empty((0, 3), np.int64), many.outward[order])
    even = surface_samples(scan, scene_of(scan), CloudSettings())
    zone = np.linalg.norm(even.points - cloud.points[one_part(cloud, 3)].mean(axis=0), axis=1) < 3.0
    fine, index = with_fine(scan, scene_of(scan), even, zone)
    assert zone[index].sum() > 2 * zone.sum()
    known = {tuple(point) for point in scan.vertices}
    assert all(tuple(point) in known for point in fine.points[zone[index]])
