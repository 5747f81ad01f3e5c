"""A drawn mesh is as exact as it is smooth; one that was declared a scan keeps the error that it states."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import slow_after
from random_members import random_member
from scipy.spatial.transform import Rotation

from upplied.geometry import reconstruction
from upplied.geometry.scene import Scene, open3d, scene_of
from upplied.inputs.manifests import StructureEntry
from upplied.inputs.meshes import read_structure
from upplied.records import Structure
from upplied.samples.fleet import sample_structures

DRAWN = [*sample_structures()] + [
    random_member(kind, 47).structure for kind in ("airliner", "wind_turbine", "bridge", "ship")
]


def of(vertices: np.ndarray, triangles: np.ndarray, surface: str | None = None) -> Structure:
    arrays = np.asarray(vertices, float), np.asarray(triangles, np.int64)
    return Structure("made", "tank", *arrays, surface=surface)


@cache
def solid(name: str) -> Structure:
    """A body of one piece as a program draws it."""
    shapes = open3d().geometry.TriangleMesh
    mesh = {
        "cylinder": lambda: shapes.create_cylinder(3.0, 20.0, 40, 20),
        "ball": lambda: shapes.create_icosahedron(5.0).subdivide_midpoint(4),
        "box": lambda: shapes.create_box(20.0, 6.0, 4.0).subdivide_midpoint(5),
        "torus": lambda: shapes.create_torus(9.0, 2.0, 60, 30),
    }[name]()
    mesh.merge_close_vertices(1e-6)
    return of(mesh.vertices, mesh.triangles)


@cache
def scanned(structure: Structure, number: int = 12_000, depth: int = 7, noise_m: float = 0.0) -> Structure:
    """A structure as Poisson's reconstruction makes it of samples of its surface."""
    geometry, utility = open3d().geometry, open3d().utility
    mesh = geometry.TriangleMesh(
        utility.Vector3dVector(structure.vertices), utility.Vector3iVector(structure.triangles)
    )
    utility.random.seed(3)
    cloud = mesh.sample_points_uniformly(number, use_triangle_normal=True)
    rng = np.random.default_rng(3)
    points = np.asarray(cloud.points)
    cloud.points = utility.Vector3dVector(points + rng.normal(0, noise_m, points.shape))
    surface, _ = geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    return of(surface.vertices, surface.triangles, "scanned")


@cache
def wedge() -> Structure:
    """A closed body with a trailing edge: 20 m long, from 2 m to nothing over a chord of 5 m."""
    corners = np.array([[0, 0, -1], [0, 0, 1], [5, 0, 0], [0, 20, -1], [0, 20, 1], [5, 20, 0]], float)
    faces = [(0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3), (2, 3, 0)]
    return of(corners, faces)


def masted(top: float) -> Structure:
    """A house of 12 x 6 x 4 m with a mast of 0.2 m in the middle of its roof, whose top is so high."""
    unit = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([each for a, b, c, d in quads for each in ((a, b, c), (a, c, d))])
    house, mast = unit * [12, 6, 4] - [6, 3, 2], unit * [0.2, 0.2, top - 2] - [0.1, 0.1, -2]
    return of(np.concatenate([house, mast]), np.concatenate([faces, faces + 8]))


def moved(structure: Structure, by_m: float) -> Structure:
    """Each distinct vertex moved by up to so much along each axis."""
    distinct, index = np.unique(np.round(structure.vertices, 5), axis=0, return_inverse=True)
    off = np.random.default_rng(1).uniform(-by_m, by_m, distinct.shape)[index.reshape(-1)]
    return replace(structure, vertices=structure.vertices + off)


def divided(structure: Structure) -> Structure:
    """Each triangle in four."""
    geometry, utility = open3d().geometry, open3d().utility
    vertices, triangles = (
        utility.Vector3dVector(structure.vertices),
        utility.Vector3iVector(structure.triangles),
    )
    mesh = geometry.TriangleMesh(vertices, triangles).subdivide_midpoint(1)
    return replace(structure, vertices=np.asarray(mesh.vertices), triangles=np.asarray(mesh.triangles))


def reordered(structure: Structure) -> Structure:
    rng = np.random.default_rng(2)
    order, place = rng.permutation(len(structure.vertices)), rng.permutation(len(structure.triangles))
    triangles = np.argsort(order)[structure.triangles[place]]
    return replace(structure, vertices=structure.vertices[order], triangles=triangles)


def error_of(structure: Structure) -> float:
    return reconstruction.held(structure).error_m


def error_mm(structure: Structure) -> float:
    return 1000 * error_of(structure)


def assert_drawn_whatever_is_done_to_it(drawn: Structure) -> None:
    """Exact to 3 mm, as rough as it was made, its likeness to scans the same, and no scan."""
    error = error_mm(drawn)
    assert error < 3
    off = moved(drawn, 1e-3)
    assert 0.5 < error_mm(off) < 10
    assert error_mm(divided(drawn)) < error + 1e-3 and error_mm(divided(off)) < 10
    for of_order in (drawn, off):
        assert error_mm(reordered(of_order)) == pytest.approx(error_mm(of_order), abs=0.1)
    fine, coarse = (replace(drawn, vertices=np.round(drawn.vertices, digits)) for digits in (3, 2))
    assert error_mm(fine) < 5 and error_mm(coarse) < 20
    likeness = reconstruction.likeness_to_scans(drawn)
    assert likeness < 0.66  # the warning begins at 0.68
    for other in (off, fine, reordered(drawn)):
        assert reconstruction.likeness_to_scans(other) == pytest.approx(likeness, abs=0.06)
        assert not reconstruction.looks_scanned(other) and not other.is_scan


@pytest.mark.parametrize("structure", DRAWN, ids=lambda one: one.structure_id)
def test_a_drawn_mesh_is_exact_and_as_rough_as_noise_makes_it(structure: Structure) -> None:
    assert_drawn_whatever_is_done_to_it(structure)


@pytest.mark.slow
def test_real_meshes_are_exact_and_as_rough_as_noise_makes_them(real_data: Path) -> None:
    """Those of all kinds that somebody drew."""
    folders = [real_data / "meshes", real_data / "meshes2"]
    paths = sorted(path for folder in folders for path in folder.glob("[a-z]*/*.ply"))
    assert len(paths) >= 40
    for path in paths:
        entry = StructureEntry(path.stem[:60], path.parent.name, path, unit_m=1.0)
        assert_drawn_whatever_is_done_to_it(read_structure(entry, judge=False))


def test_the_roughness_is_continuous_in_the_noise() -> None:
    drawn = DRAWN[0]
    by_mm = np.array([0.0, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0])
    errors = np.array([error_mm(moved(drawn, by / 1000)) for by in by_mm])
    assert (np.diff(errors) > 0).all() and (np.diff(errors) < 8 * np.diff(by_mm)).all()
    assert errors[-1] > 10  # of what was moved by 1 cm, a centimetre


@pytest.mark.ci
def test_what_is_declared_decides_and_nothing_else() -> None:
    body, shell = solid("box"), scanned(solid("box"))
    for mesh in (body, shell):
        drawn, silent, scan = (replace(mesh, surface=surface) for surface in ("drawn", None, "scanned"))
        assert (drawn.is_scan, silent.is_scan, scan.is_scan) == (False, False, True)
        assert error_mm(drawn) == 0
        assert error_mm(scan) > 10 * error_mm(silent) and reconstruction.held(silent).thin_m == 0
    assert replace(body, triangles=np.empty((0, 3), np.int64)).is_scan


@pytest.mark.ci
@pytest.mark.parametrize("name", slow_after(1, ["cylinder", "ball", "box", "torus"]))
def test_what_looks_like_a_scan_is_warned_of_until_it_is_declared(name: str) -> None:
    shell = replace(scanned(solid(name), noise_m=0.05), surface=None)
    assert len(solid(name).triangles) > 1000 and not shell.is_scan
    assert reconstruction.looks_scanned(shell) and reconstruction.looks_scanned(moved(shell, 1e-3))
    for surface in ("drawn", "scanned"):
        assert not reconstruction.looks_scanned(replace(shell, surface=surface))
    few = replace(shell, triangles=shell.triangles[:900])
    assert not reconstruction.looks_scanned(few)


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
@pytest.mark.parametrize("depth", [6, 7, pytest.param(8, marks=pytest.mark.slow)])
def test_the_surface_is_no_nearer_than_its_reconstruction_promises(depth: int, noise_m: float) -> None:
    true = Scene(wedge().vertices, wedge().triangles, 1)
    scene = scene_of(scanned(wedge(), 30_000, depth, noise_m), 1)
    places = np.random.default_rng(5).uniform([-4, -4, -4], [9, 24, 4], (20_000, 3))
    places = places[true.distance(places) > 1]
    assert (scene.distance(places) <= true.distance(places) + 1e-3).all()
    assert 0 < scene.error_m < 1.5
    # Without the error it is nearer: the trailing edge was rounded off.
    assert (scene.distance(places) + scene.error_m > true.distance(places) + 0.02).any()


@pytest.fixture(scope="module")
def mast_cut_off() -> Structure:
    """A reconstruction that lost the last 0.9 m of its mast, four grains."""
    return scanned(masted(6.1), depth=6)


def test_of_what_is_thin_more_may_be_lost(mast_cut_off: Structure) -> None:
    reach, whole, scene = reconstruction.held(mast_cut_off), masted(7.0), scene_of(mast_cut_off, 1)
    true = Scene(whole.vertices, whole.triangles, 1)
    assert 0.2 < reach.thin_m < reach.error_m < 0.9 < reach.thin_error_m < 1.6
    places = np.random.default_rng(5).uniform([-3, -3, 5], [3, 3, 10], (4000, 3))
    places = places[true.distance(places) > 1]
    assert (scene.distance(places) <= true.distance(places) + 1e-3).all()
    assert (scene.apart(places) - reach.error_m > true.distance(places) + 0.1).any()
    # The walls are as far off the mast as their error tells, no more.
    beside = np.random.default_rng(6).uniform([-5, 4, -1], [-4, 7, 1], (200, 3))
    np.testing.assert_allclose(scene.distance(beside), scene.apart(beside) - reach.error_m)


def test_the_nearest_place_is_as_far_as_the_distance_and_belongs_to_its_triangle(
    mast_cut_off: Structure,
) -> None:
    scene = scene_of(mast_cut_off, 1)
    places = np.random.default_rng(7).uniform(-12, 12, (3000, 3))
    places = places[scene.distance(places) > 0]
    near, triangle = scene.closest(places)
    np.testing.assert_allclose(np.linalg.norm(near - places, axis=1), scene.distance(places), atol=1e-4)
    exact = mast_cut_off.vertices[mast_cut_off.triangles[triangle]]
    off = np.linalg.norm(exact.mean(axis=1) - near, axis=1)
    size = np.linalg.norm(exact - exact.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    assert (off <= size + reconstruction.held(mast_cut_off).thin_error_m + 1e-3).all()
    onto_mast = exact.mean(axis=1)[:, 2] > 2.5
    assert onto_mast.any() and (off[onto_mast] > reconstruction.held(mast_cut_off).error_m).any()


def test_how_triangles_are_wound_and_what_is_declared_of_what_is_thin(mast_cut_off: Structure) -> None:
    places = np.random.default_rng(8).uniform([-3, -3, 5], [3, 3, 10], (500, 3))
    distances = scene_of(mast_cut_off, 1).distance(places)
    turned = replace(mast_cut_off, triangles=mast_cut_off.triangles[:, ::-1])
    np.testing.assert_allclose(scene_of(turned, 1).distance(places), distances, atol=1e-4)
    stated = scene_of(replace(mast_cut_off, surface_error_m=0.1), 1)
    np.testing.assert_allclose(stated.distance(places), np.maximum(stated.apart(places) - 0.1, 0))


@pytest.mark.ci
def test_a_coarser_reconstruction_knows_less_and_units_and_place_do_not_matter() -> None:
    fine, coarse = scanned(wedge(), depth=8), scanned(wedge(), depth=6)
    assert error_of(coarse) > 1.5 * error_of(fine) > 0
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    moved = replace(fine, vertices=1000 * fine.vertices @ turn.T + 3e4)
    assert error_of(moved) == pytest.approx(1000 * error_of(fine), rel=1e-6)


def test_what_was_decimated_still_looks_like_a_scan() -> None:
    geometry, utility = open3d().geometry, open3d().utility
    whole = scanned(wedge(), depth=8)
    mesh = geometry.TriangleMesh(
        utility.Vector3dVector(whole.vertices), utility.Vector3iVector(whole.triangles)
    )
    fewer = mesh.simplify_quadric_decimation(3000)
    assert reconstruction.looks_scanned(of(fewer.vertices, fewer.triangles))


def test_what_a_person_states_overrules_what_the_form_tells() -> None:
    scan = scanned(wedge())
    assert scene_of(replace(scan, surface_error_m=0.0), 1).error_m == 0
    assert scene_of(replace(scan, surface_error_m=0.4), 1).error_m == 0.4
    assert scene_of(replace(solid("box"), surface_error_m=0.1), 1).error_m == 0.1
    cloud = replace(scan, triangles=np.empty((0, 3), np.int64), surface_error_m=0.2)
    assert scene_of(cloud, 1).error_m == 0.2


def test_triangles_without_a_form_decide_nothing() -> None:
    scan = scanned(wedge())
    flat = np.repeat(scan.triangles[:500, :1], 3, axis=1)
    more = replace(scan, triangles=np.concatenate([scan.triangles, flat]))
    assert error_of(more) == pytest.approx(error_of(scan))
    only = replace(scan, triangles=np.repeat(scan.triangles[:2000, :1], 3, axis=1))
    assert error_of(only) == 0
