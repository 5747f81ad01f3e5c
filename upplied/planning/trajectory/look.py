"""Turns of the camera, and small detours, that see what the carried flight misses (preset `recommended`).

Turning the camera costs no Frechet distance and little time, so it comes first: from which station
of the path could a missed sample be seen at all, and which few directions show most of them?
What no station can see is approached by bending the path smoothly towards a place that can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from upplied.config import RetimeSettings, VisibilitySettings
from upplied.planning.visibility.line_of_sight import visible
from upplied.poses import from_yaw_pitch, matrices, yaw_pitch
from upplied.records import Bools, Camera, Cloud, Floats, Ints, Record
from upplied.scene import Scene

_WORTH = 2e-4  # share of the whole need that a turn must add to be flown
_DIRECTIONS, _FEW_DIRECTIONS = 24, 4  # candidate directions at each station, and at each place off the path
_STATIONS = 160  # stations from which turns are considered
_STRIDE = 16  # of the poses that are asked first
_TUBE, _WAYS = 54, 26  # stations from which detours lead, and their directions
_PLACES = 150  # of the places to try, the most promising


@dataclass(frozen=True, eq=False, repr=False)
class Looks(Record):
    """Turns of the camera at stations of a path, in the order of the path."""

    station: Ints  # (L,) index of the station
    quat_xyzw: Floats  # (L, 4)
    gain: Floats  # (L,) need that each adds


@dataclass(frozen=True, eq=False, repr=False)
class Detours(Record):
    """Places off the path from which missed samples can be seen, the most useful first."""

    positions: Floats  # (D, 3) m
    quat_xyzw: Floats  # (D, 4)
    station: Ints  # (D,) nearest station of the path
    gain: Floats  # (D,)


@dataclass(frozen=True, eq=False, repr=False)
class View(Record):
    """What the search for views works on: the target's samples, and how much each is needed."""

    cloud: Cloud  # surface samples of the target with normals
    need: Floats  # (N,) m^2 of demonstrated surface that each sample answers for, 0 where none
    camera: Camera
    settings: VisibilitySettings
    limits: RetimeSettings
    scene: Scene

    def seen(self, positions: Floats, quat_xyzw: Floats) -> Bools:
        """(M, N) what these poses truly see of the needed samples; False for the others."""
        needed = np.flatnonzero(self.need > 0)
        seen = np.zeros((len(positions), len(self.need)), bool)
        seen[:, needed] = self.sees(positions, quat_xyzw, needed)
        return seen

    def sees(self, positions: Floats, quat_xyzw: Floats, asked: Ints) -> Bools:
        """(M, m) which of these samples each of these poses truly sees."""
        part = _part(self.cloud, asked)
        return visible(positions, quat_xyzw, part, self.camera, self.settings, self.scene).seen

    def covered(self, positions: Floats, quat_xyzw: Floats) -> Bools:
        """(N,) the needed samples that any of these poses truly sees."""
        needed = np.flatnonzero(self.need > 0)
        covered = np.zeros(len(self.need), bool)
        covered[needed] = self._shown(positions, quat_xyzw, needed, self.camera)
        return covered

    def reachable(self, positions: Floats, missing: Ints) -> Bools:
        """(m,) which missing samples any of these positions sees with the camera turned anywhere."""
        return self._shown(positions, _level(positions), missing, _turned_anywhere(self.camera))

    def reach(self, positions: Floats, missing: Ints) -> Bools:
        """(M, m) which missing samples each of these positions sees with the camera turned anywhere."""
        part, camera = _part(self.cloud, missing), _turned_anywhere(self.camera)
        return visible(positions, _level(positions), part, camera, self.settings, self.scene).seen

    def _shown(self, positions: Floats, quat_xyzw: Floats, asked: Ints, camera: Camera) -> Bools:
        """(m,) which of these samples any pose sees: few poses first, the others for what is left."""
        shown = np.zeros(len(asked), bool)
        for first in (0, _STRIDE // 2, _STRIDE // 4, 3 * _STRIDE // 4):
            left = np.flatnonzero(~shown)
            if len(left) == 0:
                break
            some = slice(first, None, _STRIDE)
            part = _part(self.cloud, asked[left])
            seen = visible(positions[some], quat_xyzw[some], part, camera, self.settings, self.scene).seen
            shown[left] = seen.any(axis=0)
        left = np.flatnonzero(~shown)
        rest = np.arange(len(positions)) % (_STRIDE // 4) != 0
        part = _part(self.cloud, asked[left])
        if len(left):
            seen = visible(positions[rest], quat_xyzw[rest], part, camera, self.settings, self.scene).seen
            shown[left] = seen.any(axis=0)
        return shown


def _level(positions: Floats) -> Floats:
    return np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1))


def _turned_anywhere(camera: Camera) -> Camera:
    return replace(camera, hfov_deg=360.0, vfov_deg=180.0)


def find_looks(positions: Floats, quat_xyzw: Floats, covered: Bools, view: View) -> Looks:
    """The fewest turns, greedily, that show what the path misses and could see.

    Parameters
    ----------
    positions, quat_xyzw : array, shape (M, 3) and (M, 4)
        Stations of the path and how the camera looks there.
    covered : array of bool, shape (N,)
        What is seen already.
    view : View
    """
    missing = np.flatnonzero((view.need > 0) & ~covered)
    if len(missing) == 0:
        return _no_looks()
    stations = stations_of(positions)
    reach = view.reach(positions[stations], missing)
    if not reach.any():
        return _no_looks()
    row, quat, shows = _directions(positions[stations], reach, missing, view, _DIRECTIONS)
    station = stations[row]
    turn = _axis_angle(quat, quat_xyzw[station])
    chosen, gain = _greedy(shows, view.need[missing], 1 - 0.3 * turn / np.pi, _WORTH * view.need.sum())
    order = np.argsort(station[chosen], kind="stable")
    return Looks(station[chosen][order], quat[chosen][order], gain[order])


def stations_of(positions: Floats) -> Ints:
    """The stations of a path (M, 3) from which turns are considered."""
    number = min(_STATIONS, len(positions))
    return np.unique(np.linspace(0, len(positions) - 1, number).astype(np.int64))


def find_detours(
    positions: Floats, covered: Bools, view: View, reach_m: Floats, allowed: Callable[[Floats], Bools]
) -> Detours:
    """Places near the path from which what no station can see is seen, the most useful first.

    Parameters
    ----------
    positions : array, shape (M, 3), m
    covered : array of bool, shape (N,)
    view : View
    reach_m : array, shape (3,), m
        How far a detour may lead from the path along each axis (an ellipsoid).
    allowed : callable
        Takes positions (K, 3), gives (K,) bool: free, high enough, inside the fence.
    """
    missing = np.flatnonzero((view.need > 0) & ~covered)
    if len(missing) == 0:
        return _no_detours()
    places, station = _places(positions, reach_m)
    free = allowed(places)
    places, station = places[free], station[free]
    reach = view.reach(places, missing)
    ease = 1 / (0.1 + np.sum(((places - positions[station]) / reach_m) ** 2, axis=1))
    promise = (reach @ view.need[missing]) * ease
    best = np.argsort(-promise, kind="stable")[:_PLACES]
    best = best[promise[best] > 0]
    if len(best) == 0:
        return _no_detours()
    row, quat, shows = _directions(places[best], reach[best], missing, view, _FEW_DIRECTIONS)
    row = best[row]
    chosen, gain = _greedy(shows, view.need[missing], ease[row], 2 * _WORTH * view.need.sum())
    return Detours(places[row[chosen]], quat[chosen], station[row[chosen]], gain)


def bend(positions: Floats, place: Floats, station: int, least_m: float = 0.0) -> Floats:
    """The path bent smoothly so that it passes through a place at one of its stations.

    The bend is a raised cosine over arc length, wide enough that it leaves the path at less than
    about 28 degrees, and at least `least_m` to each side.
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    offset = place - positions[station]
    width = max(3.0 * float(np.linalg.norm(offset)), least_m, 1e-6)
    distance = np.abs(along - along[station]) / width
    return positions + np.where(distance < 1, 0.5 + 0.5 * np.cos(np.pi * distance), 0)[:, None] * offset


def _directions(
    places: Floats, reach: Bools, missing: Ints, view: View, number: int
) -> tuple[Ints, Floats, Bools]:
    """Candidate orientations at places (P, 3) that reach some of the missing samples (P, m).

    For each candidate its place (C,), its orientation (C, 4), and which missing samples it shows (C, m):
    one towards the middle of what the place reaches, and up to `number` towards single samples.
    """
    points, need = view.cloud.points[missing], view.need[missing]
    rows, aims = [], []
    for place in np.flatnonzero(reach.any(axis=1)):
        hit = np.flatnonzero(reach[place])
        count = min(number, len(hit))
        chosen = hit[np.arange(count) * (len(hit) - 1) // max(count - 1, 1)]
        aims.append((need[hit] @ points[hit] / need[hit].sum())[None])
        aims.append(points[chosen])
        rows.append(np.full(1 + len(chosen), place))
    row = np.concatenate(rows)
    towards = np.concatenate(aims) - places[row]
    yaw = np.arctan2(towards[:, 1], towards[:, 0])
    pitch = np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))
    low, high = np.radians([view.limits.min_gimbal_pitch_deg, view.limits.max_gimbal_pitch_deg])
    quats = from_yaw_pitch(yaw, np.clip(pitch, low, high))
    half = np.radians([view.camera.hfov_deg, view.camera.vfov_deg]) / 2 * 0.98  # well inside the picture
    shown = _in_picture(places, row, matrices(quats), points, reach, half, view.camera.hfov_deg >= 180)
    return row, quats, shown


@njit(cache=True)
def _in_picture(
    places: Floats, row: Ints, axes: Floats, points: Floats, reach: Bools, half: Floats, round_: bool
) -> Bools:
    """Which of the points in reach fall into the picture of each orientation, (C, m)."""
    shown = np.zeros((len(row), len(points)), np.bool_)
    for index in range(len(row)):
        place, turn = places[row[index]], axes[index]
        for sample in range(len(points)):
            if not reach[row[index], sample]:
                continue
            x, y, z = 0.0, 0.0, 0.0
            for axis in range(3):
                ray = points[sample, axis] - place[axis]
                x += turn[axis, 0] * ray
                y += turn[axis, 1] * ray
                z += turn[axis, 2] * ray
            forward = np.hypot(x, y) if round_ else x
            across, up = abs(np.arctan2(y, x)), abs(np.arctan2(z, forward))
            shown[index, sample] = across <= half[0] and up <= half[1]
    return shown


def _greedy(shows: Bools, need: Floats, ease: Floats, worth: float) -> tuple[Ints, Floats]:
    """Rows chosen one after another by what they add times their ease, until none adds `worth`."""
    left = np.array(need, float)
    table = shows.astype(np.float32)
    chosen: list[int] = []
    gains: list[float] = []
    while True:
        gain = table @ left.astype(np.float32)
        best = int(np.argmax(gain * ease))
        if gain[best] <= worth:
            return np.array(chosen, np.int64), np.array(gains)
        chosen.append(best)
        gains.append(float(gain[best]))
        left[shows[best]] = 0.0


def _places(positions: Floats, reach_m: Floats) -> tuple[Floats, Ints]:
    """Places in the tube round the path within reach, and the station each is bent from."""
    station = np.unique(np.linspace(0, len(positions) - 1, min(_TUBE, len(positions))).astype(np.int64))
    ways = _sphere(_WAYS) * reach_m
    offsets = np.concatenate([share * ways for share in (0.35, 0.65, 0.98)])
    places = positions[station][:, None] + offsets
    return places.reshape(-1, 3), np.repeat(station, len(offsets))


def _sphere(number: int) -> Floats:
    """Evenly spread directions (number, 3) on a Fibonacci spiral."""
    index = np.arange(number) + 0.5
    height = 1 - 2 * index / number
    turn = np.pi * (1 + np.sqrt(5)) * index
    ring = np.sqrt(1 - height**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), height])


def _axis_angle(a_xyzw: Floats, b_xyzw: Floats) -> Floats:
    """Angle between the optical axes, rad."""
    (yaw_a, pitch_a), (yaw_b, pitch_b) = yaw_pitch(a_xyzw), yaw_pitch(b_xyzw)
    cosine = np.sin(pitch_a) * np.sin(pitch_b) + np.cos(pitch_a) * np.cos(pitch_b) * np.cos(yaw_a - yaw_b)
    return np.arccos(np.clip(cosine, -1, 1))


def _part(cloud: Cloud, index: Ints) -> Cloud:
    normals = None if cloud.normals is None else cloud.normals[index]
    return Cloud(points=cloud.points[index], normals=normals)


def _no_looks() -> Looks:
    return Looks(np.empty(0, np.int64), np.empty((0, 4)), np.empty(0))


def _no_detours() -> Detours:
    return Detours(np.empty((0, 3)), np.empty((0, 4)), np.empty(0, np.int64), np.empty(0))
