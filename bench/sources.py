"""One known flight in every form that is read, and conventions that were mistaken in some of them.

    python bench/sources.py          the table of forms
    python bench/sources.py 500      besides, so many logs in a wrong convention, over all forms
    python bench/sources.py 500 500  the same of other flights: those from number 500 on

Forms: the largest error of position, attitude and time beside the flight that was written. Conventions: right
right logs must be read, wrong ones refused, with the name of the convention where it has one, or warned of.
Of those that are read it counts how many no pose can tell: as far from the structure as in the right log, and
as far from it along the camera's axis, within 0.3 m in nine of ten poses.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from made_flights import Log, right
from made_logs import Flight, flight
from made_sources import UNTIMED, WRITERS
from passports import TELL

from upplied.errors import InputError
from upplied.geometry.poses import angle_between, from_yaw_pitch, optical_axis, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.passport.fits import NAMED, Change
from upplied.inputs.rules import CONVENTIONS

_POSES = 300  # of a flight that is written in a wrong convention
_LOCAL = (  # forms whose frame is the log's own
    "mcap", "ros1", "ros2", "ulog", "tum", "euroc", "kitti", "opensfm", "colmap text", "colmap binary",
    "nerfstudio", "bundler",
)  # fmt: skip
_ON_EARTH = ("dataflash", "tlog", "photos", "metashape", "realitycapture", "captions", "airdata")
_TAKEOFF_Z_M = -10.0  # of the flights in `made_sources`


def _heading(turn: Callable[[np.ndarray], np.ndarray]) -> Change:
    def turned(positions: np.ndarray, quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        yaw, pitch = yaw_pitch(quats)
        return positions, from_yaw_pitch(turn(yaw), pitch)

    return turned


def _from_nose(positions: np.ndarray, quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The gimbal's yaw from the nose of an aircraft that flies ahead, written as if from north."""
    step = np.gradient(positions, axis=0)
    return _heading(lambda yaw: yaw - np.unwrap(np.arctan2(step[:, 1], step[:, 0])))(positions, quats)


def _level(positions: np.ndarray, quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return positions, from_yaw_pitch(yaw_pitch(quats)[0], np.zeros(len(quats)))


def _raised(by: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda positions, quats: (np.column_stack([positions[:, :2], by(positions[:, 2])]), quats)


def _aside(metres: float) -> Change:
    return lambda positions, quats: (positions + np.array([metres, 0.0, 0.0]), quats)


#: Mistakes in logs of places on the Earth and angles of a gimbal.
_OF_THE_EARTH: dict[str, Change] = {
    "pitch of the wrong sign": NAMED["pitch-sign"].change,
    "no pitch of the gimbal": _level,
    "yaw from the nose": _from_nose,
    "yaw counter-clockwise": _heading(lambda yaw: -yaw),
    "yaw from the east": _heading(lambda yaw: yaw + np.pi / 2),
    "yaw of the back": _heading(lambda yaw: yaw + np.pi),
    "compass off by 40 degrees": _heading(lambda yaw: yaw + np.radians(40)),
    "heights in feet": _raised(lambda z: _TAKEOFF_Z_M + (z - _TAKEOFF_Z_M) / 0.3048),
    "feet taken for metres": _raised(lambda z: _TAKEOFF_Z_M + (z - _TAKEOFF_Z_M) * 0.3048),
    "heights above the sea": _raised(lambda z: z - 47.0),
    "heights of another take-off": _raised(lambda z: z + 12.0),
    "placed 20 m aside": _aside(20.0),
}


def forms() -> None:
    """Print the errors of each form."""
    print(f"{'form':16}{'position mm':>12}{'attitude deg':>14}{'time ms':>10}")
    for form, write in WRITERS.items():
        flown = flight(1200, 10.0)
        step = 30 if form == "photos" else 10
        flown = Flight(*(part[::step] for part in (flown.t_ns, flown.positions, flown.quat_xyzw)))
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "flight" if form in ("photos", "ros2") else Path(folder)
            path, facts = write(place, flown)
            reading = read_demonstration(path, LogOptions(structure_id="tank", **facts))
        off_m = np.abs(reading.positions - flown.positions).max()
        turned = np.degrees(angle_between(reading.quat_xyzw, flown.quat_xyzw)).max()
        late_ns = np.abs(
            reading.t_ns - flown.t_ns - (reading.t_ns[0] - flown.t_ns[0]) * (form == "kitti")
        ).max()
        late = "none" if form in UNTIMED else f"{late_ns * 1e-6:.3f}"
        print(f"{form:16}{1000 * off_m:12.3f}{turned:14.5f}{late:>10}", flush=True)


def judged(log: Log, form: str, folder: Path, convention: str = "") -> str:
    """What becomes of a log: read, warned of, refused, or named with the convention that it is written in."""
    some = np.unique(np.linspace(0, len(log) - 1, _POSES).astype(int))
    place = Path(tempfile.mkdtemp(dir=folder))
    path, facts = WRITERS[form](place, Flight(log.t_ns[some], log.positions[some], log.quats[some]))
    options = LogOptions(**(facts | {"structure_id": log.structure.structure_id, "max_dropped": 1.0}))
    try:
        flight = read_demonstration(path, options, structures=lambda name: log.structure)
    except InputError as error:
        return "named" if convention and f"({convention})" in str(error) else "refused"
    return "warned of" if {item["rule"] for item in flight.passport["findings"]} & TELL else "read"


def indistinguishable(log: Log, wrong: Log) -> bool:
    """Whether a wrong log is of a flight like the right one, mirrored or turned beside its structure."""
    scene = scene_of(log.structure)
    distances = [(scene.distance(each.positions), scene.cast(each.positions, optical_axis(each.quats))[0])
             for each in (log, wrong)]  # fmt: skip
    near, ahead = (np.abs(np.minimum(one, 1e3) - np.minimum(other, 1e3)) < 0.3
                   for one, other in zip(*distances, strict=True))  # fmt: skip
    return bool((near & ahead).mean() >= 0.9)


def written_in(name: str, positions: np.ndarray, quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses as a log in a named convention holds them: what its change makes right again."""
    if (factor := CONVENTIONS[name].get("factor")) is not None:
        return positions / factor, quats
    poses = positions, quats
    for _ in range(4):  # as often done as it has axes, a change is undone
        changed = NAMED[name].change(*poses)
        if np.allclose(changed[0], positions) and angle_between(changed[1], quats).max() < 1e-5:
            return poses
        poses = changed
    raise ValueError(name)


def conventions(count: int, first: int = 0) -> None:
    """Print what becomes of right logs, and of wrong ones: every mistake in every form in turn."""
    total: dict[str, Counter[str]] = {"right": Counter()}
    cases: list[tuple[str, str, Change]] = [
        (name, form, partial(written_in, name)) for name in NAMED for form in _LOCAL
    ]
    cases += [(name, form, change) for name, change in _OF_THE_EARTH.items() for form in _ON_EARTH]
    order = np.random.default_rng(1).permutation(len(cases))
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, first + count):
            name, form, change = cases[order[number % len(cases)]]
            log = right(number % 24)
            quats = log.quats / np.linalg.norm(log.quats, axis=1, keepdims=True)
            positions, turns = change(log.positions, quats)
            wrong = replace(log, positions=positions, quats=turns)
            result = judged(wrong, form, Path(folder), name)
            total.setdefault(name, Counter())[result] += 1
            total[name]["no pose tells"] += result in ("read", "warned of") and indistinguishable(log, wrong)
            if number % 5 == 0:
                total["right"][judged(log, form, Path(folder))] += 1
    results = ("named", "refused", "warned of", "read", "no pose tells")
    print(f"{'':30}" + "".join(f"{result:>14}" for result in results))
    for name, counts in total.items():
        print(f"{name:30}" + "".join(f"{counts[result]:14}" for result in results))
    wrong = sum((counts for name, counts in total.items() if name != "right"), Counter())
    print(f"{'all that are wrong':30}" + "".join(f"{wrong[result]:14}" for result in results))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        forms()
    if len(sys.argv) > 1:
        conventions(*map(int, sys.argv[1:3]))
