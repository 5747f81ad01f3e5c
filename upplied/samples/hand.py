"""The human hand: uneven speed, pauses to look, drift, and a gimbal that follows with a lag.

The flown path always stays at its distance from the structure and from the ground, also between the logged
poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated, leg_lengths
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene
from upplied.records import Floats, Trajectory
from upplied.samples.inspections import Route

_STEP_M = 0.25


@dataclass(frozen=True)
class Hand:
    """How a pilot flies."""

    rate_hz: float = 10.0
    typical_s: float = 105.0  # without pauses; the speed follows from the length of the route
    slowest_mps: float = 0.4
    fastest_mps: float = 3.2
    unevenness: float = 0.27  # of the speed, one sigma
    pauses: int = 3
    pause_s: tuple[float, float] = (2.5, 6.0)
    drift_m: float = 0.22  # one sigma, over some seconds
    shake_m: float = 0.006  # one sigma, from pose to pose
    gimbal_lag_s: float = 0.3
    gimbal_noise_deg: float = 1.2
    clearance_m: float = 2.1  # of the whole path
    above_ground_m: float = 1.0


def fly_route(
    route: Route, scene: Scene, ground_z: float, hand: Hand, rng: np.random.Generator
) -> Trajectory:
    """Fly a route as a person would.

    Raises
    ------
    RefusedError
        If no path near the route has enough clearance.
    """
    positions, look = _rounded(route)
    floor = ground_z + hand.above_ground_m
    positions = pushed_clear(positions, scene, hand.clearance_m + 0.9, floor)
    along = arc_length(positions)
    t, s = _pace(float(along[-1]), hand, rng)
    flown = interpolated(s, along, positions)
    flown += _drift(len(t), hand, rng)
    flown = pushed_clear(flown, scene, hand.clearance_m, floor)
    ahead = np.minimum(s + 0.5, along[-1])
    return Trajectory(t, flown, _gimbal(flown, interpolated(ahead, along, look), hand, rng))


def _rounded(route: Route) -> tuple[Floats, Floats]:
    """The route at even steps with rounded corners."""
    along = arc_length(route.positions)
    wanted = np.linspace(0, along[-1], max(int(along[-1] / _STEP_M), 2))
    positions, look = (interpolated(wanted, along, each) for each in (route.positions, route.look))
    return _soft(positions, 1.2 / _STEP_M), _soft(look, 2.0 / _STEP_M)


def _soft(places: Floats, sigma: float) -> Floats:
    return np.column_stack([gaussian_filter1d(axis, sigma, mode="nearest") for axis in places.T])


def _pace(length_m: float, hand: Hand, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times and distances along the route: an uneven speed, from rest to rest, with pauses."""
    dt = 1 / hand.rate_hz
    speed = float(np.clip(length_m / hand.typical_s, hand.slowest_mps, hand.fastest_mps))
    count = int(3 * length_m / speed / dt) + 400
    wobble = _coloured(count, 4.0 / dt, rng)
    share = np.clip(np.exp(hand.unevenness * wobble - hand.unevenness**2 / 2), 0.4, 1.5)
    plan = np.cumsum(speed * share * dt)
    stops = np.sort(rng.uniform(0.08, 0.92, hand.pauses)) * length_m
    hold = np.ones(count)
    added = 0
    for stop in stops:
        at = int(np.searchsorted(plan, stop)) + added
        pause = int(rng.uniform(*hand.pause_s) / dt)
        hold = np.insert(hold, min(at, len(hold)), np.zeros(pause))[:count]
        share = np.insert(share, min(at, len(share)), np.ones(pause))[:count]
        added += pause
    drive = gaussian_filter1d(hold, 0.5 / dt, mode="nearest") * share
    drive *= np.clip(np.arange(count) * dt / 1.5, 0.02, 1)  # from rest
    s = np.cumsum(speed * drive * dt)
    s -= s[0]
    last = int(np.searchsorted(s, length_m))
    s = np.minimum(s[: last + 1], length_m)
    return np.arange(len(s), dtype=float) * dt, np.asarray(s, float)


def _drift(count: int, hand: Hand, rng: np.random.Generator) -> Floats:
    slow = np.column_stack([_coloured(count, 2.5 * hand.rate_hz, rng) for _ in range(3)])
    return hand.drift_m * slow * (1, 1, 0.6) + hand.shake_m * rng.standard_normal((count, 3))


def _coloured(count: int, sigma: float, rng: np.random.Generator) -> Floats:
    """Smooth noise of unit deviation."""
    noise = gaussian_filter1d(rng.standard_normal(count + int(8 * sigma)), sigma)[int(4 * sigma) :][:count]
    return np.asarray(noise * np.sqrt(2 * np.sqrt(np.pi) * sigma))


def _gimbal(positions: Floats, aim: Floats, hand: Hand, rng: np.random.Generator) -> Floats:
    """Yaw and pitch that follow the aim through a first-order lag, with a little noise and no roll."""
    ray = aim - positions
    yaw = np.unwrap(np.arctan2(ray[:, 1], ray[:, 0]))
    pitch = np.arctan2(ray[:, 2], np.hypot(ray[:, 0], ray[:, 1]))
    wanted = np.column_stack([yaw, np.clip(pitch, -np.pi / 2, np.pi / 6)])
    gain = 1 - np.exp(-1 / (hand.rate_hz * hand.gimbal_lag_s))
    followed = np.empty_like(wanted)
    followed[0] = wanted[0]
    for row in range(1, len(wanted)):
        followed[row] = followed[row - 1] + gain * (wanted[row] - followed[row - 1])
    noise = np.column_stack([_coloured(len(aim), 0.8 * hand.rate_hz, rng) for _ in range(2)])
    followed += np.radians(hand.gimbal_noise_deg) * noise
    return from_yaw_pitch(followed[:, 0], np.clip(followed[:, 1], -np.pi / 2, np.pi / 6))


def pushed_clear(positions: Floats, scene: Scene, clearance_m: float, floor_z: float) -> Floats:
    """The path pushed away from the surface and the ground where it comes too near, smoothly.

    Distances change by at most the way flown, so that between two poses a m apart, at distances b
    and c, nothing comes nearer than (b + c - a) / 2: that bound is used.

    Raises
    ------
    RefusedError
        If pushing does not help: the route leads through a gap that is too narrow.
    """
    path = positions.copy()
    for round_ in range(80):
        path[:, 2] = np.maximum(path[:, 2], floor_z)
        closest, _ = scene.closest(path)
        away = path - closest
        distance = np.linalg.norm(away, axis=1)
        lacking = _lacking(path, distance, clearance_m)
        if not (lacking > 0).any():
            return path
        direction = away / np.maximum(distance, 1e-9)[:, None]
        push = (lacking + 0.02)[:, None] * direction * (lacking > 0)[:, None]
        width = 2 + 6 * (round_ % 3)
        soft = gaussian_filter1d(push, width, axis=0, mode="nearest") * min(width, 3)
        path = path + np.where((lacking > 0)[:, None], push, 0) + np.where((lacking > 0)[:, None], 0, soft)
    place = path[int(np.argmax(lacking))].round(1)
    raise RefusedError(
        "flight",
        f"comes within {distance.min():.1f} m of the structure at {place}",
        f"{clearance_m:g} m free",
    )


def _lacking(path: Floats, distance: Floats, clearance_m: float) -> Floats:
    """Missing clearance of each pose, with half of that of its two segments."""
    step = leg_lengths(path)
    between = clearance_m - (distance[:-1] + distance[1:] - step) / 2
    lacking = clearance_m - distance
    lacking[:-1] = np.maximum(lacking[:-1], between)
    lacking[1:] = np.maximum(lacking[1:], between)
    return np.asarray(lacking)
