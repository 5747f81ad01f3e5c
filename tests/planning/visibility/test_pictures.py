"""What a pixel covers, how it smears and what is out of focus, against rays, differences and a thin lens."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from upplied.config import focal_px
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.observations import Moments, Views
from upplied.records import Camera, Cloud, Floats, Trajectory

CAMERA = Camera(80.0, 65.0, width_px=3000)
FOCAL = focal_px(3000, 80.0)


def looked(cloud: Cloud, positions: Floats, quats: Floats, seen: Floats, camera: Camera = CAMERA, **more):
    """The finest looks of a flight of one pose a second that sees what it is told to."""
    count = len(positions)
    poses = Trajectory(np.arange(count, dtype=float), positions, quats)
    still = np.zeros((count, 3))
    steps = Moments(poses, np.ones(count), more.pop("velocity", still), more.pop("turn", still))
    least = more.pop("least_cosine", 0.0)
    return sharp_looks(steps, Views(poses, seen), cloud, camera, more.pop("sharp", np.inf), least, **more)


def scene(seed: int = 0, count: int = 400):
    """Patches all over the picture, turned up to 75 deg from the line of sight, and poses that see them."""
    rng = np.random.default_rng(seed)
    quats = Rotation.random(6, random_state=seed).as_quat()
    positions = rng.normal(size=(6, 3)) * 3
    at = rng.integers(0, 6, count)
    half = np.tan(np.radians([CAMERA.hfov_deg, CAMERA.vfov_deg])) / 2
    here = np.column_stack([np.ones(count), rng.uniform(-1, 1, (count, 2)) * half]) * rng.uniform(
        3, 30, (count, 1)
    )
    points = positions[at] + np.array(
        [Rotation.from_quat(quats[k]).apply(p) for k, p in zip(at, here, strict=True)]
    )
    ray = positions[at] - points
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    side = np.cross(ray, rng.normal(size=(count, 3)))
    side /= np.linalg.norm(side, axis=1)[:, None]
    tilt = rng.uniform(0, np.radians(75), count)[:, None]
    seen = np.zeros((6, count), bool)
    seen[at, np.arange(count)] = True
    return Cloud(points, ray * np.cos(tilt) + side * np.sin(tilt)), positions, quats, seen, at


def test_what_a_pixel_covers_is_what_rays_through_the_middle_pixel_cut_out() -> None:
    cloud, positions, quats, seen, at = scene()
    cover = looked(cloud, positions, quats, seen).sampled_m / FOCAL
    ray = cloud.points - positions[at]
    distance = np.linalg.norm(ray, axis=1)
    ray /= distance[:, None]
    # A small angle in the plane of the ray and the normal, where the footprint is longest.
    slope = cloud.outward + (-(ray * cloud.outward).sum(axis=1))[:, None] * ray
    slope /= np.maximum(np.linalg.norm(slope, axis=1), 1e-12)[:, None]
    turned = ray + slope * 1e-6
    facing = (turned * cloud.outward).sum(axis=1)
    away = ((cloud.points - positions[at]) * cloud.outward).sum(axis=1) / facing
    cut = np.linalg.norm(away[:, None] * turned - distance[:, None] * ray, axis=1) / 1e-6 / FOCAL
    assert np.abs(cover / cut - 1).max() < 1e-3
    assert (distance / FOCAL / cover).min() < 0.4  # without the incidence it is not the same


def test_in_the_middle_it_is_distance_times_angle_over_the_cosine_of_the_incidence() -> None:
    tilt = np.radians([0.0, 30.0, 60.0])
    normals = np.column_stack([-np.cos(tilt), np.sin(tilt), 0 * tilt])
    cloud = Cloud(np.tile([8.0, 0, 0], (3, 1)), normals)
    looks = looked(cloud, np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), np.ones((1, 3), bool))
    assert looks.sampled_m == pytest.approx(8.0 / np.cos(tilt))
    assert looks.frontal == pytest.approx(np.cos(tilt)) and looks.depth_m == pytest.approx(8.0)


def test_the_finest_of_several_looks_counts_and_those_fine_enough_are_numbered() -> None:
    positions = np.array([[0.0, 0, 0], [4.0, 0, 0], [6.0, 0, 0]])
    quats = np.tile([0.0, 0, 0, 1], (3, 1))
    cloud = Cloud(np.array([[10.0, 0, 0], [10.0, 1, 0]]), np.array([[-1.0, 0, 0], [-1.0, 0, 0]]))
    seen = np.array([[True, True], [True, True], [False, True]])
    looks = looked(cloud, positions, quats, seen, coarsest_m=np.array([7.0, 100.0]))
    oblique = (4.0**2 + 1) / 4.0  # distance over the cosine of the incidence
    assert looks.sampled_m == pytest.approx([6.0, oblique]) and looks.number.tolist() == [1, 3]
    none = looked(cloud, positions, quats, seen, least_cosine=0.99, coarsest_m=np.array([1.0, 1.0]))
    assert none.number.tolist() == [0, 0] and none.sampled_m[1] == pytest.approx(
        10.1
    )  # the others are too oblique
    fast = looked(cloud, positions, quats, seen, velocity=np.tile([0.0, 5.0, 0], (3, 1)), sharp=0.6)
    assert fast.sampled_m == pytest.approx([10.0, 10.1]) and fast.number.tolist() == [1, 1]


def test_blur_is_how_far_the_picture_moves_in_an_exposure() -> None:
    cloud, positions, quats, seen, at = scene(3)
    rng = np.random.default_rng(4)
    velocity, turn = rng.normal(size=(6, 3)) * 2, rng.normal(size=(6, 3)) * 0.3
    blur = looked(cloud, positions, quats, seen, velocity=velocity, turn=turn).moved
    step = 1e-6

    def pixel(k: int, point: Floats, time: float) -> Floats:
        frame = Rotation.from_rotvec(turn[k] * time) * Rotation.from_quat(quats[k])
        x, y, z = frame.inv().apply(point - positions[k] - velocity[k] * time)
        return np.array([y / x, z / x])

    moved = [
        np.linalg.norm(pixel(k, p, step) - pixel(k, p, -step)) / (2 * step)
        for k, p in zip(at, cloud.points, strict=True)
    ]
    assert np.abs(blur / np.array(moved) - 1).max() < 1e-3


def test_defocus_is_that_of_a_thin_lens_focused_on_the_middle_depth() -> None:
    lens = Camera(60.0, 45.0, width_px=4000, focal_mm=20.0, f_number=2.0, focus_m=1.0)
    depth = np.array([4.0, 5.0, 8.0])
    cloud = Cloud(np.column_stack([depth, 0 * depth, 0 * depth]), np.tile([-1.0, 0, 0], (3, 1)))
    at = np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]), np.ones((1, 3), bool)
    looks = looked(cloud, *at, camera=lens)
    circle = 0.02**2 / 2.0 * np.abs(depth - 5.0) / (depth * (5.0 - 0.02))  # m on the sensor
    pixel = 2 * 0.02 * np.tan(np.radians(30)) / 4000
    assert looks.defocus * focal_px(4000, 60.0) == pytest.approx(circle / pixel)
    assert not looked(cloud, *at).defocus.any()  # what is not known of a lens blurs nothing
