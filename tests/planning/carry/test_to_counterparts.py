"""The flight carried to the counterparts: scaled structures, kept stand-offs, parts that moved."""

import itertools

import numpy as np
import pytest

from upplied.config import TransferSettings
from upplied.planning.carry.affine import AxisMap
from upplied.planning.carry.to_counterparts import _smoothing, _stretched, follow_counterparts
from upplied.poses import angle_between, from_yaw_pitch, look_at, optical_axis, yaw_pitch
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


def follow(scale, shift=(0.0, 0.0, 0.0), partial=None, **settings):
    cloud, flight = ball(), orbit()
    there = cloud.points * scale + shift
    pairs = Correspondences(np.arange(len(there)), np.zeros(len(there)), there)
    carrier = AxisMap(np.eye(3) * scale, np.zeros(3) if partial else np.asarray(shift, float))
    seen = facing(flight, cloud)
    return flight, follow_counterparts(
        flight, seen, cloud, pairs, carrier, TransferSettings(**settings), CAMERA, 0.1, 5.0
    )


def test_the_same_structure_gives_the_flight_back():
    flight, done = follow(1.0)
    np.testing.assert_allclose(done.positions, flight.positions, atol=1e-9)
    assert angle_between(done.quat_xyzw, flight.quat_xyzw).max() < 1e-6


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_scaled_stand_off_scales_the_flight(scale):
    flight, done = follow(scale)
    np.testing.assert_allclose(done.positions, scale * flight.positions, atol=1e-6)
    assert angle_between(done.quat_xyzw, flight.quat_xyzw).max() < 1e-6


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_kept_stand_off_keeps_the_distance_to_the_surface(scale):
    """Also of a larger ball, whose rim is farther off than that of the demonstrated one."""
    flight, done = follow(scale, standoff="kept")
    flown = np.linalg.norm(flight.positions, axis=1) - 4.0
    kept = np.linalg.norm(done.positions, axis=1) - 4.0 * scale
    assert kept == pytest.approx(flown, rel=0.05)


def test_a_ground_sampling_distance_sets_the_distance():
    cloud, flight = ball(), orbit()
    pairs = Correspondences(np.arange(400), np.zeros(400), cloud.points)
    camera = Camera(hfov_deg=90, max_range_m=200, width_px=1000)
    done = follow_counterparts(
        flight, facing(flight, cloud), cloud, pairs, AxisMap(np.eye(3), np.zeros(3)),
        TransferSettings(gsd_m=0.03), camera, 0.1, 5.0,
    )  # fmt: skip
    distance = np.linalg.norm(done.positions[:, None] - cloud.points, axis=2)
    in_view = np.where(facing(flight, cloud).seen, distance, np.nan)
    assert np.nanmedian(in_view) == pytest.approx(0.03 * 1000 / 2, rel=0.15)


def test_a_part_that_lies_elsewhere_is_followed():
    shift = np.array([3.0, -2.0, 1.0])
    flight, done = follow(1.0, shift, partial=True)
    np.testing.assert_allclose(done.positions, flight.positions + shift, atol=1e-6)
    towards = shift - done.positions
    cosine = np.sum(optical_axis(done.quat_xyzw) * towards, axis=1) / np.linalg.norm(towards, axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 1


def test_a_flight_that_sees_nothing_known_is_carried_by_the_map():
    cloud, flight = ball(), orbit()
    none = Correspondences(np.full(400, -1), np.full(400, np.nan), np.full((400, 3), np.nan))
    done = follow_counterparts(
        flight, facing(flight, cloud), cloud, none, AxisMap(2 * np.eye(3), np.ones(3)),
        TransferSettings(), CAMERA, 0.1, 0.5,
    )  # fmt: skip
    np.testing.assert_allclose(done.positions, 2 * flight.positions + 1)


def towed(deviation, **settings):
    """A flight round a ball of which one half went elsewhere."""
    cloud, flight = ball(), orbit()
    there = cloud.points + np.where(cloud.points[:, :1] > 0, [[4.0, 1.0, 2.0]], [[0.0, 0.0, 0.0]])
    pairs = Correspondences(np.arange(len(there)), np.zeros(len(there)), there)
    carrier = AxisMap(1.5 * np.eye(3), np.array([1.0, 2.0, 3.0]))
    done = follow_counterparts(
        flight,
        facing(flight, cloud),
        cloud,
        pairs,
        carrier,
        TransferSettings(**settings),
        CAMERA,
        0.1,
        deviation,
    )
    return carrier.points(flight.positions), done.positions


def spread_of(path):
    """By length; an axis counts as a tenth of the largest at least."""
    fine = np.vstack([a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in itertools.pairwise(path)])
    weight = np.repeat(np.linalg.norm(np.diff(path, axis=0), axis=1), 50)
    mean = np.average(fine, axis=0, weights=weight)
    deviation = np.sqrt(np.average((fine - mean) ** 2, axis=0, weights=weight))
    return np.maximum(deviation, 0.1 * deviation.max())


@pytest.mark.parametrize("deviation", [0.05, 0.3, 2.0])
def test_a_path_strays_from_the_carried_shape_as_far_as_it_may(deviation):
    carried, free = towed(1e9)
    _, bound = towed(deviation)
    stray = free - carried
    aside = stray - stray.mean(axis=0)
    size = np.linalg.norm(aside / (deviation * spread_of(carried)), axis=1, keepdims=True)
    wanted = carried + stray.mean(axis=0) + aside * np.tanh(size) / size
    np.testing.assert_allclose(bound, wanted, atol=0.02)
    left = np.linalg.norm((bound - carried - (bound - carried).mean(axis=0)) / spread_of(carried), axis=1)
    assert left.max() < 2.1 * deviation and size.max() > 1.2 / (1 + 9 * (deviation > 1))


@pytest.mark.parametrize("scale", [0.2, 0.6, 2.0, 6.0])
def test_a_kept_stand_off_stretches_the_shape_within_its_bounds(scale):
    """With no room to stray, the path is the demonstrated one, stretched as far as that is its shape."""
    cloud, flight = ball(), orbit()
    there = scale * cloud.points
    pairs = Correspondences(np.arange(len(there)), np.zeros(len(there)), there)
    done = follow_counterparts(
        flight, facing(flight, cloud), cloud, pairs, AxisMap(scale * np.eye(3), np.zeros(3)),
        TransferSettings(standoff="kept"), CAMERA, 0.1, 1e-6,
    )  # fmt: skip
    carried = scale * flight.positions
    offset = carried - carried.mean(axis=0)
    found = done.positions - done.positions.mean(axis=0)
    stretch = np.clip((4 * scale + 8) / (12 * scale), 1 / 3, 3)
    np.testing.assert_allclose(found[:, :2], stretch * offset[:, :2], rtol=0.06, atol=0.05 * scale)


def test_a_level_flight_is_stretched_along_no_height():
    cloud, flight = ball(), orbit()
    level = Trajectory(flight.t_s, flight.positions * [1, 1, 0.02], flight.quat_xyzw)
    pairs = Correspondences(np.arange(400), np.zeros(400), 2 * cloud.points)
    done = follow_counterparts(
        level, facing(level, cloud), cloud, pairs, AxisMap(2 * np.eye(3), np.zeros(3)),
        TransferSettings(standoff="kept"), CAMERA, 0.1, 1e-6,
    )  # fmt: skip
    height = done.positions[:, 2] - done.positions[:, 2].mean()
    np.testing.assert_allclose(height, 2 * (level.positions[:, 2] - level.positions[:, 2].mean()), atol=1e-3)


def test_a_camera_that_looks_steeply_down_keeps_its_heading():
    """What is below moved aside: the camera leans, it does not turn round."""
    grid = np.array([[x, y, 0.0] for x in np.arange(-6, 6.1) for y in np.arange(-6, 6.1)])
    plate = Cloud(grid, np.tile([0.0, 0, 1], (len(grid), 1)), np.ones(len(grid)))
    at = np.column_stack([np.linspace(-3, 3, 30), np.zeros(30), np.full(30, 10.0)])
    moved = grid + np.sign(grid[:, :1]) * np.array([0.0, 2.0, 0.0])
    pairs = Correspondences(np.arange(len(grid)), np.zeros(len(grid)), moved)
    seen = Visibility(np.linalg.norm(at[:, None, :2] - grid[:, :2], axis=2) < 3)
    for pitch, turns in ((-90.0, False), (-80.0, False), (-60.0, True)):
        quats = from_yaw_pitch(np.full(30, 0.4), np.full(30, np.radians(pitch)))
        flight = Trajectory(np.arange(30.0), at, quats)
        still = AxisMap(np.eye(3), np.zeros(3))
        done = follow_counterparts(flight, seen, plate, pairs, still, TransferSettings(), CAMERA, 0.1, 1e-6)
        yaw = yaw_pitch(done.quat_xyzw)[0]
        assert (np.abs(yaw - 0.4) > 0.01).any() == turns


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
    aim = at + np.array([0.0, 0.0, standoff])
    aim[0] = np.nan
    assert _smoothing(at, aim) == pytest.approx(poses)
    assert _smoothing(at[1:2], aim[1:2]) == 1.0


def test_a_flight_that_hovered_amid_its_way_is_stretched_all_the_same():
    """Its vertices are spread less than its curve; what is level is left as it is."""
    x = np.concatenate([np.linspace(-10, 0, 6), np.zeros(30), np.linspace(2, 10, 5)])
    carried = np.column_stack([x, 0.6 * np.abs(x), np.tile([0.0, 0.01], 21)[:41]])
    found = _stretched(carried, 1.5 * carried + [3.0, 4, 5])
    middle = carried.mean(axis=0)
    np.testing.assert_allclose(found, middle + [1.5, 1.5, 1] * (carried - middle), atol=1e-9)
    far = _stretched(carried, 9.0 * carried)
    np.testing.assert_allclose(far, middle + [3, 3, 1] * (carried - middle), atol=1e-9)
    near = _stretched(carried, 0.1 * carried)
    np.testing.assert_allclose(near, middle + [1 / 3, 1 / 3, 1] * (carried - middle), atol=1e-9)
