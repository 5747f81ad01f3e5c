"""Nobody sees what lies under the ground or the water: nothing asks for it to be shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import CloudSettings, settings_for
from upplied.errors import RefusedError
from upplied.geometry.scene import scene_of
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.samples import surface_samples, with_fine
from upplied.planning.surface.skin import skin_study
from upplied.records import Structure, Surroundings
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CLOUDS = CloudSettings(surface_samples=1500)


def sunk(structure: Structure, depth_m: float, declared: bool = True) -> Structure:
    """The same, standing so deep in the ground at z = 0."""
    vertices = structure.vertices - [0, 0, structure.vertices[:, 2].min() + depth_m]
    return replace(
        structure, vertices=vertices, surroundings=Surroundings(0.0 if declared else None), sha256=""
    )


@pytest.fixture(scope="module")
def cube() -> Structure:
    return member("cube-v1").structure


def test_samples_lie_above_the_declared_ground(cube: Structure) -> None:
    side = float(np.ptp(cube.vertices[:, 2]))
    there = sunk(cube, side / 2)
    cloud = surface_samples(there, scene_of(there), CLOUDS)
    assert cloud.points[:, 2].min() > -0.1
    assert cloud.areas.sum() == pytest.approx(side**2 + 4 * side * (side / 2 + 0.1), rel=0.05)
    zone = cloud.points[:, 2] < 0.2 * side
    fine, _ = with_fine(there, scene_of(there), cloud, zone)
    assert len(fine) > len(cloud) and fine.points[:, 2].min() > -0.1
    assert skin_study(there, scene_of(there), cloud).of(cloud).shape[-1] == len(cloud)


def test_ground_that_is_not_declared_hides_nothing(cube: Structure) -> None:
    side = float(np.ptp(cube.vertices[:, 2]))
    there = sunk(cube, side / 2, declared=False)
    assert surface_samples(there, scene_of(there), CLOUDS).points[:, 2].min() < -0.4 * side


def test_a_millimetre_at_the_ground_hides_nothing(cube: Structure) -> None:
    clouds = [surface_samples(one, scene_of(one), CLOUDS) for one in (sunk(cube, 0.0), sunk(cube, 0.05))]
    assert len(clouds[0]) == len(clouds[1])


@pytest.mark.parametrize("normals", [True, False])
def test_points_of_a_cloud_lie_above_it_too(cube: Structure, normals: bool) -> None:
    side = float(np.ptp(cube.vertices[:, 2]))
    there = sunk(cube, side / 2, declared=False)
    dense = surface_samples(there, scene_of(there), CloudSettings(surface_samples=4000))
    scan = replace(
        sunk(cube, side / 2),
        vertices=dense.points,
        triangles=np.empty((0, 3), np.int64),
        normals=dense.outward if normals else None,
    )
    cloud = surface_samples(scan, scene_of(scan), CLOUDS)
    assert len(cloud) > 100 and cloud.points[:, 2].min() > -0.1
    fine, _ = with_fine(scan, scene_of(scan), cloud, cloud.points[:, 2] < 0.3 * side)
    assert fine.points[:, 2].min() > -0.1


def test_what_lies_under_the_ground_is_not_asked_for(cube: Structure) -> None:
    """A cube with a cellar as deep as itself shows all of its walls."""
    deep = member("cuboid-v1").structure
    height = float(np.ptp(deep.vertices[:, 2]))
    low = deep.vertices[:, 2] == deep.vertices[:, 2].min()
    vertices = deep.vertices - np.where(low[:, None], [0, 0, height], 0.0)
    with_cellar = replace(deep, vertices=vertices, sha256="")
    assert with_cellar.surroundings.ground_z_m is not None
    flight, settings = fly(cube, "sides"), settings_for("recommended")
    alone, plan = (plan_transfer(flight, cube, one, settings) for one in (deep, with_cellar))
    assert alone.status == plan.status == "ok" and plan.surface is not None
    assert plan.surface.points[:, 2].min() > deep.vertices[:, 2].min() - 0.1
    shown = [one.measures.coverage_inspected_pct for one in (alone, plan)]
    assert shown[1] == pytest.approx(shown[0], abs=1.0)


def test_a_structure_under_the_ground_is_refused_with_the_reason(cube: Structure) -> None:
    there = sunk(cube, 1000.0)
    with pytest.raises(RefusedError, match=r"all of it lies under its ground_z .*Check ground_z"):
        surface_samples(there, scene_of(there), CLOUDS)
    plan = plan_transfer(fly(cube, "sides"), cube, there, settings_for("recommended"))
    assert plan.status == "refused" and "ground_z" in plan.reason
