"""A simulated pilot who flies the paper's inspections round any structure of a kind.

The human hand has uneven speed, pauses to look, drift, and a gimbal that follows with a lag. The flown path
always stays at its distance from the structure and from the ground, also between the logged poses.
"""

import hashlib
import re
import zlib
from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated, leg_lengths
from upplied.geometry.poses import from_yaw_pitch, normalised
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Camera, Demonstration, Floats, Structure, Trajectory
from upplied.samples.inspections import Route, route_of

_FIRST_DAY_NS = 1_767_600_000_000_000_000  # 5 January 2026, 08:00 UTC
_HOUR_NS = 3_600_000_000_000
_STEP_M = 0.25
_RATE_HZ = 10.0
_TYPICAL_S = 105.0  # without pauses; the speed follows from the length of the route
_SLOWEST_MPS, _FASTEST_MPS = 0.4, 3.2
_UNEVENNESS = 0.27  # of the speed, one sigma
_PAUSES, _PAUSE_S = 3, (2.5, 6.0)
_DRIFT_M, _SHAKE_M = 0.22, 0.006  # one sigma, over some seconds, and from pose to pose
_GIMBAL_LAG_S, _GIMBAL_NOISE_DEG = 0.3, 1.2
_CLEARANCE_M, _ABOVE_GROUND_M = 2.1, 1.0  # of the whole path


def fly(structure: Structure, inspection: str, seed: int = 0, camera: Camera | None = None) -> Demonstration:
    """Demonstrate an inspection of `samples.inspections.INSPECTIONS`; nose, bow, hub or road are along +X.

    The pilot knows only the surface: fuselage, wings, engine, tower or piers are located on it, so that real
    meshes can be flown as well as the samples. The same seed of the hand gives the same flight; the camera is
    the paper's by default. The flight is named after structure and inspection, e.g. ``a320-fuselage-v1``. It
    stays 2 m from the surface and 1 m from the ground.

    Raises RefusedError if the structure lacks the inspected part, or there is no room to fly.
    """
    scene, floor = scene_of(structure), structure.floor_z_m
    stem = re.sub(r"-v\d+$", "", structure.structure_id)
    version = structure.structure_id[len(stem) :]
    name = f"{stem}-{inspection.replace('_', '-')}{version}"[:64]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    flown = _flown(route_of(structure, inspection, scene, floor), scene, floor, rng)
    quats = normalised(flown.quat_xyzw)
    poses = np.round(np.column_stack([flown.positions, quats]) * 1e7).astype("<i8")  # its identity, to 1e-7
    jitter = rng.integers(-1_500_000, 1_500_000, len(flown))
    start = _FIRST_DAY_NS + (seed % 1000) * _HOUR_NS
    return Demonstration(
        demonstration_id=name, structure_id=structure.structure_id, site=structure.site,
        t_ns=start + np.round(flown.t_s * 1e9).astype(np.int64) + jitter, clock="header",
        positions=flown.positions, quat_xyzw=quats, sha256=hashlib.sha256(poses.tobytes()).hexdigest(),
        camera=camera or Camera(width_px=1440, height_px=1440), operator="simulated pilot",
        notes=f"{inspection.replace('_', ' ')} inspection, simulated",
    )  # fmt: skip


def _flown(route: Route, scene: Scene, ground_z: float, rng: np.random.Generator) -> Trajectory:
    positions, look = _rounded(route)
    floor = ground_z + _ABOVE_GROUND_M
    positions = pushed_clear(positions, scene, _CLEARANCE_M + 0.9, floor)
    along = arc_length(positions)
    t, s = _pace(float(along[-1]), rng)
    flown = interpolated(s, along, positions)
    slow = np.column_stack([_coloured(len(t), 2.5 * _RATE_HZ, rng) for _ in range(3)])
    flown += _DRIFT_M * slow * (1, 1, 0.6) + _SHAKE_M * rng.standard_normal((len(t), 3))
    flown = pushed_clear(flown, scene, _CLEARANCE_M, floor)
    ahead = np.minimum(s + 0.5, along[-1])
    return Trajectory(t, flown, _gimbal(flown, interpolated(ahead, along, look), rng))


def _rounded(route: Route) -> tuple[Floats, Floats]:
    """The route at even steps with rounded corners."""
    along = arc_length(route.positions)
    places = np.linspace(0, along[-1], max(int(along[-1] / _STEP_M), 2))
    positions, look = (interpolated(places, along, each) for each in (route.positions, route.look))
    softened = partial(gaussian_filter1d, axis=0, mode="nearest")
    return softened(positions, 1.2 / _STEP_M), softened(look, 2.0 / _STEP_M)


def _pace(length_m: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Times and distances along the route: an uneven speed, from rest to rest, with pauses."""
    dt = 1 / _RATE_HZ
    speed = float(np.clip(length_m / _TYPICAL_S, _SLOWEST_MPS, _FASTEST_MPS))
    count = round(3 * length_m / speed / dt) + 400  # a quotient that is whole, but for the last bit
    wobble = _coloured(count, 4.0 / dt, rng)
    share = np.clip(np.exp(_UNEVENNESS * wobble - _UNEVENNESS**2 / 2), 0.4, 1.5)
    plan = np.cumsum(speed * share * dt)
    stops = np.sort(rng.uniform(0.08, 0.92, _PAUSES)) * length_m
    hold, added = np.ones(count), 0
    for stop in stops:
        at = int(np.searchsorted(plan, stop)) + added
        pause = int(rng.uniform(*_PAUSE_S) / dt)
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


def _coloured(count: int, sigma: float, rng: np.random.Generator) -> Floats:
    """Smooth noise of unit deviation."""
    noise = gaussian_filter1d(rng.standard_normal(count + int(8 * sigma)), sigma)[int(4 * sigma) :][:count]
    return np.asarray(noise * np.sqrt(2 * np.sqrt(np.pi) * sigma))


def _gimbal(positions: Floats, aim: Floats, rng: np.random.Generator) -> Floats:
    """Yaw and pitch that follow the aim through a first-order lag, with a little noise and no roll."""
    ray = aim - positions
    yaw = np.unwrap(np.arctan2(ray[:, 1], ray[:, 0]))
    pitch = np.arctan2(ray[:, 2], np.hypot(ray[:, 0], ray[:, 1]))
    angles = np.column_stack([yaw, np.clip(pitch, -np.pi / 2, np.pi / 6)])
    gain = 1 - np.exp(-1 / (_RATE_HZ * _GIMBAL_LAG_S))
    followed = angles.copy()
    for row in range(1, len(angles)):
        followed[row] = followed[row - 1] + gain * (angles[row] - followed[row - 1])
    noise = np.column_stack([_coloured(len(aim), 0.8 * _RATE_HZ, rng) for _ in range(2)])
    followed += np.radians(_GIMBAL_NOISE_DEG) * noise
    return from_yaw_pitch(followed[:, 0], np.clip(followed[:, 1], -np.pi / 2, np.pi / 6))


def pushed_clear(positions: Floats, scene: Scene, clearance_m: float, floor_z: float) -> Floats:
    """The path pushed away from the surface and the ground where it comes too near, smoothly.

    Distances change by at most the way flown, so that between two poses a m apart, at distances b
    and c, nothing comes nearer than (b + c - a) / 2: that bound is used.

    Raises RefusedError if pushing does not help: the route leads through a gap that is too narrow.
    """
    path = positions.copy()
    for round_ in range(80):
        path[:, 2] = np.maximum(path[:, 2], floor_z)
        away = path - scene.closest(path)[0]
        distance = np.linalg.norm(away, axis=1)
        # Missing clearance of each pose, and of its two segments.
        between = clearance_m - (distance[:-1] + distance[1:] - leg_lengths(path)) / 2
        lacking = clearance_m - distance
        lacking[:-1] = np.maximum(lacking[:-1], between)
        lacking[1:] = np.maximum(lacking[1:], between)
        near = (lacking > 0)[:, None]
        if not near.any():
            return path
        direction = away / np.maximum(distance, 1e-9)[:, None]
        push = (lacking + 0.02)[:, None] * direction * near
        width = 2 + 6 * (round_ % 3)
        soft = gaussian_filter1d(push, width, axis=0, mode="nearest") * min(width, 3)
        path = path + np.where(near, push, soft)
    place = path[int(np.argmax(lacking))].round(1)
    finding = f"comes within {distance.min():.1f} m of the structure at {place}"
    raise RefusedError("flight", finding, f"{clearance_m:g} m free")
