"""Flights of a second simulator, and what the proof makes of them against an independent ray test.

    python bench/proof_second.py [--seeds N] [--only WORDS] [--worst]

The simulator follows CONVENTIONS.md alone and shares no code with `upplied.simulate`: a vehicle that goes
along its plan at a pace of its own, cuts corners, strays slowly, takes photos by the raw clock of its log; a
log with noise, that may be silent or off. What a flight showed, and how near it came, is told by rays and
distances to every triangle of the mesh (bench/proof_truth.py).

Claimed is what the proof says was seen for certain. A flight is wrong where more than 0.5 % of the area that
its plan shows is claimed and was not seen, or more than 2 % was seen and is not claimed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from proof_truth import least_distance, truly_seen

from upplied.config import CloudSettings
from upplied.errors import RefusedError
from upplied.planning.surface.samples import surface_samples
from upplied.proof.align import align
from upplied.proof.as_flown import as_flown
from upplied.records import Camera, Floats, Structure, Trajectory
from upplied.samples.fleet import sample_demonstrations, sample_structures
from upplied.scene import scene_of

_SAMPLES, _LONGEST_S, _BEAT_S = 1500, 300.0, 0.05


@dataclass(frozen=True)
class Flight:
    """What was truly flown and photographed, and what the log says of it; one clock."""

    truth: Trajectory
    photo_s: Floats
    log: Trajectory
    accuracy_m: float | None = None


@dataclass(frozen=True)
class Manner:
    """How a plan is flown and logged."""

    pace: float = 1.0
    paces: tuple[float, ...] = ()  # of equal parts of the plan
    pauses_s: tuple[tuple[float, float], ...] = ()  # at a share of the plan, how long
    backwards: bool = False
    ends: float = 1.0  # share of the plan
    farther_m: float = 0.0  # away from what it looks at
    beside_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # truly
    off_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # by the log alone
    off_deg: float = 0.0
    camera_off_deg: float = 0.0  # by the log alone
    silent: tuple[tuple[float, float], ...] = ()  # shares of the flight
    stuck: tuple[float, float] | None = None  # shares of the flight
    trigger_dead: tuple[float, float] | None = None
    lost_photos: float = 0.0
    photo_every_s: float = 1.0
    log_hz: float = 10.0
    accuracy_m: float | None = None
    tags: tuple[str, ...] = field(default=())


MANNERS: dict[str, Manner] = {
    "as planned": Manner(),
    "slower by 1.1": Manner(pace=1 / 1.1),
    "slower by 1.25": Manner(pace=0.8),
    "faster by 1.25": Manner(pace=1.25),
    "changing pace": Manner(paces=(0.8, 1.2, 0.9, 1.25, 1.0)),
    "hover of 120 s": Manner(pauses_s=((0.5, 120.0),)),
    "hover, trigger dead afterwards": Manner(pauses_s=((0.5, 120.0),), trigger_dead=(0.6, 1.0)),
    "five pauses": Manner(pauses_s=((0.1, 20.0), (0.3, 45.0), (0.5, 8.0), (0.7, 30.0), (0.9, 60.0))),
    "photos after a pause": Manner(pauses_s=((0.2, 60.0),), trigger_dead=(0.0, 0.35)),
    "silent for 12 %": Manner(silent=((0.4, 0.52),)),
    "three silences": Manner(silent=((0.2, 0.26), (0.5, 0.58), (0.8, 0.84)), paces=(1.0, 0.85, 1.2)),
    "backwards": Manner(backwards=True),
    "backwards and slower": Manner(backwards=True, pace=0.85, pauses_s=((0.4, 30.0),)),
    "broken off": Manner(ends=0.6),
    "every fifth photo lost": Manner(lost_photos=0.2),
    "log of 1 Hz": Manner(log_hz=1.0),
    "farther by 2.8 m": Manner(farther_m=2.8),
    "truly beside by 1.5 m": Manner(beside_m=(1.2, -0.9, 0.1)),
    "truly beside by 5 m": Manner(beside_m=(4.0, 2.8, 0.0)),
    "truly beside by 1.5 m, RTK": Manner(beside_m=(1.2, -0.9, 0.1), accuracy_m=0.05),
    "log off by 0.5 m and 1 deg": Manner(off_m=(0.4, 0.3, 0.0), off_deg=1.0),
    "log off by 3 m": Manner(off_m=(-2.4, 1.8, 0.2)),
    "logged camera off by 3 deg": Manner(camera_off_deg=3.0),
    "camera stuck": Manner(stuck=(0.0, 1.0)),
    "camera stuck for a third": Manner(stuck=(0.4, 0.73)),
}
#: Whose log is the truth but for its noise: it must not be moved beyond its stated error.
FAITHFUL = tuple(
    name for name, one in MANNERS.items() if not (any(one.off_m) or one.off_deg or one.camera_off_deg)
)


def flown(plan: Trajectory, manner: Manner, seed: int) -> Flight:
    """A plan flown in a manner."""
    rng = np.random.default_rng(seed)
    moments = _progress(plan, manner)
    t = np.arange(len(moments)) * _BEAT_S
    place = np.column_stack([np.interp(moments, plan.t_s, axis) for axis in plan.positions.T])
    ahead = _axes(plan.quat_xyzw)
    look = np.column_stack([np.interp(moments, plan.t_s, axis) for axis in ahead.T])
    look /= np.linalg.norm(look, axis=1, keepdims=True)
    place = place - manner.farther_m * look * [1, 1, 0] / np.maximum(np.hypot(*look[:, :2].T), 0.3)[:, None]
    place = _late(place, 0.3) + np.array(manner.beside_m)
    place += np.column_stack([_wander(len(t), 0.12, 8.0, rng) for _ in range(3)])
    yaw = np.unwrap(np.arctan2(look[:, 1], look[:, 0])) + np.radians(_wander(len(t), 0.4, 3.0, rng))
    pitch = np.arcsin(np.clip(look[:, 2], -1, 1)) + np.radians(_wander(len(t), 0.3, 3.0, rng))
    aim = _late(np.column_stack([yaw, pitch]), 0.15)
    if manner.stuck:
        first, last = (int(share * (len(t) - 1)) for share in manner.stuck)
        aim[first : last + 1] = aim[first]
    truth = Trajectory(t, place, _quaternions(aim))
    photo = np.arange(0.4, t[-1], manner.photo_every_s)
    photo = photo[rng.random(len(photo)) >= manner.lost_photos]
    if manner.trigger_dead:
        low, high = (share * t[-1] for share in manner.trigger_dead)
        photo = photo[(photo < low) | (photo > high)]
    return Flight(truth, photo, _logged(truth, aim, manner, rng), manner.accuracy_m)


def _progress(plan: Trajectory, manner: Manner) -> Floats:
    """The moment of the plan at each beat."""
    end = manner.ends * plan.t_s[-1]
    paces = manner.paces or (manner.pace,)
    stops = {round(share * end, 3): seconds for share, seconds in manner.pauses_s}
    found, at = [0.0], 0.0
    while at < end:
        pace = paces[min(int(len(paces) * at / plan.t_s[-1]), len(paces) - 1)]
        following = at + pace * _BEAT_S
        for stop in [stop for stop in stops if at < stop <= following]:
            found += [stop] * int(stops.pop(stop) / _BEAT_S)
        at = following
        found.append(min(at, end))
    moments = np.array(found)
    return plan.t_s[-1] - moments if manner.backwards else moments


def _logged(truth: Trajectory, aim: Floats, manner: Manner, rng: np.random.Generator) -> Trajectory:
    step = max(round(1 / manner.log_hz / _BEAT_S), 1)
    at = np.arange(0, len(truth), step)
    share = at / len(truth)
    for low, high in manner.silent:
        at, share = at[(share < low) | (share > high)], share[(share < low) | (share > high)]
    place = truth.positions[at] + 0.02 * rng.standard_normal((len(at), 3))
    middle, angle = truth.positions.mean(axis=0), np.radians(manner.off_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    place = (place - middle) @ turn.T + middle + np.array(manner.off_m)
    told = aim[at] + np.array([angle + np.radians(manner.camera_off_deg), 0.0])
    return Trajectory(truth.t_s[at], place, _quaternions(told))


def _axes(quats: Floats) -> Floats:
    """The x axis that each quaternion (N, 4), x y z w, turns into the structure frame."""
    x, y, z, w = quats.T
    return np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])


def _quaternions(aim: Floats) -> Floats:
    """Of yaw counter-clockwise and pitch upwards (N, 2), no roll."""
    (cy, sy), (cp, sp) = ((np.cos(each / 2), np.sin(each / 2)) for each in (aim[:, 0], -aim[:, 1]))
    found = np.column_stack([-sy * sp, cy * sp, sy * cp, cy * cp])
    return found * np.where(found[:, 3:] < 0, -1.0, 1.0)


def _late(values: Floats, time_s: float) -> Floats:
    """The values after a lag of first order."""
    found, at = np.empty_like(values), values[0].copy()
    for step, goal in enumerate(values):
        at = at + (goal - at) * (_BEAT_S / time_s)
        found[step] = at
    return found


def _wander(count: int, sigma: float, time_s: float, rng: np.random.Generator) -> Floats:
    keep = np.exp(-_BEAT_S / time_s)
    noise = rng.standard_normal(count) * sigma * np.sqrt(1 - keep**2)
    found, at = np.empty(count), sigma * float(rng.standard_normal())
    for step in range(count):
        at = keep * at + noise[step]
        found[step] = at
    return found


@dataclass(frozen=True)
class Outcome:
    """What came of one flight, % of the area that its plan shows, and m."""

    name: str
    claimed: float
    true: float
    false: float  # claimed and not seen
    lost: float  # seen and not claimed, as it can be known: not in silences
    assumed: float  # besides, if the correction is right
    assumed_false: float
    moved_m: float
    stated_m: float
    above_m: float  # of the clearance, beyond the true one while it was recorded
    refused: str = ""

    def __str__(self) -> str:
        if self.refused:
            return f"REFUSED {self.refused[:90]}"
        return (
            f"claimed {self.claimed:6.2f} true {self.true:6.2f} false {self.false:5.2f} "
            f"lost {self.lost:5.2f} assumed {self.assumed:5.2f} ({self.assumed_false:5.2f} false) "
            f"moved {self.moved_m:5.2f} stated {self.stated_m:5.2f} clearance {self.above_m:+5.2f}"
        )


class Place:
    """A structure, its plan, and the area that the plan shows by the independent test."""

    def __init__(self, structure: Structure, plan: Trajectory, camera: Camera) -> None:
        self.structure, self.plan = structure, plan
        self.scene = scene_of(structure)
        self.surface = surface_samples(structure, self.scene, CloudSettings(surface_samples=_SAMPLES))
        self.camera = replace(camera, max_range_m=min(camera.max_range_m, 30.0))
        self.required = truly_seen(structure, plan, self.surface, self.camera)

    def judged(self, name: str, flight: Flight) -> Outcome:
        """The flight by the proof, against the truth."""
        try:
            found = align(self.plan, flight.log, flight.accuracy_m)
        except RefusedError as refusal:
            return Outcome(name, *[float("nan")] * 9, refused=str(refusal))
        photos = flight.photo_s
        given = self.plan, np.empty(0), found, flight.log, self.surface, self.camera, self.scene
        said = as_flown(*given, photos)
        known = photos[_recorded(flight.log, photos)]
        truth = self._at(flight.truth, known)
        claimed, assumed = said.looks.seen & self.required, self.required & False
        if said.looks.assumed is not None:
            assumed = said.looks.assumed & self.required
        true = truth & self.required
        moved = float(np.linalg.norm(found.flown.positions - flight.log.positions, axis=1).max())
        recorded = flight.truth.positions[_recorded(flight.log, flight.truth.t_s)]
        share = self._share
        return Outcome(
            name, share(claimed), share(true), share(claimed & ~true), share(true & ~claimed),
            share(assumed), share(assumed & ~true), moved, found.place_error_m,
            said.clearance_m - least_distance(self.structure, recorded),
        )  # fmt: skip

    def _at(self, path: Trajectory, moments: Floats) -> np.ndarray:
        at = np.clip(np.round(moments / _BEAT_S).astype(int), 0, len(path) - 1)
        return truly_seen(self.structure, path.take(at), self.surface, self.camera)

    def _share(self, part: np.ndarray) -> float:
        return 100 * float(part.sum() / max(self.required.sum(), 1))


def _recorded(log: Trajectory, moments: Floats) -> np.ndarray:
    """Which moments lie between two poses of a log that are no more than 3 usual steps, or 1 s, apart."""
    after = np.clip(np.searchsorted(log.t_s, moments), 1, len(log) - 1)
    step = log.t_s[after] - log.t_s[after - 1]
    inside = (moments >= log.t_s[0]) & (moments <= log.t_s[-1])
    return inside & (step <= max(1.0, 3 * float(np.median(np.diff(log.t_s)))))


def main() -> None:
    """Print a line for each manner of flying, and how many flights were wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="flights of each path and manner")
    parser.add_argument("--only", default="", help="paths whose name contains this")
    parser.add_argument("--manner", default="", help="manners whose name contains this")
    parser.add_argument("--worst", action="store_true", help="print every flight")
    options = parser.parse_args()
    every: list[Outcome] = []
    for demonstration in sample_demonstrations():
        if options.only not in demonstration.demonstration_id:
            continue
        (structure,) = [s for s in sample_structures() if s.structure_id == demonstration.structure_id]
        path = demonstration.trajectory
        times = np.arange(0.0, min(path.t_s[-1], _LONGEST_S), 0.5)
        place = Place(structure, _thinned(path, times), demonstration.camera)
        for name, manner in MANNERS.items():
            if options.manner not in name:
                continue
            for seed in range(options.seeds):
                one = place.judged(name, flown(place.plan, manner, seed))
                every.append(one)
                if options.worst:
                    print(f"{demonstration.demonstration_id:22}{name:32}{one}", flush=True)
    _print(every)


def _thinned(path: Trajectory, times: Floats) -> Trajectory:
    at = np.searchsorted(path.t_s, times)
    return Trajectory(times, path.positions[at], path.quat_xyzw[at])


def _column(rows: list[Outcome], name: str, of: Callable[[Floats], float]) -> float:
    values = np.array([getattr(row, name) for row in rows if not row.refused])
    return of(values) if len(values) else float("nan")


def _print(every: list[Outcome]) -> None:
    print(f"{'manner':34}{'flights':>8}{'refused':>8}{'claimed':>9}{'true':>8}{'false':>7}{'most':>7}"
          f"{'lost':>7}{'most':>7}{'assumed':>9}{'moved m':>9}{'clear m':>9}")  # fmt: skip
    for name in dict.fromkeys(row.name for row in every):
        rows = [row for row in every if row.name == name]
        columns = [_column(rows, *each) for each in (
            ("claimed", np.mean), ("true", np.mean), ("false", np.mean), ("false", np.max), ("lost", np.mean),
            ("lost", np.max), ("assumed", np.mean), ("moved_m", np.max), ("above_m", np.max))]  # fmt: skip
        widths = (9, 8, 7, 7, 7, 7, 9, 9, 9)
        text = "".join(f"{value:{width}.2f}" for value, width in zip(columns, widths, strict=True))
        print(f"{name:34}{len(rows):8d}{sum(bool(row.refused) for row in rows):8d}{text}")
    known = [row for row in every if not row.refused]
    false, lost = (np.array([getattr(row, name) for row in known]) for name in ("false", "lost"))
    both = np.array([row.lost - (row.assumed - row.assumed_false) for row in known])
    true_logs = [row for row in known if row.name in FAITHFUL]
    print(f"{len(every)} flights, {len(every) - len(known)} refused")
    print(f"claimed and not true: at most 0.5 % in {np.mean(false <= 0.5):.1%}, most {false.max():.2f} %")
    print(
        f"true and not claimed: at most 2 % in {np.mean(lost <= 2):.1%}; nor assumed {np.mean(both <= 2):.1%}"
    )
    moved = [row for row in true_logs if row.moved_m > 0]
    beyond = sum(row.moved_m > row.stated_m for row in true_logs)
    print(f"true logs: {len(moved)} of {len(true_logs)} moved, {beyond} beyond their stated error")
    print(f"clearance over-stated by at most {max(row.above_m for row in known):+.3f} m")


if __name__ == "__main__":
    main()
