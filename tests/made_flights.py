"""Logs of flights that are right, and the ways in which logs of flights go wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
from made_logs import Topic, header, message, transform, write_log
from random_members import random_member
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.records import Demonstration, Structure
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

POSE, ODOMETRY, TF = (
    "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage",
)  # fmt: skip
INSPECTIONS = {
    "airliner": ("fuselage", "wings", "engine_left"),
    "wind_turbine": ("tower",),
    "ship": ("hull",),
    "box": ("sides",),
    "bridge": ("piers",),
}
HALF = np.sqrt(0.5)
NED_R_ENU = Rotation.from_quat([HALF, HALF, 0, 0])
FRD_R_FLU = Rotation.from_quat([1, 0, 0, 0])
OPTICAL = Rotation.from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # body to optical: z ahead, x right


@dataclass
class Log:
    """A log before it is written: poses in the order in which they are recorded."""

    structure: Structure
    t_ns: np.ndarray
    log_ns: np.ndarray
    positions: np.ndarray
    quats: np.ndarray
    schema: str = POSE
    frames: list[str] = field(default_factory=list)
    children: list[str] = field(default_factory=list)
    hfov_deg: np.ndarray | None = None
    info_ns: np.ndarray | None = None  # of the calibrations, where their clock is another
    extra: list[Topic] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t_ns)

    def take(self, index: np.ndarray) -> Log:
        """The poses of this index."""
        changes = {name: getattr(self, name)[index] for name in ("t_ns", "log_ns", "positions", "quats")}
        for name in ("frames", "children"):
            changes[name] = [getattr(self, name)[i] for i in np.arange(len(self))[index]]
        if self.hfov_deg is not None:
            changes["hfov_deg"] = self.hfov_deg[index]
        return replace(self, **changes)

    def write(self, path: Path) -> Path:
        """The log."""
        rows = zip(
            self.t_ns, self.log_ns, self.positions, self.quats, self.frames, self.children, strict=True
        )
        messages = [
            (int(log), message(self.schema, int(t), p, q, frame, child))
            for t, log, p, q, frame, child in rows
        ]
        topics = [Topic("/camera/pose", self.schema, messages), *self.extra]
        if self.hfov_deg is not None:
            focal = 720 / np.tan(np.radians(self.hfov_deg) / 2)
            infos = []
            clocks = (self.log_ns[::10], self.t_ns[::10]) if self.info_ns is None else (self.info_ns,) * 2
            for log, t, f in zip(*clocks, focal[::10], strict=True):
                info = {"header": header(int(t), ""), "width": 1440, "height": 1440, "distortion_model": ""}
                info |= {"d": [], "k": [f, 0, 720, 0, f, 720, 0, 0, 1], "r": [0.0] * 9, "p": [0.0] * 12}
                infos.append((int(log), info))
            topics.append(Topic("/camera/info", "sensor_msgs/msg/CameraInfo", infos))
        facts = {"structure_id": self.structure.structure_id, "body_frame": "camera"} | self.facts
        return write_log(path, topics, {name: value for name, value in facts.items() if value})


def log_of(structure: Structure, flown: Demonstration, rng: np.random.Generator) -> Log:
    """A right log of a flight, as one of several recorders would write it."""
    every = int(rng.choice([1, 1, 2]))
    t_ns, count = flown.t_ns[::every], len(flown.t_ns[::every])
    log_ns = t_ns + rng.integers(1_000_000, 12_000_000, count)
    log = Log(
        structure,
        t_ns,
        np.maximum.accumulate(log_ns),
        flown.positions[::every],
        flown.quat_xyzw[::every] * rng.choice([1.0, -1.0], (count, 1)),
        str(rng.choice([POSE, ODOMETRY])),
        ["map"] * count,
        ["base_link"] * count,
    )
    if rng.random() < 0.5:
        log.hfov_deg = np.full(count, rng.uniform(60, 90))
    return log


@cache
def flights(kind: str, seed: int) -> tuple[Structure, Demonstration]:
    """A member of a kind and an inspection of it."""
    inspections = INSPECTIONS[kind]
    structure = random_member(kind, seed % 4).structure
    return structure, fly(structure, inspections[seed % len(inspections)], seed=seed)


def right(number: int) -> Log:
    """The right log of this number: simulated pilots, and circles, facades and arcs by hand."""
    rng = np.random.default_rng([number, 7])
    kinds = sorted(INSPECTIONS)
    if number % 4 < 3:
        return log_of(*flights(kinds[number % len(kinds)], number // len(kinds) % 6), rng)
    structure = random_member(kinds[number // 4 % len(kinds)], number % 4).structure
    return log_of(structure, _by_hand(structure, rng), rng)


def _by_hand(structure: Structure, rng: np.random.Generator) -> Demonstration:
    """A ring or an arc round the structure's middle, looking at it, with the noise of a hand."""
    low, high = structure.vertices.min(axis=0), structure.vertices.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    count = int(rng.integers(600, 1500))
    angle = rng.uniform(0, 2 * np.pi) + np.linspace(0, rng.uniform(2.5, 6.5), count)
    off = rng.uniform(5, 15)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    superellipse = 1 / (np.abs(ring / (half[:2] + off)) ** 4).sum(axis=1) ** 0.25
    height = max(middle[2], low[2] + 3) + np.linspace(0, min(half[2], 6), count) * rng.uniform(-0.3, 1)
    positions = np.column_stack([middle[:2] + ring * superellipse[:, None], np.maximum(height, low[2] + 2)])
    positions += np.cumsum(rng.normal(0, 0.004, (count, 3)), axis=0)
    nearest = scene_of(structure).closest(positions)[0]
    aim = gaussian_filter1d(nearest, count / 40, axis=0, mode="nearest")
    ahead = aim - positions
    yaw, pitch = np.arctan2(ahead[:, 1], ahead[:, 0]), np.arctan2(ahead[:, 2], np.hypot(*ahead[:, :2].T))
    yaw += np.cumsum(rng.normal(0, 0.002, count))
    speed = rng.uniform(1, 4)
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    t_s = np.concatenate([[0], np.cumsum(np.maximum(lengths / speed, 0.01))])
    quats = from_yaw_pitch(yaw, pitch)
    t_ns = 1_760_000_000_000_000_000 + (t_s * 1e9).astype(np.int64)
    return Demonstration("by-hand", structure.structure_id, t_ns, positions, quats)


# --- what goes wrong -----------------------------------------------------------------------------

Fault = Callable[[Log, np.random.Generator], Log]


def _turned(log: Log, left: Rotation, right: Rotation | None = None) -> Log:
    quats = left * Rotation.from_quat(log.quats)
    return replace(
        log, positions=left.apply(log.positions), quats=(quats if right is None else quats * right).as_quat()
    )


def ned(log: Log, rng: np.random.Generator) -> Log:
    """North, east, down published as if it were east, north, up."""
    turned = _turned(log, NED_R_ENU, FRD_R_FLU)
    frame = str(rng.choice(["map", "local_origin_ned", "odom"]))
    return replace(turned, frames=[frame] * len(log))


def w_first(log: Log, rng: np.random.Generator) -> Log:
    """Quaternions w x y z in the fields x y z w."""
    return replace(log, quats=log.quats[:, [3, 0, 1, 2]])


def optical(log: Log, rng: np.random.Generator) -> Log:
    """Poses of the optical frame."""
    return replace(log, quats=(Rotation.from_quat(log.quats) * OPTICAL.inv()).as_quat())


def other_mount(log: Log, rng: np.random.Generator) -> Log:
    """Poses of a body whose camera looks down, or to a side."""
    turn = Rotation.from_euler("ZY", [rng.choice([0, 90, -90, 180]), rng.choice([45, 90])], degrees=True)
    return replace(log, quats=(Rotation.from_quat(log.quats) * turn.inv()).as_quat())


def inverse(log: Log, rng: np.random.Generator) -> Log:
    """Orientation from the world to the body."""
    return replace(log, quats=Rotation.from_quat(log.quats).inv().as_quat())


def swapped(log: Log, rng: np.random.Generator) -> Log:
    """x and y exchanged."""
    return replace(log, positions=log.positions[:, [1, 0, 2]])


def mirrored(log: Log, rng: np.random.Generator) -> Log:
    """One horizontal axis of the positions with the wrong sign."""
    return replace(log, positions=log.positions * ([-1, 1, 1] if rng.random() < 0.5 else [1, -1, 1]))


def feet(log: Log, rng: np.random.Generator) -> Log:
    """Lengths in feet."""
    return replace(log, positions=log.positions / 0.3048)


def millimetres(log: Log, rng: np.random.Generator) -> Log:
    """Lengths in millimetres or centimetres."""
    return replace(log, positions=log.positions * rng.choice([1000.0, 100.0]))


def yaw_drift(log: Log, rng: np.random.Generator) -> Log:
    """A heading that drifts away."""
    angle = np.linspace(0, rng.choice([-1, 1]) * np.radians(rng.uniform(60, 120)), len(log))
    turn = Rotation.from_rotvec(np.column_stack([0 * angle, 0 * angle, angle]))
    return replace(log, quats=(turn * Rotation.from_quat(log.quats)).as_quat())


def yaw_offset(log: Log, rng: np.random.Generator) -> Log:
    """A compass that is off."""
    turn = Rotation.from_euler("z", rng.choice([-1, 1]) * rng.uniform(50, 170), degrees=True)
    return replace(log, quats=(turn * Rotation.from_quat(log.quats)).as_quat())


def offset(log: Log, rng: np.random.Generator) -> Log:
    """The whole flight beside its structure: it goes through it, or looks past it."""
    size = np.ptp(log.structure.vertices, axis=0)
    away = rng.normal(size=3) * (1, 1, 0.3)
    return replace(log, positions=log.positions + away / np.linalg.norm(away) * max(8.0, 0.25 * size.max()))


def datum(log: Log, rng: np.random.Generator) -> Log:
    """Heights above another datum."""
    return replace(log, positions=log.positions + rng.choice([-1, 1]) * rng.uniform(40, 60) * np.eye(3)[2])


def y_up(log: Log, rng: np.random.Generator) -> Log:
    """The world of computer graphics."""
    return _turned(log, Rotation.from_euler("x", -90, degrees=True))


def clock_back(log: Log, rng: np.random.Generator) -> Log:
    """The clock is set back in flight, with or without that of the recorder."""
    at, back = int(len(log) * rng.uniform(0.3, 0.7)), int(rng.choice([2, 20]) * 1e9)
    t_ns, log_ns = log.t_ns.copy(), log.log_ns.copy()
    t_ns[at:] -= back
    return replace(log, t_ns=t_ns, log_ns=log_ns)


def clock_ahead(log: Log, rng: np.random.Generator) -> Log:
    """The clock of the sensor is set ahead; the recorder's runs on."""
    t_ns = log.t_ns.copy()
    t_ns[int(len(log) * rng.uniform(0.3, 0.7)) :] += int(rng.uniform(10, 600) * 1e9)
    return replace(log, t_ns=t_ns)


def two_vehicles(log: Log, rng: np.random.Generator) -> Log:
    """Another vehicle on the same topic, in turn, somewhere else."""
    other = log.positions + rng.normal(size=3) * 3 + rng.choice([-1, 1], 3) * 6.0
    both = np.stack([log.positions, np.roll(other, len(log) // 3, axis=0)], axis=1).reshape(-1, 3)
    half_ns = int(np.median(np.diff(log.t_ns)) // 2)
    children = [name for name in log.children for name in (name, rng.choice([name, "drone_2/base_link"]))]
    if rng.random() < 0.5:
        children = ["base_link"] * (2 * len(log))
    return replace(
        log,
        positions=both,
        quats=np.repeat(log.quats, 2, axis=0),
        t_ns=np.stack([log.t_ns, log.t_ns + half_ns], axis=1).ravel(),
        log_ns=np.stack([log.log_ns, log.log_ns + half_ns], axis=1).ravel(),
        frames=[name for name in log.frames for _ in range(2)],
        children=children,
        hfov_deg=None,
    )


def zoom(log: Log, rng: np.random.Generator) -> Log:
    """The camera zooms in while it flies."""
    angle = np.where(np.arange(len(log)) < len(log) * rng.uniform(0.3, 0.7), 75.0, rng.uniform(15, 40))
    return replace(log, hfov_deg=angle)


def zoom_by_another_clock(log: Log, rng: np.random.Generator) -> Log:
    """The camera zooms, and its calibration was written an hour after the flight, by stamps and recorder."""
    zoomed = zoom(log, rng)
    count = len(zoomed.t_ns[::10])
    later = zoomed.t_ns[-1] + (3600 + np.arange(count)) * 10**9
    return replace(zoomed, info_ns=later)


def unconnected(log: Log, rng: np.random.Generator) -> Log:
    """The side-car says map, the poses say odom, and nothing connects them."""
    return replace(log, frames=["odom"] * len(log), facts=log.facts | {"frame_id": "map"})


def missing(log: Log, rng: np.random.Generator) -> Log:
    """A third of the messages is not there."""
    pieces = np.sort(rng.choice(np.arange(1, 20), 6, replace=False))
    return log.take(~np.isin(np.arange(len(log)) * 20 // len(log), pieces))


def long_gap(log: Log, rng: np.random.Generator) -> Log:
    """Two minutes are missing in the middle."""
    at = int(len(log) * rng.uniform(0.3, 0.7))
    t_ns, log_ns = log.t_ns.copy(), log.log_ns.copy()
    t_ns[at:] += 120 * 10**9
    log_ns[at:] += 120 * 10**9
    return replace(log, t_ns=t_ns, log_ns=log_ns)


def many_gaps(log: Log, rng: np.random.Generator) -> Log:
    """A gap after every few poses."""
    extra = np.cumsum(np.where(np.arange(len(log)) % 4 == 0, 50, 0)) * 10**9
    return replace(log, t_ns=log.t_ns + extra, log_ns=log.log_ns + extra)


def hovering(log: Log, rng: np.random.Generator) -> Log:
    """Hours on one spot before it goes on."""
    at, count = len(log) // 2, 3600
    still = np.full(count, at)
    hover = log.take(np.concatenate([np.arange(at), still, np.arange(at, len(log))]))
    extra = np.concatenate([np.zeros(at), np.arange(1, count + 1), np.full(len(log) - at, count)])
    hover.positions[at : at + count] += rng.normal(0, 0.03, (count, 3))
    extra = (extra * 10**9 * 0.4).astype(np.int64)
    return replace(hover, t_ns=hover.t_ns + extra, log_ns=hover.log_ns + extra)


def too_fast(log: Log, rng: np.random.Generator) -> Log:
    """Stamps in a unit that is too short."""
    t_ns = log.t_ns[0] + (log.t_ns - log.t_ns[0]) // 60
    return replace(log, t_ns=t_ns, log_ns=t_ns, facts=log.facts)


FAULTS: dict[str, Fault] = {
    item.__name__: item
    for item in (
        ned, w_first, optical, other_mount, inverse, swapped, mirrored, feet, millimetres, yaw_drift,
        yaw_offset, offset, datum, y_up, clock_back, clock_ahead, two_vehicles, zoom, unconnected, missing,
        long_gap, many_gaps, hovering, too_fast,
    )
}  # fmt: skip

#: What tells of a fault in a log that is taken in, where it need not be refused.
NAMED = {
    "clock_back": "clock-stepped",
    "clock_ahead": "clock-stepped",
    "missing": "gaps",
    "long_gap": "gaps",
    "many_gaps": "gaps",
    "hovering": "hovering",
    "zoom": "zoom",
}

__all__ = ["FAULTS", "NAMED", "TF", "Log", "flights", "log_of", "member", "right", "transform"]
