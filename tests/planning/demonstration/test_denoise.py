"""Smoothing: the line the pilot meant is found again under jitter, pauses, detours and gaps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from winding import turning_deg_per_m

from upplied.geometry.poses import from_yaw_pitch, look_at, matrices, normalised, optical_axis, yaw_pitch
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.planning.demonstration.denoise import smoothed
from upplied.planning.demonstration.stations import pauses
from upplied.records import Floats, Trajectory

RING = 20.0


def ring(
    jitter_m: float = 0.0, hover_s: float = 0.0, detour_m: float = 0.0, turns: float = 0.9, seed: int = 0
) -> Trajectory:
    """A ring of 20 m at a metre or so per second, 20 poses a second, looking at its middle."""
    rng = np.random.default_rng(seed)
    number = int(2 * np.pi * RING * turns * 20)
    speed = 1 + 0.5 * np.sin(np.arange(number) / 150)
    middle = number // 2
    speed = np.insert(speed, middle, np.zeros(int(20 * hover_s)))
    angle = np.cumsum(speed) / speed.sum() * 2 * np.pi * turns
    at = np.column_stack([RING * np.cos(angle), RING * np.sin(angle), 3 + np.sin(angle)])
    if detour_m:  # up and down again, out of the line
        aside = number // 4 + np.zeros(80, int)
        at = np.insert(at, aside, at[aside] + np.hanning(80)[:, None] * [0, 0, detour_m], axis=0)
    quats = look_at(at, np.zeros_like(at))
    shake = Rotation.from_rotvec(rng.normal(0, jitter_m / 3, at.shape))
    quats = normalised((shake * Rotation.from_quat(quats)).as_quat())
    return Trajectory(np.arange(len(at)) / 20, at + rng.normal(0, jitter_m, at.shape), quats)


def off_ring(positions: Floats) -> Floats:
    """Distance from the tilted ring, nearly: radius and height apart."""
    angle = np.arctan2(positions[:, 1], positions[:, 0])
    return np.hypot(np.linalg.norm(positions[:, :2], axis=1) - RING, positions[:, 2] - 3 - np.sin(angle))


def test_jitter_is_gone_and_the_line_stays() -> None:
    noisy = ring(jitter_m=0.1)
    even = smoothed(noisy).flight
    assert np.percentile(off_ring(noisy.positions), 90) > 0.15
    assert off_ring(even.positions).max() < 0.15
    assert turning_deg_per_m(noisy.positions, 0.3) > 30
    assert turning_deg_per_m(even.positions, 0.3) < 1.6 * np.degrees(1 / RING)
    towards = -even.positions / np.linalg.norm(even.positions, axis=1, keepdims=True)
    assert (optical_axis(even.quat_xyzw) * towards).sum(axis=1).min() > np.cos(np.radians(2))
    assert matrices(even.quat_xyzw)[:, 2, 1] == pytest.approx(0, abs=1e-9)  # no roll


def test_a_clean_flight_is_only_resampled() -> None:
    even = smoothed(ring()).flight
    assert off_ring(even.positions).max() < 0.02
    step = np.linalg.norm(np.diff(even.positions, axis=0), axis=1)
    assert step.max() < 1.2 * step.min() and len(even) <= 1000
    assert (np.diff(even.t_s) > 0).all()


def test_a_pause_adds_no_poses_and_is_told() -> None:
    flying, hovering = ring(0.03), ring(0.03, hover_s=20)
    assert len(smoothed(hovering).flight) == pytest.approx(len(smoothed(flying).flight), rel=0.1)
    assert pauses(flying) == []
    [(begin, end)] = pauses(hovering)
    middle = flying.t_s[len(flying) // 2]
    assert begin == pytest.approx(middle, abs=1.5) and end == pytest.approx(middle + 20, abs=1.5)


def test_waiting_before_and_after_the_flight_is_no_pause() -> None:
    flight = ring(0.02)
    before, after = np.repeat(flight.positions[:1], 200, 0), np.repeat(flight.positions[-1:], 200, 0)
    positions = np.vstack([before, flight.positions, after])
    quats = np.vstack(
        [np.repeat(flight.quat_xyzw[:1], 200, 0), flight.quat_xyzw, np.repeat(flight.quat_xyzw[-1:], 200, 0)]
    )
    assert pauses(Trajectory(np.arange(len(positions)) / 20, positions, quats)) == []


def test_a_detour_is_meant_as_far_as_anyone_can_tell() -> None:
    small = smoothed(ring(0.02, detour_m=1.8)).flight
    assert off_ring(small.positions).max() == pytest.approx(1.8, abs=0.1)
    large = smoothed(ring(0.02, detour_m=8.0)).flight
    assert off_ring(large.positions).max() > 6.5


def test_the_end_of_a_hairpin_is_kept() -> None:
    out = np.column_stack([np.linspace(0, 30, 600), np.zeros((600, 2))])
    flight = np.vstack([out, np.add(out[::-1], [0, 0.3, 0])])
    even = smoothed(Trajectory(np.arange(1200) / 20, flight, look_at(flight, flight - [0, 1, 0]))).flight
    assert even.positions[:, 0].max() > 29.5


def test_nothing_is_smoothed_across_a_gap() -> None:
    flight = ring(0.02)
    cut = len(flight) // 2
    stays = np.concatenate([np.arange(cut), np.arange(cut + 400, len(flight))])
    gapped = Trajectory(flight.t_s[stays], flight.positions[stays], flight.quat_xyzw[stays])
    result = smoothed(gapped, breaks=np.array([cut]))
    [start] = result.breaks
    assert result.flight.positions[start - 1] == pytest.approx(flight.positions[cut - 1], abs=0.4)
    assert result.flight.positions[start] == pytest.approx(flight.positions[cut + 400], abs=0.4)
    step = np.linalg.norm(np.diff(result.flight.positions, axis=0), axis=1)
    assert step.argmax() == start - 1 and np.delete(step, start - 1).max() < 0.6


def test_turning_the_camera_on_the_spot_is_kept() -> None:
    angle = np.linspace(0, np.pi, 400)
    ray = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(400)])
    out = np.column_stack([np.linspace(-10, 0, 400), np.zeros((400, 2))])
    back = np.column_stack([np.zeros(400), np.linspace(0, 10, 400), np.zeros(400)])
    at = np.vstack([out, np.zeros((400, 3)), back])
    axis = np.vstack([np.repeat(ray[:1], 400, 0), ray, np.repeat(ray[-1:], 400, 0)])
    even = smoothed(Trajectory(np.arange(1200) / 20, at, look_at(at, at + axis))).flight
    turned = np.degrees(
        np.arccos(np.clip((axis[400:800, None] @ optical_axis(even.quat_xyzw).T).max(axis=(1, 2)), -1, 1))
    )
    assert turned.max() < 5


def test_moving_and_turning_the_flight_moves_and_turns_the_result() -> None:
    flight = ring(0.05)
    turn, shift = Rotation.from_euler("z", 0.7), np.array([100.0, -40, 7])
    moved = Trajectory(
        flight.t_s,
        turn.apply(flight.positions) + shift,
        (turn * Rotation.from_quat(flight.quat_xyzw)).as_quat(),
    )
    here, there = smoothed(flight).flight, smoothed(moved).flight
    assert there.positions == pytest.approx(turn.apply(here.positions) + shift, abs=1e-6)
    assert there.t_s == pytest.approx(here.t_s, abs=1e-4)


HALL_Y = -12.0


def approach(depth_m: float, hover_s: float, noise_m: float = 0.01, rate_hz: float = 10.0) -> Trajectory:
    """Along a hall at 1 m/s, 12 m off, in the middle of it straight towards it, a hover, and back."""
    steps = [(40.0, 0.0), (0.0, depth_m), (0.0, 0.0), (0.0, -depth_m), (40.0, 0.0)]
    at, pieces = np.array([0.0, HALL_Y, 10.0]), []
    for along, across in steps:
        count = round((abs(along) + abs(across) or hover_s) * rate_hz)
        pieces.append(at + np.linspace(0, 1, count, endpoint=False)[:, None] * [along, across, 0])
        at = at + np.array([along, across, 0])
    path = np.vstack([*pieces, at[None]])
    path = path + np.random.default_rng(0).normal(0, noise_m, path.shape)
    return Trajectory(np.arange(len(path)) / rate_hz, path, look_at(path, np.add(path, [0, 10, 0])))


@pytest.mark.parametrize("depth", [1.0, 3.0, 5.0])
@pytest.mark.parametrize("hover", [0.0, 6.0])
@pytest.mark.parametrize("rate", [5.0, 20.0])
def test_going_near_and_hovering_there_is_kept(depth: float, hover: float, rate: float) -> None:
    flight = approach(depth, hover, rate_hz=rate)
    even = smoothed(flight).flight
    assert even.positions[:, 1].max() == pytest.approx(HALL_Y + depth, abs=0.1)
    stands = pauses(even)
    if hover:
        [(begin, end)] = stands
        assert end - begin == pytest.approx(hover, abs=0.6)  # stops at once, which no vehicle can
        stood = (even.t_s > begin + 0.01) & (even.t_s < end - 0.01)
        there = even.positions[np.isclose(even.t_s, begin) | np.isclose(even.t_s, end) | stood]
        assert there[:, 1] == pytest.approx(HALL_Y + depth, abs=0.07)
    else:
        assert stands == []


def test_a_hover_is_still_kept_in_noise_of_5_cm() -> None:
    even = smoothed(approach(5.0, 6.0, noise_m=0.05)).flight
    [(begin, end)] = pauses(even)
    assert end - begin == pytest.approx(6, abs=0.6)
    assert even.positions[:, 1].max() == pytest.approx(HALL_Y + 5, abs=0.15)
    straight = (even.positions[:, 0] > 2) & (even.positions[:, 0] < 37)
    assert np.abs(even.positions[straight, 1] - HALL_Y).max() < 0.1


def rows(number: int, length_m: float = 60.0, apart_m: float = 1.5, spacing_m: float = 0.5) -> Trajectory:
    """Up and down before a wall at 2 m/s, row over row."""
    at = []
    for row in range(number):
        xs = np.arange(0, length_m + 1e-9, spacing_m)
        xs = xs if row % 2 == 0 else xs[::-1]
        at.append(np.column_stack([xs, np.full(len(xs), -10.0), np.full(len(xs), 1.5 + apart_m * row)]))
    path = np.vstack(at)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return Trajectory(along / 2, path, look_at(path, np.add(path, [0, 10, 0])))


def off_path(positions: Floats, path: Floats) -> float:
    """Largest distance of positions from a polyline."""
    start, leg = path[:-1], np.diff(path, axis=0)
    share = np.einsum("nkj,kj->nk", positions[:, None] - start, leg) / np.maximum((leg**2).sum(axis=1), 1e-12)
    foot = start + np.clip(share, 0, 1)[..., None] * leg
    return float(np.linalg.norm(positions[:, None] - foot, axis=2).min(axis=1).max())


@pytest.mark.ci
def test_a_flight_is_told_as_well_however_long_it_is() -> None:
    counts = {}
    for number in (6, 12, 24, 48):
        flight = rows(number)
        even = smoothed(flight, spacing_m=2.0).flight
        assert off_path(flight.positions[::3], even.positions) < 0.1
        assert off_path(even.positions, flight.positions) < 0.1
        counts[number] = len(even)
    assert counts[48] / counts[12] == pytest.approx(4, rel=0.1)  # in proportion to the length


def test_the_same_flight_logged_at_another_rate_or_with_noise_is_the_same_flight() -> None:
    plain = ring()
    even = smoothed(plain).flight
    times = np.arange(0, plain.t_s[-1], 1 / 40)
    dense = np.column_stack([np.interp(times, plain.t_s, axis) for axis in plain.positions.T])
    noisy = plain.positions + np.random.default_rng(5).normal(0, 0.05, plain.positions.shape)
    for other in (
        Trajectory(times, dense, look_at(dense, np.zeros_like(dense))),
        Trajectory(plain.t_s[::2], plain.positions[::2], plain.quat_xyzw[::2]),
        replace(plain, positions=noisy),
    ):
        again = smoothed(other).flight
        assert off_path(again.positions, even.positions) < 0.08
        assert len(again) == pytest.approx(len(even), rel=0.1)


def test_a_second_pass_and_a_second_look_are_kept() -> None:
    out = np.column_stack([np.linspace(0, 30, 300), np.zeros(300), np.full(300, 5.0)])
    back = np.column_stack([np.linspace(30, 10, 200), np.zeros(200), np.full(200, 5.0)])
    path = np.vstack([out, back, out[100:]])  # the stretch from 10 to 30 m three times
    even = smoothed(
        Trajectory(np.arange(len(path)) / 10, path, look_at(path, np.add(path, [0, 9, 0])))
    ).flight
    assert np.linalg.norm(np.diff(even.positions, axis=0), axis=1).sum() == pytest.approx(70, abs=0.7)


def test_a_single_pose_out_of_place_is_none_of_the_flight() -> None:
    flight = ring(0.02)
    broken = np.array(flight.positions)
    broken[700] += [0, 0, 3.0]
    assert off_ring(smoothed(replace(flight, positions=broken)).flight.positions).max() < 0.1


def test_flights_of_few_poses_and_none_that_moves() -> None:
    one = Trajectory(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))
    still = Trajectory(np.arange(50.0), np.zeros((50, 3)), np.tile([0.0, 0, 0, 1], (50, 1)))
    two = Trajectory(np.arange(2.0), np.eye(3)[:2], np.tile([0.0, 0, 0, 1], (2, 1)))
    for flight in (one, still, two):
        again = smoothed(flight).flight
        assert np.isfinite(again.positions).all() and len(again) >= 1
        assert pauses(flight) == []


def test_long_logs_are_not_slow() -> None:
    flight = ring(0.05)
    times = np.linspace(0, flight.t_s[-1], 60_000)
    dense = np.column_stack([np.interp(times, flight.t_s, axis) for axis in flight.positions.T])
    again = smoothed(Trajectory(times, dense, look_at(dense, np.zeros_like(dense)))).flight
    assert len(again) <= 1000 and off_ring(again.positions).max() < 0.15


def test_turning_of_circles_and_lines() -> None:
    angle = np.linspace(0, 2 * np.pi, 2000)
    circle = np.column_stack([5 * np.cos(angle), 5 * np.sin(angle), np.zeros(2000)])
    assert turning_deg_per_m(circle, 0.2) == pytest.approx(np.degrees(1 / 5), rel=0.02)
    assert turning_deg_per_m(np.array([[0.0, 0, 0], [3, 4, 0], [6, 8, 0]]), 0.5) == pytest.approx(0, abs=1e-4)
    assert turning_deg_per_m(np.zeros((1, 3)), 1.0) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["euroc_MH_01", "euroc_V2_02", "px4_posctl_indoor_ev_mavros", "uzhfpv_indoor_fwd5"]
)
def test_real_flights_become_smoother_and_stay_where_they_were(real_data: Path, name: str) -> None:
    [log] = (real_data / "logs" / "converted").glob(f"{name}*.mcap")
    flight = read_demonstration(log, LogOptions()).trajectory
    even = smoothed(flight).flight
    extent = float(np.linalg.norm(np.ptp(flight.positions, axis=0)))
    sampled = flight.positions[:: max(1, len(flight) // 4000)]
    apart = np.linalg.norm(even.positions[:, None] - sampled, axis=2).min(axis=1)
    assert np.percentile(apart, 95) < 0.01 * extent and apart.max() < 0.03 * extent
    for scale in (0.01, 0.03):
        before = turning_deg_per_m(flight.positions, scale * extent)
        assert turning_deg_per_m(even.positions, scale * extent) < before


def test_a_camera_straight_down_keeps_its_heading() -> None:
    rng = np.random.default_rng(3)
    lanes = np.repeat(np.arange(4) * 6.0, 200)
    back_and_forth = np.concatenate(
        [np.linspace(0, 40, 200)[:: 1 if lane % 2 == 0 else -1] for lane in range(4)]
    )
    at = np.column_stack([back_and_forth, lanes, np.full(800, 25.0)])
    exact = from_yaw_pitch(np.full(800, 0.7), np.full(800, -np.pi / 2))
    shake = Rotation.from_rotvec(rng.normal(0, np.radians(0.7), at.shape))
    flight = Trajectory(
        np.arange(800) / 5.0,
        at + rng.normal(0, 0.05, at.shape),
        (Rotation.from_quat(exact) * shake).as_quat(),
    )
    yaw, pitch = yaw_pitch(smoothed(flight).flight.quat_xyzw)
    assert np.abs(yaw - 0.7).max() < np.radians(2)
    assert pitch.max() < np.radians(-88)


def test_a_trembling_hover_stays_where_it_was() -> None:
    rng = np.random.default_rng(1)
    at = np.array([12.0, 0, 40]) + rng.normal(0, 0.02, (200, 3))
    quats = from_yaw_pitch(np.full(200, 3.0), np.zeros(200))
    even = smoothed(Trajectory(np.arange(200) / 20, at, quats)).flight
    middle = at.mean(axis=0)
    farthest = np.linalg.norm(at - middle, axis=1).max()
    assert np.linalg.norm(even.positions - middle, axis=1).max() < 2 * farthest
