"""Other conventions in which a log may have been written, and what each makes of its poses.

Each is a mistake of recorders or exporters; its fit is the share of the poses that could be of an inspection.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.geometry.scene import Scene
from upplied.inputs.flight.tracks import OPTICAL_R_CAMERA, Track, are_unit
from upplied.inputs.rules import CONVENTIONS
from upplied.records import Floats

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
        """What to write into the side-car if it is so."""
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
    """Rows of the axes that are x, y and z."""
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


def offsets(given: Poses, scene: Scene) -> Sequence[Convention]:
    """Steps along the axes and their diagonals, some metres and some diagonals of the structure's box."""
    steps = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    steps = steps[np.abs(steps).sum(axis=1) > 0]
    away = (scene.box[0] + scene.box[1]) / 2 - np.median(given[0], axis=0)
    moves = [size * step for size in (3.0, 6.0, 9.0, 12.0, 18.0, 25.0, 35.0, 50.0) for step in steps]
    moves += [away * (1, 1, 0), away * (0, 0, 1)]
    found = []
    for offset in moves:
        name = f"offset {' '.join(f'{value:+.0f}' for value in offset)} m"
        words = f"positions off by {', '.join(f'{-value:+.0f}' for value in offset)} m"
        remedy = f"structure_position_m = [{', '.join(f'{-value:.1f}' for value in offset)}]"
        found.append(Convention(name, words, partial(_moved, offset=offset), remedy, 0.06))
    return found


MOUNTS = tuple(_mounts())
