"""The second simulator: flights of a plan in many manners, and what their logs say.

It follows CONVENTIONS.md alone and shares no code with `upplied.simulate`: a vehicle that goes along its plan
at a pace of its own, cuts corners, strays slowly, takes photos by the raw clock of its log; a log with noise,
that may be silent or off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.records import Floats, Trajectory

BEAT_S = 0.05


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
    mission: str = ""  # another one that is flown instead: a ring round the structure


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
    "log off by 1 m forward": Manner(off_m=(1.0, 0.0, 0.0)),
    "log off by 1 m to the side": Manner(off_m=(0.0, 1.0, 0.0)),
    "log off by 1 m upwards": Manner(off_m=(0.0, 0.0, 1.0)),
    "log off by 2 deg": Manner(off_deg=2.0),
    "log off by 1 m, silent": Manner(off_m=(0.6, -0.8, 0.0), silent=((0.4, 0.52),)),
    "log off by 1 m, broken off": Manner(off_m=(0.6, -0.8, 0.0), ends=0.6),
    "log off by 1 m, slower": Manner(off_m=(-0.6, 0.8, 0.0), pace=0.85),
    "logged camera off by 3 deg": Manner(camera_off_deg=3.0),
    "camera stuck": Manner(stuck=(0.0, 1.0)),
    "camera stuck for a third": Manner(stuck=(0.4, 0.73)),
    "another mission": Manner(mission="ring"),
}
#: Whose log is the truth but for its noise: it must not be moved beyond its stated error.
FAITHFUL = tuple(
    name for name, one in MANNERS.items() if not (any(one.off_m) or one.off_deg or one.camera_off_deg)
)


def flown(plan: Trajectory, manner: Manner, seed: int) -> Flight:
    """A plan flown in a manner."""
    rng = np.random.default_rng(seed)
    if manner.mission:
        plan = ring(plan)
    moments = _progress(plan, manner)
    t = np.arange(len(moments)) * BEAT_S
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


def ring(plan: Trajectory) -> Trajectory:
    """Twice round all that a plan comes by, 3 m outside of it, with the camera on its middle."""
    low, high = plan.positions.min(axis=0), plan.positions.max(axis=0)
    middle, reach = (low + high) / 2, (high - low) / 2 + 3.0
    t = np.arange(0.0, plan.t_s[-1], 0.5)
    angle = 4 * np.pi * t / t[-1]
    off = np.column_stack([reach[0] * np.cos(angle), reach[1] * np.sin(angle), np.full(len(t), 0.5)])
    yaw = np.unwrap(np.arctan2(-off[:, 1], -off[:, 0]))
    return Trajectory(t, middle + off, _quaternions(np.column_stack([yaw, np.zeros(len(t))])))


def _progress(plan: Trajectory, manner: Manner) -> Floats:
    """The moment of the plan at each beat."""
    end = manner.ends * plan.t_s[-1]
    paces = manner.paces or (manner.pace,)
    stops = {round(share * end, 3): seconds for share, seconds in manner.pauses_s}
    times, at = [0.0], 0.0
    while at < end:
        pace = paces[min(int(len(paces) * at / plan.t_s[-1]), len(paces) - 1)]
        following = at + pace * BEAT_S
        for stop in [stop for stop in stops if at < stop <= following]:
            times += [stop] * int(stops.pop(stop) / BEAT_S)
        at = following
        times.append(min(at, end))
    moments = np.array(times)
    return plan.t_s[-1] - moments if manner.backwards else moments


def _logged(truth: Trajectory, aim: Floats, manner: Manner, rng: np.random.Generator) -> Trajectory:
    step = max(round(1 / manner.log_hz / BEAT_S), 1)
    at = np.arange(0, len(truth), step)
    share = at / len(truth)
    for low, high in manner.silent:
        at, share = at[(share < low) | (share > high)], share[(share < low) | (share > high)]
    place = truth.positions[at] + 0.02 * rng.standard_normal((len(at), 3))
    middle, angle = truth.positions.mean(axis=0), np.radians(manner.off_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    place = (place - middle) @ turn.T + middle + np.array(manner.off_m)
    commanded = aim[at] + np.array([angle + np.radians(manner.camera_off_deg), 0.0])
    return Trajectory(truth.t_s[at], place, _quaternions(commanded))


def _axes(quats: Floats) -> Floats:
    """The x axis that each quaternion (N, 4), x y z w, turns into the structure frame."""
    x, y, z, w = quats.T
    return np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])


def _quaternions(aim: Floats) -> Floats:
    """Of yaw counter-clockwise and pitch upwards (N, 2), no roll."""
    (cy, sy), (cp, sp) = ((np.cos(each / 2), np.sin(each / 2)) for each in (aim[:, 0], -aim[:, 1]))
    quats = np.column_stack([-sy * sp, cy * sp, sy * cp, cy * cp])
    return quats * np.where(quats[:, 3:] < 0, -1.0, 1.0)


def _late(values: Floats, time_s: float) -> Floats:
    """The values after a lag of first order."""
    smoothed, at = np.empty_like(values), values[0].copy()
    for step, goal in enumerate(values):
        at = at + (goal - at) * (BEAT_S / time_s)
        smoothed[step] = at
    return smoothed


def _wander(count: int, sigma: float, time_s: float, rng: np.random.Generator) -> Floats:
    keep = np.exp(-BEAT_S / time_s)
    noise = rng.standard_normal(count) * sigma * np.sqrt(1 - keep**2)
    wander, at = np.empty(count), sigma * float(rng.standard_normal())
    for step in range(count):
        at = keep * at + noise[step]
        wander[step] = at
    return wander
