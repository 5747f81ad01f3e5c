"""How well the poses of a flight fit as given and in other conventions, and how steady and level they are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.inputs.flight.inspection import met_in_the_middle, phases_of
from upplied.inputs.flight.tracks import Track
from upplied.inputs.passport.conventions import MOUNTS, NAMED, ON_EARTH, Convention, Poses, offsets, turns
from upplied.inputs.passport.sight import inside, left_of
from upplied.inputs.rules import CONVENTIONS
from upplied.inputs.schemas.geodetic import STRUCTURE
from upplied.records import Bools, Floats

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


class Fit(NamedTuple):
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
        """How well the poses fit as they are (tried alone from `enough` on), and what fits better, best first."""
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
