"""How a flight lies against its structure, as given and in other conventions, and how steady and level it is.

Clearance, height over ground, what the camera meets, and its aim: a pilot looks a little left and right of
the nearest surface; a wrong heading holds the aim, or turns it, aside.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, optical_axis
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.inputs.flight.inspection import met_in_the_middle, phases_of
from upplied.inputs.flight.tracks import Track
from upplied.inputs.passport.conventions import MOUNTS, NAMED, ON_EARTH, Convention, Poses, offsets, turns
from upplied.inputs.rules import CONVENTIONS
from upplied.inputs.schemas.geodetic import STRUCTURE
from upplied.records import Bools, Camera, Floats, Record, Structure

_PICTURE = 5  # rays along each side of a picture
# To the corners of a cube, the middles of its edges and faces, all a little askew: no grid of a mesh is hit.
_AROUND = np.stack(np.meshgrid(*[(-1.03, 0.02, 0.97)] * 3), axis=-1).reshape(-1, 3)
_AROUND = np.delete(_AROUND, 13, axis=0)


@dataclass(frozen=True, eq=False, repr=False)
class Sight(Record):
    """What is true of each of M poses."""

    clearance_m: Floats  # (M,) distance from the surface
    inside: Bools  # (M,) surrounded by the structure's surface
    height_m: Floats  # (M,) over the ground, or over the lowest point of the structure where none is declared
    range_m: Floats  # (M,) along the camera's axis to the structure; inf where it meets nothing
    shown: Floats  # (M,) share of the picture that shows the structure within the camera's range

    @property
    def meets(self) -> Bools:
        """(M,) whether the camera's axis meets the structure."""
        return np.asarray(np.isfinite(self.range_m))


def sight_of(
    positions: Floats, quat_xyzw: Floats, camera: Camera, structure: Structure, scene: Scene
) -> Sight:
    """Measure the camera's poses, (M, 3), m, and (M, 4), against the structure of this scene."""
    turns = Rotation.from_quat(quat_xyzw)
    ahead = turns.apply([1.0, 0.0, 0.0])
    range_m = scene.cast(positions, ahead)[0]
    across, up = (
        np.radians(angle) / 2 * np.linspace(-0.9, 0.9, _PICTURE)
        for angle in (min(camera.hfov_deg, 340.0), min(camera.vfov_deg, 170.0))
    )
    yaw, pitch = (part.ravel() for part in np.meshgrid(across, up))
    rays = optical_axis(from_yaw_pitch(yaw, pitch))
    directions = (turns.as_matrix() @ rays.T).swapaxes(1, 2).reshape(-1, 3)
    depth = scene.cast(np.repeat(positions, len(rays), axis=0), directions)[0].reshape(-1, len(rays))
    return Sight(
        clearance_m=scene.distance(positions),
        inside=inside(positions, scene),
        height_m=positions[:, 2] - structure.floor_z_m,
        range_m=range_m,
        shown=(depth <= camera.max_range_m).mean(axis=1),
    )


def inside(positions: Floats, scene: Scene) -> Bools:
    """Which positions (M,) the surface surrounds.

    Rays in 26 directions: all but two must hit, and of those most must cross the surface an odd
    number of times, which tells the inside of a body from a place between its parts.
    """
    surrounded = np.zeros(len(positions), bool)
    low, high = scene.box
    maybe = np.flatnonzero(((positions > low) & (positions < high)).all(axis=1))
    if len(maybe):
        starts = np.repeat(positions[maybe], len(_AROUND), axis=0)
        crossed = scene.hits(starts, np.tile(_AROUND, (len(maybe), 1))).reshape(-1, len(_AROUND))
        surrounded[maybe] = ((crossed > 0).mean(axis=1) > 0.9) & ((crossed % 2 == 1).mean(axis=1) > 0.6)
    return surrounded


_POSES = 300  # spread evenly over the flight
_LEVEL = 0.5  # least horizontal part of a direction that has a heading
_LEAST = 60  # poses that have a heading
_CLOSE_DEG = 12.0  # of the line: farther is a look at something else
_SHARE = 0.7  # of the poses that the line must explain
_ROUNDS = 5  # of fitting again, outliers counting less
_WIDTH_DEG = 10.0  # beyond which it counts less
_PITCHES_DEG = 8.0  # standard deviation of pitch and of the surface's elevation that is compared


@dataclass(frozen=True)
class Aim:
    """The straight line through the aim over time, both zero where there is none; and the pitch."""

    aim_drift_deg: float = 0.0  # from end to end, to the left of the nearest surface
    aim_off_deg: float = 0.0  # in the middle
    pitch_fit_pct: float = float("nan")  # correlation of the pitch with the elevation of the nearest surface
    pitch_span_deg: float = float("nan")  # of the pitch, nine tenths of the poses
    pitch_want_deg: float = 0.0  # elevation of the nearest surface, up or down, 75th percentile


def aim_of(positions: Floats, quat_xyzw: Floats, scene: Scene) -> Aim:
    """The camera's heading and pitch beside the nearest surface; poses are (M, 3), m, and (M, 4)."""
    some = chosen_evenly(len(positions), _POSES)
    ahead = optical_axis(quat_xyzw[some])
    near = scene.closest(positions[some])[0] - positions[some]
    near = unit(near)
    pitch, want = (np.degrees(np.arcsin(np.clip(part[:, 2], -1, 1))) for part in (ahead, near))
    fit = float("nan")
    if len(some) >= _LEAST and min(np.std(pitch), np.std(want)) > _PITCHES_DEG:
        fit = 100 * float(np.corrcoef(pitch, want)[0, 1])
    span = float(np.ptp(np.percentile(pitch, [5, 95]))) if len(some) >= _LEAST else float("nan")
    left = left_of(ahead, near)
    level = np.isfinite(left)
    line = _line(np.linspace(-0.5, 0.5, len(some))[level], left[level])
    return Aim(*line, fit, span, float(np.percentile(np.abs(want), 75)))


def left_of(ahead: Floats, near: Floats) -> Floats:
    """How far unit vectors (N, 3) point to the left of others, deg; NaN where one of the two is steep."""
    level = (np.hypot(*ahead[:, :2].T) > _LEVEL) & (np.hypot(*near[:, :2].T) > _LEVEL)
    across = near[:, 0] * ahead[:, 1] - near[:, 1] * ahead[:, 0]
    left = np.degrees(np.arctan2(across, (ahead[:, :2] * near[:, :2]).sum(axis=1)))
    return np.where(level, left, np.nan)


def _line(time: Floats, left: Floats) -> tuple[float, float]:
    """Slope and middle of the line that most angles (K,), deg, lie on; zeros where there is none."""
    if len(time) < _LEAST:
        return 0.0, 0.0
    rows, weight = np.column_stack([time, np.ones(len(time))]), np.ones(len(time))
    for _ in range(_ROUNDS):
        line = np.linalg.lstsq(rows * weight[:, None], left * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(np.abs(left - rows @ line) / _WIDTH_DEG, 1.0))
    near_line = np.abs(left - rows @ line) < _CLOSE_DEG
    thirds = [near_line[(time >= at) & (time < at + 1 / 3)] for at in (-0.5, -1 / 6, 1 / 6 - 1e-9)]
    if near_line.mean() < _SHARE or any(len(third) < _LEAST // 6 or third.mean() < 0.5 for third in thirds):
        return 0.0, 0.0
    return float(line[0]), float(line[1])


_COMPARED = 96  # of a flight, spread evenly, on which conventions are compared
# Logarithm of the stand-off, roll, deg, one over the least distance, 1/m, and how far the camera looks aside
# of the nearest surface, deg: no pilot keeps them better.
_STEADY = np.array([0.05, 1.0, 1 / 3, 5.0])
_HEADINGS = 30  # of the poses that are compared: fewer tell of no aim
NEARER = 2.0  # times nearer than in another convention: no pilot who might keep clear flies so
_SCALES = {name for name, row in CONVENTIONS.items() if "factor" in row} | {item.name for item in ON_EARTH}
AS_WELL = 0.02  # share of the poses by which what is steadier may fit worse
_SLOWEST_MPS = 0.2  # of the fastest tenth: shrunk to a point, every flight would look at its structure
_TIPPED = np.sin(np.radians(60.0)), np.cos(np.radians(110.0))  # rolled by so much, no camera inspects
_OF_FLIGHT = 0.5  # of the time in the air: of a whole log, an inspection that lasts less fits that much worse

_PLACE = "correct the structure's place on the Earth, or takeoff_alt_m, by as much"  # of logs on the Earth

ToCamera = Callable[[Track], Track]


@dataclass(frozen=True)
class Fit:
    """How well a convention fits: the share of the poses that an inspection could hold."""

    convention: Convention
    share: float


@dataclass
class Comparison:
    """Some poses of a flight, and what other conventions make of them."""

    track: Track  # clean, as logged
    to_camera: ToCamera  # makes of a track in the log's frame the camera's poses in the structure's
    scene: Scene
    ground_m: float  # height of the ground, structure frame; minus infinity where it is not known
    reach_m: float
    timed: bool = True  # the poses have times, and are not only numbered

    def __post_init__(self) -> None:
        self.track = self.track.take(chosen_evenly(len(self.track), _COMPARED))
        flown = self.to_camera(self.track)
        self._given: Poses = flown.positions, flown.quat_xyzw
        self._at = (flown.t_ns - self.track.t_ns[0]) * 1e-9 if self.timed else None

    def best_fits(self, enough: float = 2.0) -> tuple[float, list[Fit]]:
        """How well the poses fit as they are, and the conventions in which they would fit better, best first.

        No other convention is tried where a share that is `enough` fits as it is.
        """
        share = float(self._shares([self._given])[0])
        if share >= enough:
            return share, []
        of_camera = (*(item for item in NAMED.values() if item.of_camera), *MOUNTS, *turns())
        others = [*of_camera, *offsets(self._given, self.scene)]
        if self.track.parent == STRUCTURE:
            others = [replace(it, remedy=_PLACE) if it.remedy[:10] == "structure_" else it for it in others]
        tried = self._as_logged() + [(item, item.change(*self._given)) for item in others]
        shares = self._shares([poses for _, poses in tried]) * self._moves([poses for _, poses in tried])
        candidates = [Fit(item, float(other)) for (item, _), other in zip(tried, shares, strict=True)]
        return share, sorted(candidates, key=lambda fit: fit.convention.rare - round(fit.share, 2))

    def steadier(self, ratio: float) -> tuple[Floats, Floats, list[Fit]]:
        """How unsteady the flight is, and is in other conventions, and those in which it is the steadier.

        Both are (4,): the standard deviation of the logarithm of the stand-off, the roll, deg, one over the
        least distance, 1/m, and how far the camera looks aside of the nearest surface, deg. One is so much
        less, in a ratio, in a named convention, in which as many poses could be of an inspection; of the
        distance in one of the same scale.
        """
        as_given, ratios = _unsteadiness(self._given, self.scene), np.array([ratio, ratio, NEARER, ratio])
        if (as_given < ratios * _STEADY).all():
            return as_given, as_given, []
        measured = [(_unsteadiness(poses, self.scene), item, poses) for item, poses in self._as_logged()]
        for varies, item, _ in measured:
            varies[2] = np.inf if item.name in _SCALES else varies[2]
        tried = [each for each in measured if (ratios * np.maximum(each[0], _STEADY) <= as_given).any()]
        poses = [self._given, *(poses for *_, poses in tried)]
        share, *shares = (self._shares(poses) * self._moves(poses)).tolist()
        fitting = [(varies, Fit(item, fit)) for (varies, item, _), fit in zip(tried, shares, strict=True)]
        good = [each for each in fitting if each[1].share >= share - AS_WELL]
        best = sorted(good, key=lambda each: (-round(each[1].share, 2), *each[0]))
        return as_given, best[0][0] if best else as_given, [fit for _, fit in best]

    def _shares(self, poses: Sequence[Poses]) -> Floats:
        positions, quats = map(np.stack, zip(*poses, strict=True))
        return fits(positions, quats, self.scene, self.ground_m, self.reach_m, self._at)

    def _moves(self, poses: Sequence[Poses]) -> Bools:
        """Whether the flights move at all."""
        if self._at is None:
            return np.ones(len(poses), bool)
        steps = np.linalg.norm(np.diff([positions for positions, _ in poses], axis=1), axis=2)
        paces = steps / np.maximum(np.diff(self._at), 1e-9)
        return np.asarray(np.percentile(paces, 90, axis=1) >= _SLOWEST_MPS)

    def _as_logged(self) -> list[tuple[Convention, Poses]]:
        """The camera's poses by each named convention of what was logged, where it has all of them."""
        tried, thin = [], self.track
        for item in ON_EARTH if thin.parent == STRUCTURE else NAMED.values():
            if not item.of_camera:
                positions, quats = item.change(thin.positions, thin.quat_xyzw)
                changed = self.to_camera(replace(thin, positions=positions, quat_xyzw=quats))
                if len(changed) == len(self._given[0]):
                    tried.append((item, (changed.positions, changed.quat_xyzw)))
        return tried


def _unsteadiness(poses: Poses, scene: Scene) -> Floats:
    """Spread of the logarithm of the stand-off; roll, deg; 1 / distance, 1/m; look aside, deg, or NaN."""
    turns = Rotation.from_quat(poses[1]).as_matrix()
    roll_deg = np.degrees(np.arcsin(np.abs(turns[:, 2, 1]).clip(0, 1)))
    roll_deg[turns[:, 2, 2] < 0] = 90.0  # upside down
    near = scene.closest(poses[0])[0] - poses[0]
    stand_off = np.maximum(np.linalg.norm(near, axis=1), 0.05)
    left = left_of(turns[:, :, 0], unit(near))
    left = np.abs(left[np.isfinite(left)])
    aside = float(np.percentile(left, 75)) if len(left) >= _HEADINGS else np.nan
    return np.array([np.std(np.log(stand_off)), np.percentile(roll_deg, 90), 1 / stand_off.min(), aside])


def fits(
    positions: Floats, quats: Floats, scene: Scene, ground_m: float, reach_m: float, at: Floats | None = None
) -> Floats:
    """Share (C,) of the poses (C, M, 3) and (C, M, 4) that could be of an inspection.

    Such a camera is above the ground, outside the structure and not touching it, holds the horizon, and its
    axis meets the structure within reach; a pose counts half where only what is beside it does. Of whole
    logs, by the times `at` (M,), s, of their poses, the inspection alone counts.
    """
    count = positions.shape[:2]
    flat, turns = positions.reshape(-1, 3), Rotation.from_quat(quats.reshape(-1, 4))
    left, up = turns.apply([0.0, 1.0, 0.0])[:, 2], turns.apply([0.0, 0.0, 1.0])[:, 2]
    good = np.where((flat[:, 2] >= ground_m) & (np.abs(left) <= _TIPPED[0]) & (up >= _TIPPED[1]), 1.0, 0.0)
    where = np.flatnonzero(good)
    met = met_in_the_middle(flat[where], quats.reshape(-1, 4)[where], scene, reach_m)
    good[where] = np.mean([met[:, 0], met.any(axis=1)], axis=0)
    where = np.flatnonzero(good)
    good[where] *= scene.distance(flat[where]) >= 0.3
    where = np.flatnonzero(good)
    good[where] *= ~inside(flat[where], scene)
    shares = good.reshape(count).mean(axis=1)
    if at is None:
        return np.asarray(shares)
    for one, (places, fit) in enumerate(zip(positions, good.reshape(count), strict=True)):
        if (parts := phases_of(at, places, fit > 0, scene)) is not None:
            shares[one] = fit[parts.inspected(at)].mean() * min(1.0, parts.share / _OF_FLIGHT)
    return np.asarray(shares)
