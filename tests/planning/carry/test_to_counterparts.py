"""The flight carried to the counterparts: scaled structures, and stand-offs in metres."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from upplied.config import TransferSettings
from upplied.geometry.poses import angle_between, look_at
from upplied.planning.carry.affine import AxisMap
from upplied.planning.carry.carried import _filled, _smoothed, follow_counterparts
from upplied.records import Camera, Cloud, Correspondences, Trajectory, Visibility

CAMERA = Camera(max_range_m=200)


def ball(count=400, radius=4.0):
    index = np.arange(count) + 0.5
    z, turn = 1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index
    ring = np.sqrt(1 - z**2)
    normals = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    return Cloud(radius * normals, normals, np.full(count, 4 * np.pi * radius**2 / count))


def orbit(radius=12.0, count=60):
    turn = np.linspace(0, 1.5 * np.pi, count)
    positions = radius * np.column_stack([np.cos(turn), np.sin(turn), 0.2 * np.sin(2 * turn)])
    return Trajectory(np.arange(count, dtype=float), positions, look_at(positions, np.zeros((count, 3))))


def facing(flight, cloud):
    rays = flight.positions[:, None] - cloud.points
    return Visibility(np.einsum("mnj,nj->mn", rays, cloud.normals) > 0)


def follow(scale, **settings):
    cloud, flight = ball(), orbit()
    there = cloud.points * scale
    pairs = Correspondences(np.arange(len(there)), np.zeros(len(there)), there)
    carrier = AxisMap(np.eye(3) * scale, np.zeros(3))
    seen = facing(flight, cloud)
    return flight, follow_counterparts(
        flight, seen, cloud, np.ones(400), pairs, carrier, TransferSettings(**settings), CAMERA, 0.1
    )


def test_the_same_structure_gives_the_flight_back():
    flight, path = follow(1.0)
    np.testing.assert_allclose(path.positions, flight.positions, atol=1e-9)
    assert angle_between(path.quat_xyzw, flight.quat_xyzw).max() < 1e-6


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_scaled_stand_off_scales_the_flight(scale):
    flight, path = follow(scale)
    np.testing.assert_allclose(path.positions, scale * flight.positions, atol=1e-6)
    assert angle_between(path.quat_xyzw, flight.quat_xyzw).max() < 1e-6


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_kept_stand_off_keeps_the_distance_to_the_surface(scale):
    """Also of a larger ball, whose rim is farther off than that of the demonstrated one."""
    flight, path = follow(scale, standoff="kept")
    flown = np.linalg.norm(flight.positions, axis=1) - 4.0
    distance = np.linalg.norm(path.positions, axis=1) - 4.0 * scale
    assert distance == pytest.approx(flown, rel=0.05)


def test_a_ground_sampling_distance_sets_the_distance():
    cloud, flight = ball(), orbit()
    pairs = Correspondences(np.arange(400), np.zeros(400), cloud.points)
    camera = Camera(hfov_deg=90, max_range_m=200, width_px=1000)
    path = follow_counterparts(
        flight, facing(flight, cloud), cloud, np.ones(400), pairs, AxisMap(np.eye(3), np.zeros(3)),
        TransferSettings(gsd_m=0.03), camera, 0.1,
    )  # fmt: skip
    distance = np.linalg.norm(path.positions[:, None] - cloud.points, axis=2)
    in_view = np.where(facing(flight, cloud).seen, distance, np.nan)
    assert np.nanmedian(in_view) == pytest.approx(0.03 * 1000 / 2, rel=0.15)


def test_the_flight_follows_what_it_was_about_and_not_what_is_beside_it():
    """A subject in front of a large wall that has moved elsewhere on the target."""
    across, up = np.meshgrid(np.linspace(-20, 20, 41), np.linspace(-20, 20, 41))
    wall = np.column_stack([np.full(across.size, 6.0), across.ravel(), up.ravel()])
    subject = np.column_stack([np.zeros(25), *(axis[18:23, 18:23].ravel() for axis in (across, up))])
    points = np.concatenate([subject, wall])
    cloud = Cloud(points, np.tile([-1.0, 0, 0], (len(points), 1)), np.ones(len(points)))
    positions = np.column_stack([np.full(30, -8.0), np.linspace(-2, 2, 30), np.zeros(30)])
    flight = Trajectory(np.arange(30.0), positions, look_at(positions, np.zeros((30, 3))))
    there = points + np.where(np.arange(len(points))[:, None] < 25, [3.0, 0, 0], [-40.0, 0, 0])
    pairs = Correspondences(np.arange(len(points)), np.zeros(len(points)), there)
    seen, identity = Visibility(np.ones((30, len(points)), bool)), AxisMap(np.eye(3), np.zeros(3))
    attention = (np.arange(len(points)) < 25).astype(float)
    settings = TransferSettings(standoff="kept")
    path = follow_counterparts(flight, seen, cloud, attention, pairs, identity, settings, CAMERA, 0.1)
    assert path.positions[:, 0] == pytest.approx(-5.0, abs=0.7)


def test_a_flight_that_sees_nothing_known_is_carried_by_the_map():
    cloud, flight = ball(), orbit()
    none = Correspondences(np.full(400, -1), np.full(400, np.nan), np.full((400, 3), np.nan))
    path = follow_counterparts(
        flight, facing(flight, cloud), cloud, np.ones(400), none, AxisMap(2 * np.eye(3), np.ones(3)),
        TransferSettings(), CAMERA, 0.1,
    )  # fmt: skip
    np.testing.assert_allclose(path.positions, 2 * flight.positions + 1)


@pytest.mark.parametrize(
    ("spacing", "standoff", "count", "poses"),
    [
        (0.5, 4.0, 100, 4.0),
        (2.0, 4.0, 100, 1.0),
        (0.5, 40.0, 100, 12.5),
        (0.5, 4.0, 6, 1.0),
        (0.5, 6.0, 100, 6.0),
    ],
)
def test_a_shift_is_smoothed_over_half_a_stand_off(spacing, standoff, count, poses):
    at = np.column_stack([spacing * np.arange(count), np.zeros((count, 2))])
    one = np.zeros((count, 1))
    one[count // 2] = 1.0
    assert _smoothed(one, standoff, at) == pytest.approx(
        gaussian_filter1d(one, poses, axis=0, mode="nearest")
    )


def test_what_saw_nothing_is_shifted_like_its_neighbours():
    rows = np.array([[np.nan, 1.0], [2.0, 0.0], [np.nan, np.nan], [4.0, 6.0]])
    assert _filled(rows).tolist() == [[2, 0], [2, 0], [3, 3], [4, 6]]
    assert not _filled(np.full((3, 2), np.nan)).any()
