"""A mesh that was drawn is exact; one that was made from a scan states an error that its surface keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied import reconstruction
from upplied.records import Structure
from upplied.samples.fleet import random_member, sample_structures
from upplied.scene import Scene, open3d, scene_of

DRAWN = [*sample_structures()] + [
    random_member(kind, 47).structure for kind in ("airliner", "wind_turbine", "bridge", "ship")
]


def of(vertices: np.ndarray, triangles: np.ndarray) -> Structure:
    return Structure("made", "tank", np.asarray(vertices, float), np.asarray(triangles, np.int64))


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
    made, _ = geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    return of(made.vertices, made.triangles)


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


@pytest.mark.parametrize("structure", DRAWN, ids=lambda one: one.structure_id)
def test_what_was_drawn_is_exact(structure: Structure) -> None:
    assert reconstruction.error_m(structure) == 0


@pytest.mark.parametrize("name", ["cylinder", "ball", "box", "torus"])
def test_a_body_of_one_piece_is_exact_and_its_scan_is_not(name: str) -> None:
    body = solid(name)
    assert len(body.triangles) > 1000
    assert reconstruction.error_m(body) == 0
    assert reconstruction.error_m(scanned(body)) > 0


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
@pytest.mark.parametrize("depth", [6, 7, 8])
def test_the_surface_is_no_nearer_than_its_reconstruction_promises(depth: int, noise_m: float) -> None:
    true = Scene(wedge().vertices, wedge().triangles, 1)
    found = scene_of(scanned(wedge(), 30_000, depth, noise_m), 1)
    places = np.random.default_rng(5).uniform([-4, -4, -4], [9, 24, 4], (20_000, 3))
    places = places[true.distance(places) > 1]
    assert (found.distance(places) <= true.distance(places) + 1e-3).all()
    assert 0 < found.error_m < 1.5
    # Without the error it is nearer: the trailing edge was rounded off.
    assert (found.distance(places) + found.error_m > true.distance(places) + 0.02).any()


@pytest.fixture(scope="module")
def mast_cut_off() -> Structure:
    """A reconstruction that lost the last 0.9 m of its mast, four grains."""
    return scanned(masted(6.1), depth=6)


def test_of_what_is_thin_more_may_be_lost(mast_cut_off: Structure) -> None:
    held, whole, found = reconstruction.held(mast_cut_off), masted(7.0), scene_of(mast_cut_off, 1)
    true = Scene(whole.vertices, whole.triangles, 1)
    assert 0.2 < held.thin_m < held.error_m < 0.9 < held.thin_error_m < 1.6
    places = np.random.default_rng(5).uniform([-3, -3, 5], [3, 3, 10], (4000, 3))
    places = places[true.distance(places) > 1]
    assert (found.distance(places) <= true.distance(places) + 1e-3).all()
    assert (found.apart(places) - held.error_m > true.distance(places) + 0.1).any()
    # The walls are as far off the mast as their error tells, no more.
    beside = np.random.default_rng(6).uniform([-5, 4, -1], [-4, 7, 1], (200, 3))
    np.testing.assert_allclose(found.distance(beside), found.apart(beside) - held.error_m)


def test_the_nearest_place_is_as_far_as_the_distance_and_belongs_to_its_triangle(
    mast_cut_off: Structure,
) -> None:
    found = scene_of(mast_cut_off, 1)
    places = np.random.default_rng(7).uniform(-12, 12, (3000, 3))
    places = places[found.distance(places) > 0]
    near, triangle = found.closest(places)
    np.testing.assert_allclose(np.linalg.norm(near - places, axis=1), found.distance(places), atol=1e-4)
    exact = mast_cut_off.vertices[mast_cut_off.triangles[triangle]]
    off = np.linalg.norm(exact.mean(axis=1) - near, axis=1)
    size = np.linalg.norm(exact - exact.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    assert (off <= size + reconstruction.held(mast_cut_off).thin_error_m + 1e-3).all()
    onto_mast = exact.mean(axis=1)[:, 2] > 2.5
    assert onto_mast.any() and (off[onto_mast] > reconstruction.held(mast_cut_off).error_m).any()


def test_how_triangles_are_wound_and_what_is_declared_of_what_is_thin(mast_cut_off: Structure) -> None:
    places = np.random.default_rng(8).uniform([-3, -3, 5], [3, 3, 10], (500, 3))
    found = scene_of(mast_cut_off, 1).distance(places)
    turned = replace(mast_cut_off, triangles=mast_cut_off.triangles[:, ::-1])
    np.testing.assert_allclose(scene_of(turned, 1).distance(places), found, atol=1e-4)
    stated = scene_of(replace(mast_cut_off, surface_error_m=0.1), 1)
    np.testing.assert_allclose(stated.distance(places), np.maximum(stated.apart(places) - 0.1, 0))


def test_a_coarser_reconstruction_knows_less_and_units_and_place_do_not_matter() -> None:
    fine, coarse = scanned(wedge(), depth=8), scanned(wedge(), depth=6)
    assert reconstruction.error_m(coarse) > 1.5 * reconstruction.error_m(fine) > 0
    turn = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()
    moved = replace(fine, vertices=1000 * fine.vertices @ turn.T + 3e4)
    assert reconstruction.error_m(moved) == pytest.approx(1000 * reconstruction.error_m(fine), rel=1e-6)


def test_what_was_decimated_is_still_a_scan() -> None:
    geometry, utility = open3d().geometry, open3d().utility
    whole = scanned(wedge(), depth=8)
    mesh = geometry.TriangleMesh(
        utility.Vector3dVector(whole.vertices), utility.Vector3iVector(whole.triangles)
    )
    fewer = mesh.simplify_quadric_decimation(3000)
    assert reconstruction.error_m(of(fewer.vertices, fewer.triangles)) > 0


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
    assert reconstruction.error_m(more) == pytest.approx(reconstruction.error_m(scan))
    only = replace(scan, triangles=np.repeat(scan.triangles[:2000, :1], 3, axis=1))
    assert reconstruction.error_m(only) == 0
