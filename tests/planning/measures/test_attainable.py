"""What could be seen at all: cases known by geometry, and every claim checked by its pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import CloudSettings, VisibilitySettings
from upplied.geometry.poses import look_at
from upplied.geometry.scene import Scene
from upplied.planning.airspace.rules import Airspace
from upplied.planning.measures.attainable import (
    _ask_neighbours,
    _candidates,
    _distances,
    _frames,
    _from_sample,
    _Targets,
    attainable,
)
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.line_of_sight import visible
from upplied.records import Camera, Cloud, Floats, Structure, Surroundings

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
    actual = attainable(cloud, on_ground, Camera(), TRULY)
    assert cloud.normals is not None
    assert np.array_equal(actual, cloud.normals[:, 2] > -0.5)


def test_a_gap_too_narrow_for_the_vehicle_hides_its_middle() -> None:
    cloud, scene = sampled(boxes(([-8, -10, -10], [-1, 10, 10]), ([1, -10, -10], [8, 10, 10])))
    actual = attainable(cloud, Airspace(scene, 2.0, Surroundings()), Camera(), TRULY)
    inner = np.isclose(np.abs(cloud.points[:, 0]), 1.0)
    rim = np.abs(cloud.points[:, 1:]).max(axis=1)
    assert actual[~inner].all()
    assert not actual[inner & (rim < 2)].any()  # 2 m between the walls: from the rim at more than 75 deg
    wide = attainable(cloud, Airspace(scene, 0.5, Surroundings()), replace(Camera(), min_range_m=0.5), TRULY)
    assert wide.all()


def test_nothing_is_attainable_from_farther_than_the_range_or_outside_of_the_fence() -> None:
    cloud, scene = sampled(boxes(([-5, -5, 0], [5, 5, 10])))
    near_sighted = replace(Camera(), max_range_m=3.0)
    assert not attainable(cloud, Airspace(scene, 4.0, Surroundings()), near_sighted, TRULY).any()
    fence = np.array([[8.0, -30], [40, -30], [40, 30], [8, 30]])
    actual = attainable(cloud, Airspace(scene, 2.0, Surroundings(geofence_m=fence)), Camera(), TRULY)
    faces_fence = np.isclose(cloud.points[:, 0], 5.0)
    assert actual[faces_fence].all() and not actual[np.isclose(cloud.points[:, 0], -5.0)].any()


def test_whatever_allowed_poses_see_is_nearly_always_called_attainable() -> None:
    structure = boxes(([-9, -2, 0], [9, 2, 4]), ([-2, -12, 1], [2, 12, 2]), ([-9, -0.5, 4], [-6, 0.5, 9]))
    cloud, scene = sampled(structure)
    airspace = Airspace(scene, 2.0, Surroundings(ground_z_m=-2.0), 1.0)
    rng = np.random.default_rng(5)
    positions = rng.uniform([-25, -25, -1], [25, 25, 20], (1500, 3))
    positions = positions[airspace.allowed(positions)]
    quats = look_at(positions, np.zeros_like(positions))
    seen = visible(positions, quats, cloud, Camera(360, 180), TRULY, scene).total
    actual = attainable(cloud, airspace, Camera(), TRULY)
    assert (seen & ~actual).sum() <= 0.002 * len(cloud)
    assert 0.5 < actual.mean() < 1.0
    assert np.array_equal(actual, attainable(cloud, airspace, Camera(), TRULY))


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


FAR = np.array([[900.0, 900, 900], [901, 900, 900], [900, 901, 900]]), np.array([[0, 1, 2]])


def patch_at(normals: Floats) -> Cloud:
    return Cloud(np.zeros((len(normals), 3)), normals / np.linalg.norm(normals, axis=1, keepdims=True))


@pytest.mark.parametrize(("clearance", "nearest"), [(2.0, 0.5), (0.5, 2.0)])
def test_from_nearer_than_the_safety_distance_or_the_range_nothing_is_asked(
    clearance: float, nearest: float
) -> None:
    cloud = patch_at(np.tile([0.0, 0, 1], (3, 1)))
    airspace = Airspace(Scene(*FAR, 1), clearance, Surroundings())
    camera = Camera(min_range_m=nearest, max_range_m=30.0)
    actual = attainable(cloud, airspace, camera, TRULY, np.array([1.99, 2.0, 2.01]))
    assert actual.tolist() == [False, False, True]
    assert attainable(cloud, airspace, camera, TRULY).all()


def test_with_no_least_distance_a_sample_is_seen_from_close_by() -> None:
    cloud = patch_at(np.array([[0.0, 0, 1]]))
    bare = Airspace(Scene(*FAR, 1), 0.0, Surroundings())
    assert attainable(cloud, bare, Camera(min_range_m=0.0), TRULY, np.array([0.01])).all()
    assert not attainable(cloud, bare, Camera(min_range_m=0.0), TRULY, np.array([0.0005])).any()


def test_positions_are_tried_on_the_normal_and_round_it_up_to_the_limit() -> None:
    tilt, turn, share = _candidates(60.0)
    assert len(tilt) == 8 + 5 * 16 * 8 and not tilt[:8].any() and not turn[:8].any()
    assert sorted(share[:8]) == pytest.approx(np.arange(8) / 7)
    assert share[0] == pytest.approx(2 / 7)  # neither near nor far is likeliest
    rings = np.degrees(tilt[8:]).reshape(5, 8, 16)
    assert rings == pytest.approx(
        np.broadcast_to(60 * np.array([0.3, 0.55, 0.75, 0.88, 0.98])[:, None, None], rings.shape)
    )
    assert turn[8:].reshape(40, 16) == pytest.approx(np.tile(np.arange(16) * np.pi / 8, (40, 1)))
    assert share[8:].reshape(5, 8, 16)[:, :, 3] == pytest.approx(np.tile(share[:8], (5, 1)))
    assert np.degrees(_candidates(90.0)[0].max()) == pytest.approx(0.98 * 89.9)


def test_distances_grow_by_equal_factors() -> None:
    distances = _distances(np.array([0, 0.5, 1]), 2.0, np.array([[8.0], [32.0]]))
    np.testing.assert_allclose(distances, [[2, 4, 8], [2, 8, 32]])


def test_a_position_stands_as_far_and_as_oblique_as_is_asked() -> None:
    normals = np.random.default_rng(0).normal(size=(30, 3))
    cloud = patch_at(np.vstack([normals, [[0, 0, 1], [0, 0, -1], [1, 0, 0]]]))
    frames = _frames(cloud)
    np.testing.assert_allclose(
        np.einsum("nij,nkj->nik", frames, frames), np.tile(np.eye(3), (33, 1, 1)), atol=1e-9
    )
    assert cloud.normals is not None and np.array_equal(frames[:, 0], cloud.normals)
    tilt, turn = np.radians([0.0, 30, 30, 60]), np.radians([0.0, 0, 90, 200])
    distance = np.tile([2.0, 3, 4, 5], (33, 1))
    at = _from_sample(frames, tilt, turn, distance)
    np.testing.assert_allclose(np.linalg.norm(at, axis=2), distance)
    np.testing.assert_allclose(
        np.einsum("nki,ni->nk", at, cloud.normals) / distance, np.tile(np.cos(tilt), (33, 1))
    )
    aside = at - np.einsum("nki,ni->nk", at, cloud.normals)[:, :, None] * cloud.normals[:, None]
    between = np.einsum("ni,ni->n", aside[:, 1], aside[:, 2]) / (1.5 * 2)
    np.testing.assert_allclose(between, 0, atol=1e-9)  # turned by a right angle
    against = np.einsum("ni,ni->n", aside[:, 1], aside[:, 3]) / (1.5 * 5 * np.sin(np.radians(60)))
    np.testing.assert_allclose(against, np.cos(np.radians(200)))


def attained(airspace: Airspace, served: Floats, nearest: float = 1.0, farthest: float = 10.0) -> list[bool]:
    """Three samples of a floor in a row, with what served the first."""
    cloud = Cloud(np.array([[0.0, 0, 0], [1, 0, 0], [8, 0, 0]]), np.tile([0.0, 0, 1], (3, 1)))
    places = np.vstack([served, np.full((2, 3), np.nan)])
    _ask_neighbours(places, _Targets(cloud, airspace), (nearest, farthest), np.full(3, 1e9), 60.0)
    return np.isfinite(places[:, 0]).tolist()


def test_what_served_a_neighbour_is_tried_within_range_and_incidence() -> None:
    airspace = Airspace(Scene(*FAR, 1), 0.5, Surroundings())
    assert attained(airspace, np.array([4.0, 0, 5])) == [True, True, True]
    assert attained(airspace, np.array([1.0, 0, 2])) == [True, True, False]  # 74 deg
    assert attained(airspace, np.array([4.0, 0, 5]), nearest=6.0) == [True, False, True]  # 5.83 m
    assert attained(airspace, np.array([4.0, 0, 5]), farthest=6.0) == [True, True, False]  # 6.4 m
    assert attained(Airspace(Scene(*FAR, 1), 0.5, Surroundings(ceiling_z_m=4.0)), np.array([4.0, 0, 5])) == [
        True,
        False,
        False,
    ]


def test_an_allowed_position_with_a_free_line_of_sight_sees_its_sample() -> None:
    wall = boxes(([2.0, -3, -3], [2.5, 3, 3]))
    cloud = Cloud(np.array([[0.0, 0, 0]]), np.array([[1.0, 0, 0]]))
    at = np.array([[5.0, 0, 0], [1.5, 0, 0], [0.9, 0, 0], [0, 0, 4], [0, 0, 9], [np.inf, 0, 0], [1.1, 0, 0]])
    airspace = Airspace(Scene(wall.vertices, wall.triangles, 1), 1.0, Surroundings(ceiling_z_m=8.0))
    sight = _Targets(cloud, airspace).seen(at, np.zeros(7, np.int64))
    assert sight.tolist() == [False, False, True, True, False, False, False]


def test_of_a_sampled_surface_a_ray_arrives_one_grain_before_it() -> None:
    plate = boxes(([-0.5, -3, -3], [0.3, 3, 3]))  # the discs stand 0.3 m before the sample
    cloud = Cloud(np.array([[0.0, 0, 0]]), np.array([[1.0, 0, 0]]))
    at = np.array([[4.0, 0, 0], [-4.0, 0, 0]])
    for grain, sees in ((0.0, False), (0.25, False), (0.4, True)):
        scene = Scene(plate.vertices, plate.triangles, 1, grain_m=grain)
        sight = _Targets(cloud, Airspace(scene, 1.0, Surroundings())).seen(at, np.zeros(2, np.int64))
        assert sight.tolist() == [sees, False]
