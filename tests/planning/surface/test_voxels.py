"""Voxel clouds: PCL's filter, the chosen leaf, and evenness by area."""

import numpy as np
import pytest

from upplied.config import CloudSettings
from upplied.geometry.vectors import points_on_triangles
from upplied.planning.surface.lattice import voxel_cloud, voxel_filter
from upplied.records import Structure


def box(size=(4.0, 2.0, 1.0), shift=(0.0, 0.0, 0.0)):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[i] for i in pick] for q in quads for pick in ((0, 1, 2), (0, 2, 3))])
    return Structure("box-v1", "box", corners * size + shift, triangles)


def test_each_voxel_gives_the_centroid_of_its_points():
    points = np.random.default_rng(3).random((500, 3)) * 10
    leaf = 1.7
    expected = {}
    for point in points:  # the plain definition
        expected.setdefault(tuple(np.floor((point - points.min(axis=0)) / leaf).astype(int)), []).append(
            point
        )
    actual = voxel_filter(points, leaf)
    means = np.array([np.mean(members, axis=0) for _, members in sorted(expected.items())])
    np.testing.assert_allclose(actual, means, atol=1e-12)


@pytest.mark.parametrize("number", [300, 1000, 2000])
def test_the_leaf_leaves_about_the_wanted_number(number):
    cloud = voxel_cloud(box(), CloudSettings(voxel_points=number))
    assert abs(len(cloud) - number) < 0.1 * number


def test_a_moved_structure_gives_the_moved_cloud():
    shift = np.array([100.0, -50.0, 7.0])
    here = voxel_cloud(box(), CloudSettings())
    there = voxel_cloud(box(shift=shift), CloudSettings())
    np.testing.assert_allclose(there.points, here.points + shift, atol=1e-9)


def test_points_are_spread_by_area():
    shape = box()
    points, _ = points_on_triangles(shape, 20_000, np.random.default_rng(0))
    top = np.mean(points[:, 2] > 1 - 1e-9)
    assert top == pytest.approx(8 / 28, abs=0.01)  # 4 x 2 of 28 m^2
    assert points[points[:, 2] > 1 - 1e-9][:, :2].mean(axis=0) == pytest.approx([2, 1], abs=0.05)


def test_a_point_cloud_is_filtered_as_it_is():
    points = np.random.default_rng(0).random((5000, 3))
    cloud = voxel_cloud(Structure("c-v1", "box", points, np.empty((0, 3), np.int64)), CloudSettings(300))
    np.testing.assert_allclose(cloud.points, voxel_filter(points, cloud.leaf_m))


def test_points_on_a_mesh_are_as_many_in_each_triangle_as_its_area_asks() -> None:
    """Two triangles of 1 and 3 m^2 far apart: no place counts but the area that was cumulated before it."""
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [50, 0, 0], [50, 3, 0], [50, 0, 2]])
    mesh = Structure("two-v1", "box", vertices, np.array([[0, 1, 2], [3, 4, 5]]))
    points, owner = points_on_triangles(mesh, 400, np.random.default_rng(0))
    first = points[:, 0] < 10
    assert owner.tolist() == [0] * 100 + [1] * 300
    assert np.flatnonzero(first).tolist() == list(range(100))  # stratified along the cumulated area
    x, y = points[:100, 0] / 2, points[:100, 1]
    assert (x >= 0).all() and (y >= 0).all() and (x + y <= 1).all()
    assert points[:100].mean(axis=0) == pytest.approx(np.array([2 / 3, 1 / 3, 0]), abs=0.06)
    y, z = points[100:, 1] / 3, points[100:, 2] / 2
    assert (y >= 0).all() and (z >= 0).all() and (y + z <= 1).all()
    np.testing.assert_allclose(points[100:, 0], 50)
    assert points[100:].mean(axis=0) == pytest.approx(np.array([50, 1, 2 / 3]), abs=0.08)
