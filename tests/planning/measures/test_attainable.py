"""What could be seen at all: cases known by geometry, and every claim checked by its pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.config import CloudSettings, VisibilitySettings
from upplied.planning.airspace.rules import Airspace
from upplied.planning.measures.attainable import attainable
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.line_of_sight import visible
from upplied.poses import look_at
from upplied.records import Camera, Cloud, Floats, Structure, Surroundings
from upplied.scene import Scene

TRULY = VisibilitySettings(occlusion=True, max_incidence_deg=75.0)


def boxes(*corners: tuple[Floats, Floats]) -> Structure:
    unit = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    vertices = [np.asarray(low) + unit * (np.asarray(high) - low) for low, high in corners]
    stacked = np.vstack([triangles + 8 * index for index in range(len(corners))])
    return Structure("boxes", "box", np.vstack(vertices), stacked)


def sampled(structure: Structure) -> tuple[Cloud, Scene]:
    scene = Scene(structure.vertices, structure.triangles, 1)
    return surface_samples(structure, scene, CloudSettings(surface_samples=1500)), scene


def test_a_free_cube_is_wholly_attainable_and_its_underside_not_on_the_ground() -> None:
    cloud, scene = sampled(boxes(([-5, -5, 0], [5, 5, 10])))
    assert attainable(cloud, Airspace(scene, 2.0, Surroundings()), Camera(), TRULY).all()
    on_ground = Airspace(scene, 2.0, Surroundings(ground_z_m=0.0), 1.0)
    found = attainable(cloud, on_ground, Camera(), TRULY)
    assert cloud.normals is not None
    assert np.array_equal(found, cloud.normals[:, 2] > -0.5)


def test_a_gap_too_narrow_for_the_vehicle_hides_its_middle() -> None:
    cloud, scene = sampled(boxes(([-8, -10, -10], [-1, 10, 10]), ([1, -10, -10], [8, 10, 10])))
    found = attainable(cloud, Airspace(scene, 2.0, Surroundings()), Camera(), TRULY)
    inner = np.isclose(np.abs(cloud.points[:, 0]), 1.0)
    rim = np.abs(cloud.points[:, 1:]).max(axis=1)
    assert found[~inner].all()
    assert not found[inner & (rim < 2)].any()  # 2 m between the walls: from the rim at more than 75 deg
    wide = attainable(cloud, Airspace(scene, 0.5, Surroundings()), replace(Camera(), min_range_m=0.5), TRULY)
    assert wide.all()


def test_nothing_is_attainable_from_farther_than_the_range_or_outside_of_the_fence() -> None:
    cloud, scene = sampled(boxes(([-5, -5, 0], [5, 5, 10])))
    near_sighted = replace(Camera(), max_range_m=3.0)
    assert not attainable(cloud, Airspace(scene, 4.0, Surroundings()), near_sighted, TRULY).any()
    fence = np.array([[8.0, -30], [40, -30], [40, 30], [8, 30]])
    found = attainable(cloud, Airspace(scene, 2.0, Surroundings(geofence_m=fence)), Camera(), TRULY)
    faces_fence = np.isclose(cloud.points[:, 0], 5.0)
    assert found[faces_fence].all() and not found[np.isclose(cloud.points[:, 0], -5.0)].any()


def test_whatever_allowed_poses_see_is_nearly_always_called_attainable() -> None:
    structure = boxes(([-9, -2, 0], [9, 2, 4]), ([-2, -12, 1], [2, 12, 2]), ([-9, -0.5, 4], [-6, 0.5, 9]))
    cloud, scene = sampled(structure)
    airspace = Airspace(scene, 2.0, Surroundings(ground_z_m=-2.0), 1.0)
    rng = np.random.default_rng(5)
    positions = rng.uniform([-25, -25, -1], [25, 25, 20], (1500, 3))
    positions = positions[airspace.allowed(positions)]
    quats = look_at(positions, np.zeros_like(positions))
    seen = visible(positions, quats, cloud, Camera(360, 180), TRULY, scene).total
    found = attainable(cloud, airspace, Camera(), TRULY)
    assert (seen & ~found).sum() <= 0.002 * len(cloud)
    assert 0.5 < found.mean() < 1.0
    assert np.array_equal(found, attainable(cloud, airspace, Camera(), TRULY))


def test_what_only_a_window_lets_be_seen_is_found_through_what_served_its_neighbours() -> None:
    """A wall in a closed room with one window: every sample is seen through it, by few of all directions."""
    sides = [
        ([-1, -12, -12], [0, 12, 12]),
        ([0, -12, -12], [3.1, -11.9, 12]),
        ([0, 11.9, -12], [3.1, 12, 12]),
    ]
    sides += [([0, -12, -12], [3.1, 12, -11.9]), ([0, -12, 11.9], [3.1, 12, 12])]
    front = [([3, -12, -12], [3.1, -0.8, 12]), ([3, 0.8, -12], [3.1, 12, 12])]
    front += [([3, -0.8, -12], [3.1, 0.8, -0.8]), ([3, -0.8, 0.8], [3.1, 0.8, 12])]
    room = boxes(*sides, *front)
    across = np.linspace(-4, 4, 21)
    points = np.array([[1e-4, y, z] for y in across for z in across])
    wall = Cloud(points, np.tile([1.0, 0, 0], (len(points), 1)), np.ones(len(points)))
    scene = Scene(room.vertices, room.triangles, 1)
    camera = Camera(min_range_m=0.5, max_range_m=20)
    assert attainable(wall, Airspace(scene, 2.0, Surroundings(), 1.0), camera, TRULY).all()
