"""A rotor that stopped elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_structures import one_piece
from remembered import study_pair
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.part_alignment import _hub, _in_box_of, rotor_turned
from upplied.planning.surface.parts import blades_of
from upplied.records import Cloud, Structure
from upplied.samples.fleet import member


def stopped(degrees: float) -> tuple[Structure, np.ndarray]:
    """Turbine 2 with its rotor turned, and which of its triangles are of blades."""
    of = member("turbine-2-v1")
    blade = np.isin(of.part_of_triangle, [at for at, name in enumerate(of.part_names) if "blade" in name])
    vertices = of.structure.vertices.copy()
    hub = vertices[np.unique(of.structure.triangles[of.triangles_of("hub")])]
    middle, angle = (hub.min(axis=0) + hub.max(axis=0)) / 2, np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    moving = np.unique(of.structure.triangles[blade])
    vertices[moving] = (vertices[moving] - middle) @ turn.T + middle
    return replace(of.structure, vertices=vertices, sha256=""), blade


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.0, 40.0])
def test_blades_of_a_scan_are_found_wherever_the_rotor_stopped(degrees: float) -> None:
    target, blade = stopped(degrees)
    fit = study_pair(member("turbine-1-v1").structure, one_piece(target), settings_for("recommended")).surface
    true = blade[scene_of(target, 1).closest(fit.target.points)[1]]
    blades = blades_of(fit.target)
    assert (blades & true).sum() > 0.9 * (blades | true).sum()
    assert fit.registration.accepted


def test_the_hub_is_amid_the_blades_and_its_axis_across_them_all() -> None:
    """Three blades in a tilted plane, one of them with more samples than the others."""
    tilt = Rotation.from_euler("yz", [20, 35], degrees=True).as_matrix()
    turn = np.radians(np.repeat([10.0, 130, 250], [40, 40, 90]))
    along = np.concatenate([np.linspace(1, 9, 40), np.linspace(1, 9, 40), np.linspace(1, 9, 90)])
    flat = np.column_stack([0 * turn, np.cos(turn) * along, np.sin(turn) * along])
    middle, axis = _hub(flat @ tilt.T + [5.0, 6, 7], np.repeat([4, 2, 9], [40, 40, 90]))
    assert middle == pytest.approx(np.array([5.0, 6, 7]))
    assert abs(axis @ tilt[:, 0]) == pytest.approx(1)


def test_a_cloud_is_laid_with_its_box_on_anothers() -> None:
    rng = np.random.default_rng(0)
    cloud = Cloud(rng.uniform(0, 1, (50, 3)), np.tile([0.6, 0.0, 0.8], (50, 1)))
    other = rng.uniform(0, 1, (60, 3)) * [8.0, 2, 4] + [1.0, 2, 3]
    laid = _in_box_of(cloud, other)
    for of in (np.min, np.max):
        np.testing.assert_allclose(of(laid.points, axis=0), of(other, axis=0))
    scale = np.ptp(other, axis=0) / np.ptp(cloud.points, axis=0)
    normal = np.array([0.6, 0, 0.8]) / scale
    assert laid.normals is not None
    np.testing.assert_allclose(laid.normals, np.tile(normal / np.linalg.norm(normal), (50, 1)))


def mill(degrees: float) -> tuple[Cloud, np.ndarray]:
    """A tower and three blades before it, as parts, and which samples are of blades."""
    rng = np.random.default_rng(1)
    samples = [(rng.uniform([-1, -1, 0], [1, 1, 30], (900, 3)), 0)]
    for blade in range(3):
        angle = np.radians(degrees + 120 * blade)
        own = rng.uniform([-0.2, -0.5, 1], [0.2, 0.5, 15], (200, 3))
        turn = Rotation.from_rotvec([angle, 0, 0])
        samples.append((turn.apply(own) + np.array([2.0, 0, 30]), blade + 1))
    points = np.concatenate([each for each, _ in samples])
    label = np.concatenate([np.full(len(each), part) for each, part in samples])
    normals = np.tile([1.0, 0, 0], (len(points), 1))
    return Cloud(points, normals, np.ones(len(points)), label), label > 0


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0, 112.5])
def test_the_turn_that_lies_best_is_found_in_steps(degrees: float) -> None:
    known, blade = mill(0.0)
    there, _ = mill(degrees)
    turned = rotor_turned(known, Cloud(there.points))
    np.testing.assert_allclose(np.ptp(turned.points, axis=0), np.ptp(there.points, axis=0))
    before = cKDTree(there.points).query(known.points[blade])[0].mean()
    after = cKDTree(there.points).query(turned.points[blade])[0].mean()
    assert after < 0.7 and (degrees in (0.0,) or after < 0.5 * before)
    tower = ~blade
    assert np.abs(turned.points[tower] - known.points[tower]).max() < 3


def test_what_has_no_blades_or_no_normals_comes_back_as_it_is() -> None:
    known, blade = mill(0.0)
    tower = Cloud(known.points[~blade], known.normals[~blade], known.area_m2[~blade])  # type: ignore[index]
    assert rotor_turned(tower, known) is tower
    bare = replace(known, normals=None)
    assert rotor_turned(bare, known) is bare
