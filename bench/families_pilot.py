"""A pilot who goes round, or along, any part of any structure, where no inspection is written for it."""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import replace
from functools import partial
from itertools import pairwise, product

import numpy as np
from scipy.ndimage import gaussian_filter1d

from upplied.errors import RefusedError
from upplied.geometry.polylines import arc_length, interpolated
from upplied.geometry.poses import from_yaw_pitch, normalised
from upplied.geometry.scene import Scene, scene_of
from upplied.records import Camera, Demonstration, Floats, Structure
from upplied.samples.airframe import offset_outline
from upplied.samples.pilot import pushed_clear
from upplied.samples.surfaces import Member

CLEARANCE_M = 2.1  # of the whole path
_START_NS = 1_767_600_000_000_000_000
_RATE_HZ, _SPEED_MPS, _STEP_M = 5.0, 1.5, 0.25
_LONGEST_M, _MOST_LEVELS = 620.0, 4
_ABOVE_GROUND_M = 1.5
_UNEVENNESS, _DRIFT_M, _GIMBAL_NOISE_DEG = 0.15, 0.12, 0.8  # one sigma, over some seconds
_THIN_M, _SHORTEST_M = 9.0, 8.0  # a stretch without room that is flown round, and one that is worth flying
_RAYS = np.array([[0.61, 0.37, 0.7], [-0.53, 0.42, 0.74], [0.12, -0.66, 0.74], [0.3, 0.2, -0.93]])
_FARTHER = (1.0, 1.3, 1.7, 2.2)  # stand-offs tried where there is no room, as shares of the wanted one


def flown(member: Member, parts: tuple[str, ...], way: str, name: str) -> Demonstration:
    """A flight about the parts whose names begin with certain words.

    Parameters
    ----------
    member : Member
        The structure and its parts.
    parts : tuple of str
        What the names of the inspected parts begin with.
    way : {"round", "along"}
        Once round the part at each of a few heights, or to and fro along its longer side, on the left or
        in front.
    name : str
        Of the flight; its chance follows from it.

    Returns
    -------
    Demonstration
        At 3.5 to 8 m by the part's size, farther where there is no room, the camera aimed at the part's
        nearest place.

    Raises
    ------
    RefusedError
        Where there is no room.
    """
    structure = member.structure
    inspected, scene, floor = _part_of(member, parts), scene_of(structure), structure.floor_z_m
    refusal: RefusedError | None = None
    for thin_m, share in product((_THIN_M, 0.0), _FARTHER):
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        try:
            route = _cleared(_route(inspected, scene, way, share, thin_m), scene, floor)
            positions = pushed_clear(_paced(route, rng), scene, CLEARANCE_M, floor + _ABOVE_GROUND_M)
        except RefusedError as error:
            refusal = error
            continue
        return _logged(name, structure, positions, _gimbal(positions, scene_of(inspected), rng))
    assert refusal is not None
    raise refusal


def _part_of(member: Member, parts: tuple[str, ...]) -> Structure:
    """The inspected parts alone."""
    chosen = [number for number, name in enumerate(member.part_names) if name.startswith(parts)]
    triangles = member.structure.triangles[np.isin(member.part_of_triangle, chosen)]
    if not len(triangles):
        raise RefusedError(member.structure.structure_id, f"has no part named {' or '.join(parts)}")
    corners, places = np.unique(triangles, return_inverse=True)
    vertices = member.structure.vertices[corners]
    return replace(member.structure, vertices=vertices, triangles=places.reshape(-1, 3), sha256="")


def _route(inspected: Structure, scene: Scene, way: str, share: float, thin_m: float) -> Floats:
    """Lines at a few heights round the part there, or beside it, each as far as there is room."""
    points, floor = inspected.vertices, inspected.floor_z_m
    low, high = points[:, 2].min(), points[:, 2].max()
    off = share * float(np.clip(0.1 * np.linalg.norm(np.ptp(points, axis=0)), 3.5, 8.0))
    first = max(low + min(0.5 * off, 0.3 * (high - low)), floor + _ABOVE_GROUND_M + 0.5)
    last = max(high + 0.4 * off, first + 0.5 * off)
    number = int(np.clip(np.ceil((last - first) / (1.3 * off)), 2, _MOST_LEVELS))
    while True:
        heights = np.linspace(first, last, number) if number > 1 else np.array([(first + last) / 2])
        route = np.empty((0, 3))
        for height in heights:
            line = _line(points, way, off, height, (last - first) / number)
            if len(line := _open(line, scene, way == "round", thin_m)):
                route = np.concatenate([route, _from_nearest(line, route)])
        if not len(route):
            raise RefusedError(inspected.structure_id, f"there is no room at {off:.1f} m")
        if number == 1 or arc_length(route)[-1] < _LONGEST_M:
            return route
        number -= 1


def _line(points: Floats, way: str, off: float, height: float, band: float) -> Floats:
    """A loop at a height round what of the part is near that height, or a line beside all of it."""
    if way == "along":
        low, high = points.min(axis=0), points.max(axis=0)
        one, other = np.append(high[:2] + off, height), np.append(high[:2] + off, height)
        axis = int(np.argmax((high - low)[:2]))
        one[axis], other[axis] = low[axis], high[axis]
        return np.linspace(one, other, max(int((other - one)[axis] / 0.5), 2))
    level = np.clip(height, points[:, 2].min(), points[:, 2].max())
    near = points[np.abs(points[:, 2] - level) <= max(band, 2.0)]
    loop = offset_outline(near[:, :2] if len(near) > 8 else points[:, :2], off)
    return np.column_stack([loop, np.full(len(loop), height)])


def _open(line: Floats, scene: Scene, closed: bool, thin_m: float) -> Floats:
    """The longest stretch with room to fly; a whole loop is closed again.

    What is no body, and leaves no room for less than a length, is flown round.
    """
    shut = scene.distance(line) < CLEARANCE_M + 0.3
    inside = np.zeros(len(line), bool)
    for direction in _RAYS:  # what first leaves a body has begun in it
        reach, _, normal = scene.cast(line, np.broadcast_to(direction, line.shape))
        inside |= np.isfinite(reach) & (normal @ direction > 0)
    shut |= inside
    if closed and shut.any():
        turn = int(np.argmax(shut))
        line, shut, inside = (np.roll(some, -turn, axis=0) for some in (line, shut, inside))
    ends = [0, *(1 + np.flatnonzero(np.diff(shut))), len(line)]
    for one, other in pairwise(ends):
        if shut[one] and not inside[one:other].any() and 0.5 * (other - one) < thin_m:
            shut[one:other] = False
    if not shut.any():
        return np.vstack([line, line[:1]]) if closed else line
    ends = [0, *(1 + np.flatnonzero(np.diff(shut))), len(line)]
    one, other = max(pairwise(ends), key=lambda run: 0 if shut[run[0]] else run[1] - run[0])
    return line[one:other] if not shut[one] and 0.5 * (other - one) > _SHORTEST_M else line[:0]


def _from_nearest(line: Floats, before: Floats) -> Floats:
    """The line begun where it is nearest to the end of what was flown before."""
    if not len(before):
        return line
    away = np.linalg.norm(line - before[-1], axis=1)
    if np.allclose(line[0], line[-1]):
        turned = np.roll(line[:-1], -int(np.argmin(away[:-1])), axis=0)
        return np.vstack([turned, turned[:1]])
    return line if away[0] <= away[-1] else line[::-1]


def _rounded(route: Floats) -> Floats:
    """The route at even steps with rounded corners."""
    along = arc_length(route)
    dense = interpolated(np.linspace(0, along[-1], max(int(along[-1] / _STEP_M), 2)), along, route)
    return np.asarray(gaussian_filter1d(dense, 1.2 / _STEP_M, axis=0, mode="nearest"))


def _cleared(route: Floats, scene: Scene, floor: float) -> Floats:
    """The route pushed clear, twice, so that a push leaves no corners; refused where that is a way round."""
    length = arc_length(route)[-1]
    for more in (0.6, 0.4):
        route = pushed_clear(_rounded(route), scene, CLEARANCE_M + more, floor + _ABOVE_GROUND_M)
    if arc_length(route)[-1] > 1.3 * length + 10:
        raise RefusedError("flight", "there is no room to fly straight on")
    return route


def _paced(route: Floats, rng: np.random.Generator) -> Floats:
    """Poses along the route, from rest to rest at an uneven speed, with drift."""
    along = arc_length(route)
    count = int(2 * along[-1] / _SPEED_MPS * _RATE_HZ) + 100
    uneven = np.clip(1 + _UNEVENNESS * _coloured(count, 4 * _RATE_HZ, rng), 0.5, 1.5)
    step = _SPEED_MPS / _RATE_HZ
    at = [0.0]
    while at[-1] < along[-1] - 0.1 and len(at) < count:
        ease = np.clip(min(at[-1], along[-1] - at[-1]) / (2 * _SPEED_MPS), 0.1, 1)
        at.append(at[-1] + step * ease * uneven[len(at)])
    positions = interpolated(np.minimum(at, along[-1]), along, route)
    slow = np.column_stack([_coloured(len(at), 2.5 * _RATE_HZ, rng) for _ in range(3)])
    return positions + _DRIFT_M * slow


def _coloured(count: int, sigma: float, rng: np.random.Generator) -> Floats:
    """Smooth noise of unit deviation."""
    noise = gaussian_filter1d(rng.standard_normal(count + int(8 * sigma)), sigma)[int(4 * sigma) :][:count]
    return np.asarray(noise * np.sqrt(2 * np.sqrt(np.pi) * sigma))


def _gimbal(positions: Floats, inspected: Scene, rng: np.random.Generator) -> Floats:
    """Quaternions (N, 4) towards the nearest place of the part, followed softly, with a little noise."""
    soft = partial(gaussian_filter1d, sigma=1.0 * _RATE_HZ, axis=0, mode="nearest")
    ray = soft(inspected.closest(positions)[0]) - positions
    yaw = np.unwrap(np.arctan2(ray[:, 1], ray[:, 0]))
    pitch = np.arctan2(ray[:, 2], np.hypot(ray[:, 0], ray[:, 1]))
    noise = np.column_stack([_coloured(len(positions), _RATE_HZ, rng) for _ in range(2)])
    angles = np.column_stack([yaw, pitch]) + np.radians(_GIMBAL_NOISE_DEG) * noise
    return normalised(from_yaw_pitch(angles[:, 0], np.clip(angles[:, 1], -np.pi / 2, np.pi / 6)))


def _logged(name: str, structure: Structure, positions: Floats, quats: Floats) -> Demonstration:
    """The poses as a log, at an even rate."""
    poses = np.round(np.column_stack([positions, quats]) * 1e7).astype("<i8")
    return Demonstration(
        demonstration_id=name[:64], structure_id=structure.structure_id, site=structure.site,
        t_ns=_START_NS + np.arange(len(positions)) * round(1e9 / _RATE_HZ), clock="header",
        positions=positions, quat_xyzw=quats, sha256=hashlib.sha256(poses.tobytes()).hexdigest(),
        camera=Camera(width_px=1440, height_px=1440), operator="simulated pilot", notes="simulated",
    )  # fmt: skip
