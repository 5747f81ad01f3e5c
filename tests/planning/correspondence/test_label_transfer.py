"""Parts of a surface of one piece, told by a structure of the same kind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.label_transfer import fragments, has_parts, parts_like
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.geometry.clouds import in_source_frame
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.records import Cloud, Structure
from upplied.samples.fleet import member

CLOUDS = settings_for("recommended").clouds


@cache
def surface(structure_id: str) -> Cloud:
    structure = member(structure_id).structure
    return surface_samples(structure, scene_of(structure, 1), CLOUDS)


def scanned(structure_id: str) -> tuple[Structure, Cloud]:
    """A structure as a cloud of points, 2 cm off, and its samples."""
    of = surface(structure_id)
    rng = np.random.default_rng(0)
    points = of.points + rng.normal(0, 0.02, of.points.shape)
    return replace(member(structure_id).structure, vertices=points, triangles=np.empty((0, 3), np.int64),
                   normals=of.normals, sha256=""), replace(of, points=points, part=None)  # fmt: skip


def agreement(labels: np.ndarray, true: np.ndarray, least: float) -> float:
    """The least overlap of a true part of at least a share of the samples with the part found there."""
    worst = 1.0
    for part in np.flatnonzero(np.bincount(true) > least * len(true)):
        mine = true == part
        best = np.bincount(labels[mine]).argmax()
        worst = min(worst, float((mine & (labels == best)).sum() / (mine | (labels == best)).sum()))
    return worst


@pytest.mark.parametrize(
    ("known", "target", "least"),
    [("turbine-1-v1", "turbine-2-v1", 0.05), ("bridge-1-v1", "bridge-2-v1", 0.06)],
)
def test_parts_of_a_cloud_are_those_of_the_model(known: str, target: str, least: float) -> None:
    structure, cloud = scanned(target)
    assert not has_parts(cloud)
    skin = skin_parts(structure, scene_of(structure, 1), cloud).label
    registered = in_source_frame(cloud, box_on_box(surface(known), cloud))
    labels = parts_like(registered, skin, surface(known))
    true = surface(target).part
    assert true is not None
    assert agreement(labels, true, least) > 0.7


def test_what_floats_about_a_scan_is_no_part_of_its_parts() -> None:
    structure, cloud = scanned("turbine-2-v1")
    assert cloud.normals is not None and cloud.area_m2 is not None
    skin = skin_parts(structure, scene_of(structure, 1), cloud).label
    near = cloud.points[::400] + np.array([3.0, 4.0, 0.0])  # ten ghosts
    dirty = Cloud(
        np.vstack([cloud.points, near]),
        np.vstack([cloud.normals, cloud.normals[::400]]),
        np.concatenate([cloud.area_m2, cloud.area_m2[::400]]),
    )
    registered = in_source_frame(dirty, box_on_box(surface("turbine-1-v1"), cloud))
    labels = parts_like(registered, np.concatenate([skin, skin[::400]]), surface("turbine-1-v1"))
    true = surface("turbine-2-v1").part
    assert true is not None and agreement(labels[: len(cloud)], true, 0.05) > 0.7
    assert (labels[len(cloud) :] == labels.max()).mean() > 0.8
    assert not (labels[: len(cloud)] == labels.max()).mean() > 0.02


def test_fragments_in_the_air_are_counted_() -> None:
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(0, 20, (2000, 2)), np.zeros(2000)])
    birds = np.array([[2.0, 3, 8], [2.1, 3, 8], [15, 15, 9]])
    points = np.concatenate([ground, birds])
    up, area = np.tile([0.0, 0, 1], (len(points), 1)), np.full(len(points), 0.2)
    assert fragments(Cloud(points, up, area)) == 2
    assert fragments(Cloud(ground, up[:2000], area[:2000])) == 0
