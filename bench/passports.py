"""What the rules for flights say of logs that none of them was made on: right ones, and spoilt ones.

Structures and flights are others than those of the tests: other random members, the real world's where a
folder holds them, and flights in rows, in spirals and obliquely ahead. Each row counts what was refused,
what was warned of by a rule that tells of geometry (not of what was assumed), and what passed.

    python bench/passports.py [logs for each row]
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from real_data import real_folder, real_structure
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from made_flights import FAULTS, NAMED, Log, log_of
from random_members import random_member

from upplied.errors import InputError
from upplied.geometry.poses import from_yaw_pitch, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.records import Demonstration, Structure

_KINDS = ("airliner", "box", "bridge", "ship", "wind_turbine")
_REAL = ("airplane/b738_fr24", "ship/ferry_88m", "building/house_1_osrf", "wind_turbine/enercon_e82_78m")
TELL = {
    "fits-otherwise", "little-off-centre", "velocity", "aim-drifts", "aim-off", "near-structure",
    "looks-aside", "fast", "clock-stepped", "gaps", "hovering", "zoom",
    "pitch-otherwise", "pitch-unset", "lens-differs", "jerky", "turns-fast",
}  # fmt: skip


@cache
def _structure(number: int) -> Structure:
    folder = real_folder()
    if folder is not None and number % 3 == 0:
        name = _REAL[number // 3 % len(_REAL)]
        try:
            return real_structure(folder, name)
        except (OSError, KeyError, InputError):
            pass
    return random_member(_KINDS[number % len(_KINDS)], 60 + number // 5).structure


@cache
def flight(number: int) -> Log:
    """The right log of this number: the first of its drafts that is an inspection.

    It keeps 3 m, and nine in ten of its looks meet the structure.
    """
    for draft in range(40):
        log = _draft(number, draft)
        scene = scene_of(log.structure)
        looks = Rotation.from_quat(log.quats[::5]).apply([1.0, 0.0, 0.0])
        meets = np.isfinite(scene.cast(log.positions[::5], looks)[0])
        if scene.distance(log.positions).min() >= 3.0 and meets.mean() >= 0.9:
            return log
    raise RuntimeError(f"no draft of flight {number} is an inspection")


def _draft(number: int, draft: int) -> Log:
    """Rows before a side, or a spiral."""
    rng = np.random.default_rng([number, draft, 90210])
    structure = _structure((number + draft // 8) % 24)
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    away, count = rng.uniform(5, 14), int(rng.integers(500, 1100))
    share = np.linspace(0, 1, count)
    if number % 3 == 0:  # rows, up and down before one long side, seen frontally
        rows = int(rng.integers(3, 7))
        along = np.abs((share * rows) % 2 - 1) * 2 - 1
        height = low[2] + 2 + np.floor(share * rows) / rows * max(high[2] - low[2] - 2, 1)
        side = rng.choice([-1.0, 1.0])
        places = np.column_stack(
            [middle[0] + along * half[0] * 0.9, np.full(count, middle[1] + side * (half[1] + away)), height]
        )
    else:
        turns = rng.uniform(0.6, 2.5) * rng.choice([-1.0, 1.0])
        angle = rng.uniform(0, 2 * np.pi) + 2 * np.pi * turns * share
        ring = np.column_stack([np.cos(angle), np.sin(angle)])
        reach = 1 / np.sqrt((ring**2 / (half[:2] + away) ** 2).sum(axis=1))
        height = low[2] + 2 + share * max(high[2] - low[2], 2.0)
        places = np.column_stack([middle[:2] + ring * reach[:, None], height])
    places = gaussian_filter1d(places, 8, axis=0, mode="nearest")
    scene = scene_of(structure)
    clear = scene.distance(places)
    outward = places - scene.closest(places)[0]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    places += outward * np.maximum(3.5 - clear, 0)[:, None]
    aim = gaussian_filter1d(scene.closest(places)[0], count / 50, axis=0, mode="nearest") - places
    yaw = np.arctan2(aim[:, 1], aim[:, 0]) + np.cumsum(rng.normal(0, 0.0015, count))
    pitch = np.arctan2(aim[:, 2], np.hypot(aim[:, 0], aim[:, 1])) + np.cumsum(rng.normal(0, 0.001, count))
    speed, step = rng.uniform(0.8, 3.5), np.linalg.norm(np.diff(places, axis=0), axis=1)
    t_s = np.concatenate([[0], np.cumsum(np.clip(step / speed, 0.02, 0.5))])
    t_ns = 1_770_000_000_000_000_000 + (t_s * 1e9).astype(np.int64)
    quats = from_yaw_pitch(yaw, np.clip(pitch, -1.4, 1.4))
    return log_of(structure, Demonstration("judged", structure.structure_id, t_ns, places, quats), rng)


def _spun(log: Log, angle: np.ndarray, whole: bool) -> Log:
    turn = Rotation.from_rotvec(np.column_stack([0 * angle, 0 * angle, np.radians(angle)]))
    places = turn.apply(log.positions) if whole else log.positions
    return replace(log, positions=places, quats=(turn * Rotation.from_quat(log.quats)).as_quat())


def _heading(start: float, end: float, whole: bool = False) -> Callable[[Log, np.random.Generator], Log]:
    return lambda log, rng: _spun(log, rng.choice([-1, 1]) * np.linspace(start, end, len(log)), whole)


def _beside(metres: float) -> Callable[[Log, np.random.Generator], Log]:
    def moved(log: Log, rng: np.random.Generator) -> Log:
        angle = rng.uniform(0, 2 * np.pi)
        return replace(log, positions=log.positions + metres * np.array([np.cos(angle), np.sin(angle), 0]))

    return moved


def _mirrored(log: Log, rng: np.random.Generator) -> Log:
    mirror = np.diag([1.0, -1.0, 1.0])
    turns = mirror @ Rotation.from_quat(log.quats).as_matrix() @ mirror
    return replace(log, positions=log.positions @ mirror, quats=Rotation.from_matrix(turns).as_quat())


def _pitched(factor: float) -> Callable[[Log, np.random.Generator], Log]:
    def pitched(log: Log, rng: np.random.Generator) -> Log:
        yaw, pitch = yaw_pitch(log.quats)
        return replace(log, quats=from_yaw_pitch(yaw, factor * pitch))

    return pitched


def _scaled(factor: float) -> Callable[[Log, np.random.Generator], Log]:
    return lambda log, rng: replace(log, positions=log.positions * factor)


def _drifting(share: float) -> Callable[[Log, np.random.Generator], Log]:
    def drifting(log: Log, rng: np.random.Generator) -> Log:
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(log.positions, axis=0), axis=1))])
        angle = rng.uniform(0, 2 * np.pi)
        away = np.array([np.cos(angle), np.sin(angle), 0.0])
        return replace(log, positions=log.positions + share * length[:, None] * away)

    return drifting


def _faster(factor: float) -> Callable[[Log, np.random.Generator], Log]:
    def faster(log: Log, rng: np.random.Generator) -> Log:
        return replace(log, t_ns=log.t_ns[0] + ((log.t_ns - log.t_ns[0]) / factor).astype(np.int64))

    return faster


SMALL: dict[str, Callable[[Log, np.random.Generator], Log]] = {
    "a heading that drifts by 20 deg": _heading(0, 20),
    "by 30 deg": _heading(0, 30),
    "by 45 deg": _heading(0, 45),
    "a heading that is off by 25 deg": _heading(25, 25),
    "by 40 deg": _heading(40, 40),
    "the whole path turning by 30 deg": _heading(0, 30, True),
    "the path 3 m beside where it was": _beside(3.0),
    "5 m": _beside(5.0),
    "mirrored with its headings": _mirrored,
    "a heading that is off by 15 deg": _heading(15, 15),
    "the gimbal's pitch of the wrong sign": _pitched(-1.0),
    "the gimbal's pitch missing": _pitched(0.0),
    "scale 0.85": _scaled(0.85),
    "scale 1.1": _scaled(1.1),
    "drifting by 2 % of its path": _drifting(0.02),
    "by 5 %": _drifting(0.05),
    "the path 2 m beside where it was": _beside(2.0),
    "three times as fast": _faster(3.0),
}


def judged(log: Log, path: Path) -> tuple[str, set[str]]:
    """What becomes of a log, and the rules that say something."""
    try:
        flight = read_demonstration(log.write(path), LogOptions(), structures=lambda name: log.structure)
    except InputError as error:
        return "refused", {str(error).split(": ")[1][:40]}
    rules = {item["rule"] for item in flight.passport["findings"]} & TELL
    return ("warned" if rules else "passed"), rules


def main() -> None:
    """Print the table."""
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    chosen = set(sys.argv[2:])
    print(f"{'':36}{'refused':>8}{'warned':>8}{'passed':>8}   by which rules")
    rows = {"right": lambda log, rng: log} | SMALL | FAULTS
    total: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for name, spoil in rows.items():
            if chosen and name not in chosen:
                continue
            counts: Counter[str] = Counter()
            rules: Counter[str] = Counter()
            for at in range(4 * number if name == "right" else number):
                result, fired = judged(
                    spoil(flight(at), np.random.default_rng([at, 5])), Path(folder) / "a.mcap"
                )
                counts[result] += 1
                rules.update(fired)
                if name in FAULTS:
                    total["told" if result == "refused" or NAMED.get(name) in fired else "silent"] += 1
            listed = ", ".join(f"{rule} {count}" for rule, count in rules.most_common(3))
            print(
                f"{name:36}{counts['refused']:8}{counts['warned']:8}{counts['passed']:8}   {listed}",
                flush=True,
            )
    print(f"large faults refused or named: {total['told']} of {total.total()}")


if __name__ == "__main__":
    main()
