"""Other conventions in which a log may have been written, each a mistake, and how well its poses fit in them.

The fit is the share of the poses that could be of an inspection.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.polylines import chosen_evenly
from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.geometry.scene import Scene
from upplied.geometry.vectors import unit
from upplied.inputs.flight.inspection import met_in_the_middle, phases_of
from upplied.inputs.flight.tracks import OPTICAL_R_CAMERA, Track, are_unit
from upplied.inputs.passport.sight import inside, left_of
from upplied.inputs.rules import CONVENTIONS
from upplied.inputs.schemas.geodetic import STRUCTURE
from upplied.records import Bools, Floats

Poses = tuple[Floats, Floats]  # positions (M, 3), quaternions (M, 4)
Change = Callable[[Floats, Floats], Poses]


@dataclass(frozen=True)
class Convention:
    """One way in which poses may have been meant, and what to write into the side-car then."""

    name: str
    words: str
    change: Change
    remedy: str = ""  # empty: `convention` with its name
    rare: float = 0.0  # by how much better it must fit than a mistake that is met more often
    of_camera: bool = False  # it is about the camera's poses, not about those that were logged

    @property
    def advice(self) -> str:
        remedy = self.remedy or f'convention = "{self.name}"'
        return f"if it is so, write {remedy} into the side-car" if "=" in remedy else remedy


def _looking(positions: Floats, quats: Floats, right: Rotation) -> Poses:
    return positions, (Rotation.from_quat(quats) * right).as_quat()


def _turned(positions: Floats, quats: Floats, first: float, last: float, whole: bool) -> Poses:
    """Headings, and positions too, turned to the left by so many degrees from end to end."""
    about = np.radians(np.linspace([0.0, 0, first], [0, 0, last], len(positions)))
    left = Rotation.from_rotvec(about)
    return (left.apply(positions) if whole else positions), (left * Rotation.from_quat(quats)).as_quat()


def _axes(
    places: Floats, quats: Floats, world: str = "", body: str = "x y z", positions: str = "x y z",
    factor: float = 1.0,
) -> Poses:  # fmt: skip
    """Positions, and what is seen, by the axes that are ours; without a world the positions alone."""
    if not world:
        return factor * (places @ _matrix(positions).T), quats
    turns = _matrix(world) @ Rotation.from_quat(quats).as_matrix() @ _matrix(body)
    return places @ _matrix(world).T, Rotation.from_matrix(turns).as_quat()


def _matrix(axes: str) -> Floats:
    return np.array([np.eye(3)["xyz".index(axis[-1])] * (1 - 2 * ("-" in axis)) for axis in axes.split()])


def _moved(positions: Floats, quats: Floats, offset: Floats | float = 0.0, factor: float = 1.0) -> Poses:
    """Positions elsewhere, with heights above the first pose in another unit."""
    return positions[0] + (positions - positions[0]) * (1.0, 1.0, factor) + offset, quats


_SPECIAL: dict[str, Change] = {
    "w-first": lambda p, q: (p, q[:, [1, 2, 3, 0]]),
    "inverse-quaternion": lambda p, q: (p, Rotation.from_quat(q).inv().as_quat()),
    "inverse-pose": lambda p, q: (-(back := Rotation.from_quat(q).inv()).apply(p), back.as_quat()),
    "pitch-sign": lambda p, q: (p, from_yaw_pitch(*(yaw_pitch(q) * np.array([[1.0], [-1.0]])))),
}


def _named(name: str, words: str, **axes: Any) -> Convention:
    change, of_camera = _SPECIAL.get(name, partial(_axes, **axes)), name == "pitch-sign"
    return Convention(name, words, change, rare=0.03 * of_camera, of_camera=of_camera)


#: What `convention` in a side-car may say.
NAMED: dict[str, Convention] = {name: _named(name, **row) for name, row in CONVENTIONS.items()}
#: The mistakes in logs of places on the Earth: those have no axes that could be others.
ON_EARTH = (
    Convention("heights-in-feet", "heights in feet", partial(_moved, factor=0.3048), "export metres"),
    Convention("heights-as-feet", "heights in metres read as feet", partial(_moved, factor=1 / 0.3048),
               "export metres"),
)  # fmt: skip


def converted(track: Track, name: str, of_camera: bool = False) -> Track:
    """The track, read in another convention than its schema's; as it is where the convention is not of it."""
    if not name or NAMED[name].of_camera != of_camera:
        return track
    good = are_unit(track.quat_xyzw)
    positions, quats = track.positions.copy(), track.quat_xyzw.copy()
    positions[good], quats[good] = NAMED[name].change(positions[good], quats[good])
    note = f"poses converted as requested: {NAMED[name].words}"
    return replace(track, positions=positions, quat_xyzw=quats).noted(note)


def _mounts() -> Iterator[Convention]:
    """The camera along another axis of what was tracked, or the optical frame taken for it."""
    yield Convention("optical", "poses of the camera's optical frame, z forward",
                     partial(_looking, right=OPTICAL_R_CAMERA), 'body_frame = "optical"')  # fmt: skip
    yield Convention("not-optical", "poses of the body, not of the optical frame",
                     partial(_looking, right=OPTICAL_R_CAMERA.inv()), 'body_frame = "body"')  # fmt: skip
    for yaw in (0, 90, 180, -90):
        for pitch in (0, 30, 45, 60, 90, -30, -45, -60, -90):
            if (yaw, pitch) == (0, 0) or (abs(pitch) == 90 and yaw):
                continue
            turn = Rotation.from_euler("ZY", [yaw, pitch], degrees=True)
            quat = ", ".join(f"{value:.4f}" for value in turn.as_quat())
            words = f"a camera turned {yaw:+d} deg to the left and {-pitch:+d} deg upwards on its body"
            remedy, change = f"body_T_camera_quat_xyzw = [{quat}]", partial(_looking, right=turn)
            yield Convention(f"mount {yaw:+d} {-pitch:+d}", words, change, remedy, 0.03)


def turns() -> Iterator[Convention]:
    """A frame, or headings, turned about the vertical, at once or more and more."""
    for degrees in range(10, 360, 10):
        angle = (degrees + 180) % 360 - 180
        quat = ", ".join(f"{v:.4f}" for v in Rotation.from_euler("z", -angle, degrees=True).as_quat())
        off, turned = f"{angle:+d} deg", partial(_turned, first=angle, last=angle)
        yield Convention(f"yaw offset {off}", f"the frame turned by {off} about the vertical",
                         partial(turned, whole=True), f"structure_quat_xyzw = [{quat}]", 0.05)  # fmt: skip
        yield Convention(f"heading offset {off}", f"headings off by {off}, positions right",
                         partial(turned, whole=False), "calibrate the compass", 0.05)  # fmt: skip
    for degrees in (-180, -120, -90, -60, -40, -20, 20, 40, 60, 90, 120, 180):
        for whole in (False, True):
            drifting = partial(_turned, first=0.0, last=-degrees, whole=whole)
            name, words = f"yaw drift {degrees:+d} deg", f"a yaw that drifts by {degrees:+d} deg"
            yield Convention(name, words, drifting, "correct the drift", 0.06)


def offsets(poses: Poses, scene: Scene) -> Iterator[Convention]:
    """Steps along the axes and their diagonals, some metres and some diagonals of the structure's box."""
    steps = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    steps = steps[np.abs(steps).sum(axis=1) > 0]
    away = (scene.box[0] + scene.box[1]) / 2 - np.median(poses[0], axis=0)
    moves = [size * step for size in (3.0, 6.0, 9.0, 12.0, 18.0, 25.0, 35.0, 50.0) for step in steps]
    moves += [away * (1, 1, 0), away * (0, 0, 1)]
    for offset in moves:
        name = f"offset {' '.join(f'{value:+.0f}' for value in offset)} m"
        words = f"positions off by {', '.join(f'{-value:+.0f}' for value in offset)} m"
        remedy = f"structure_position_m = [{', '.join(f'{-value:.1f}' for value in offset)}]"
        yield Convention(name, words, partial(_moved, offset=offset), remedy, 0.06)


MOUNTS = tuple(_mounts())


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
        self._poses: Poses = flown.positions, flown.quat_xyzw
        self._at = (flown.t_ns - self.track.t_ns[0]) * 1e-9 if self.timed else None

    def best_fits(self, enough: float = 2.0) -> tuple[float, list[Fit]]:
        """How well the poses fit as they are, alone from `enough` on, and what fits better, best first."""
        share = float(self._shares([self._poses])[0])
        if share >= enough:
            return share, []
        of_camera = (*(item for item in NAMED.values() if item.of_camera), *MOUNTS, *turns())
        others = [*of_camera, *offsets(self._poses, self.scene)]
        if self.track.parent == STRUCTURE:
            others = [replace(it, remedy=_PLACE) if it.remedy[:10] == "structure_" else it for it in others]
        tried = self._as_logged() + [(item, item.change(*self._poses)) for item in others]
        shares = self._shares([poses for _, poses in tried]) * self._moves([poses for _, poses in tried])
        candidates = [Fit(item, float(other)) for (item, _), other in zip(tried, shares, strict=True)]
        return share, sorted(candidates, key=lambda fit: fit.convention.rare - round(fit.share, 2))

    def steadier(self, ratio: float) -> tuple[Floats, Floats, list[Fit]]:
        """How unsteady the flight is, and is in other conventions, and those in which it is the steadier.

        Both are (4,), as of `_unsteadiness`. One is so much less, in a ratio, in a named convention, in which
        as many poses could be of an inspection; of the distance in one of the same scale.
        """
        as_given, ratios = _unsteadiness(self._poses, self.scene), np.array([ratio, ratio, NEARER, ratio])
        if (as_given < ratios * _STEADY).all():
            return as_given, as_given, []
        measured = [(_unsteadiness(poses, self.scene), item, poses) for item, poses in self._as_logged()]
        for varies, item, _ in measured:
            varies[2] = np.inf if item.name in _SCALES else varies[2]
        tried = [each for each in measured if (ratios * np.maximum(each[0], _STEADY) <= as_given).any()]
        poses = [self._poses, *(poses for *_, poses in tried)]
        share, *shares = (self._shares(poses) * self._moves(poses)).tolist()
        fitting = [(varies, Fit(item, fit)) for (varies, item, _), fit in zip(tried, shares, strict=True)]
        good = [each for each in fitting if each[1].share >= share - AS_WELL]
        best = sorted(good, key=lambda each: (-round(each[1].share, 2), *each[0]))
        return as_given, best[0][0] if best else as_given, [fit for _, fit in best]

    def _shares(self, poses: Sequence[Poses]) -> Floats:
        positions, quats = map(np.stack, zip(*poses, strict=True))
        return fits(positions, quats, self.scene, self.ground_m, self.reach_m, self._at)

    def _moves(self, poses: Sequence[Poses]) -> Bools:
        if self._at is None:
            return np.ones(len(poses), bool)
        steps = np.linalg.norm(np.diff([positions for positions, _ in poses], axis=1), axis=2)
        paces = steps / np.maximum(np.diff(self._at), 1e-9)
        return np.asarray(np.percentile(paces, 90, axis=1) >= _SLOWEST_MPS)

    def _as_logged(self) -> list[tuple[Convention, Poses]]:
        tried, thin = [], self.track
        for item in ON_EARTH if thin.parent == STRUCTURE else NAMED.values():
            if not item.of_camera:
                positions, quats = item.change(thin.positions, thin.quat_xyzw)
                changed = self.to_camera(replace(thin, positions=positions, quat_xyzw=quats))
                if len(changed) == len(self._poses[0]):
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
    axis meets the structure within reach (half: beside it); of whole logs, by times `at`, s, the inspection.
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
