"""A track: timed poses of one thing as a log tells them, before they are cleaned."""

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from upplied.errors import InputError
from upplied.geometry.polylines import interpolated
from upplied.geometry.poses import normalised
from upplied.inputs.files import table as toml_table
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints, Record

MAX_NORM_ERROR = 1e-2  # of a quaternion; a rounded or single-precision one is far within
AT_THE_ENDS = " yet or any more"  # what was dropped for such a reason is not held against the log
_FEW_POSES_SHARE = 0.05  # of the poses
_OF_SAMPLES = ("t_ns", "positions", "quat_xyzw", "log_ns", "epoch", "fov_deg")
_STAMPS = ("header.stamp", "timestamp_sample", "timestamp")
HOLD_NS = 100_000_000  # how long the first and the last pose are held for another topic's stamps


@dataclass(frozen=True, eq=False, repr=False)
class Track(Record):
    """Poses of a frame in another: positions and quaternions ``x y z w`` of `child` in `parent`.

    ENU or another frame with z up, bodies with x forward, y left, z up; NaN where the source says invalid.
    """

    t_ns: Ints  # (N,) ns, clock of `clock`
    positions: Floats  # (N, 3) m
    quat_xyzw: Floats  # (N, 4)
    log_ns: Ints  # (N,) ns, when the recorder received it
    parent: str = ""  # names of the frames in the log
    child: str = ""
    clock: str = "header"
    epoch: Ints | None = None  # (N,) number that changes where the estimator was reset
    dropped: Counter[str] = field(default_factory=Counter)
    notes: tuple[str, ...] = ()
    clock_steps: int = 0
    fov_deg: Floats | None = None  # (N, 2) horizontal and vertical, where the camera zooms
    long_gaps: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # first sample after each

    def __len__(self) -> int:
        return len(self.t_ns)

    def keep(self, good: Bools, reason: str) -> "Track":
        """The good samples; the others are counted as dropped for this reason."""
        if good.all():
            return self
        dropped = Counter(self.dropped)
        dropped[reason] += int((~good).sum())
        return replace(self.take(good), dropped=dropped)

    def during(self, known: Bools, what: str) -> "Track":
        """The samples for which something else is known; missing at the ends it is no fault of the log."""
        ends = np.full(len(self), known.any())
        if len(inner := np.flatnonzero(known)):
            ends[inner[0] : inner[-1] + 1] = False
        return self.keep(~ends, f"no {what}{AT_THE_ENDS}").keep(known[~ends], f"no {what}")

    def noted(self, note: str) -> "Track":
        """The same with a note more."""
        return replace(self, notes=(*self.notes, note))

    def turned(self, turn: Rotation, positions: Floats) -> "Track":
        """The same in another frame: turned, at these positions."""
        turned = turn * Rotation.from_quat(self.quat_xyzw)
        return replace(self, positions=positions, quat_xyzw=turned.as_quat())

    def take(self, index: Ints | Bools) -> "Track":
        """The samples of this index."""
        parts = ((name, getattr(self, name)) for name in _OF_SAMPLES)
        return replace(self, **{name: part[index] for name, part in parts if part is not None})


def source_times(table: Table, *prefixes: str) -> tuple[Ints, str]:
    """The stamps to use, ns, and their clock: of the source, else when sent, else when received.

    The source's are the first at these paths, by default those of all schemas, that are not all zero. Stamps
    that are all zero, or all the same, are of no clock and passed over.
    """
    known = (stamps(table, prefix) for prefix in prefixes or _STAMPS)
    own = next((times for times in known if times is not None and times.any()), None)
    for clock, times in (("header", own), ("publish", table.publish_ns), ("log", table.log_ns)):
        if times is not None and len(times) and (times.any() and (len(times) == 1 or np.ptp(times) > 0)):
            return times, clock
    return table.log_ns, "log"


def stamps(table: Table, prefix: str) -> Ints | None:
    """Stamps, ns, of ``<prefix>.sec`` and ``.nanosec``, or of microseconds; None where there are none."""
    if prefix in table:
        return table.integers(prefix).clip(0, 9 * 10**15) * 1000
    if f"{prefix}.sec" not in table:
        return None
    seconds = table.integers(f"{prefix}.sec").clip(0, 9 * 10**9)
    return seconds * 10**9 + table.integers(f"{prefix}.nanosec").clip(0, 10**9)


def are_unit(quat_xyzw: Floats) -> Bools:
    """Which (N,) of the quaternions (N, 4) are of unit length, as a rotation must be."""
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt(np.sum(np.square(quat_xyzw), axis=1))
        return np.asarray(np.abs(lengths - 1) <= MAX_NORM_ERROR)


def at_times(track: Track, t_ns: Ints, gap_s: float) -> tuple[Floats, Floats]:
    """A clean track at other times: positions (M, 3) and quaternions (M, 4), NaN outside and in gaps.

    Linear and spherical in between, never across a longer silence than `gap_s` or a reset. Two topics of one
    estimator rarely begin together: the ends are held for a tenth of a second.
    """
    positions, quats = np.full((len(t_ns), 3), np.nan), np.full((len(t_ns), 4), np.nan)
    if len(track) < 2:
        return positions, quats
    right = np.clip(np.searchsorted(track.t_ns, t_ns, side="left"), 1, len(track) - 1)
    left = right - 1
    inside = (t_ns >= track.t_ns[0] - HOLD_NS) & (t_ns <= track.t_ns[-1] + HOLD_NS)
    hit = (track.t_ns[left] == t_ns) | (track.t_ns[right] == t_ns)
    close = (track.t_ns[right] - track.t_ns[left]) <= gap_s * 1e9
    if track.epoch is not None:
        close &= track.epoch[left] == track.epoch[right]
    good = inside & (close | hit)
    if not good.any():
        return positions, quats
    origin = track.t_ns[0]
    known, times = (track.t_ns - origin) * 1e-9, (t_ns[good] - origin) * 1e-9
    positions[good] = interpolated(times, known, track.positions)
    turns = Slerp(known, Rotation.from_quat(track.quat_xyzw))
    quats[good] = normalised(turns(np.clip(times, known[0], known[-1])).as_quat())
    return positions, quats


# Optical frames (ROS, REP-103) are z forward, x right, y down; ours is x forward, y left, z up.
OPTICAL_R_CAMERA = Rotation.from_matrix([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


class PoseShape(NamedTuple):
    """Paths of a pose in a message: its stamp, its two parts, and the names of its frames."""

    stamp: str
    position: str
    rotation: str
    parent: str
    child: str = ""

    @property
    def values(self) -> tuple[str, ...]:
        turns = (f"{self.rotation}.{axis}" for axis in "xyzw")
        return (*(f"{self.position}.{axis}" for axis in "xyz"), *turns)

    @property
    def paths(self) -> tuple[str, ...]:
        named = (f"{self.stamp}.sec", f"{self.stamp}.nanosec", self.parent, self.child)
        return (*filter(None, named), *self.values)

    def track(self, table: Table) -> Track:
        """All poses of a table, of whatever frames."""
        times, clock = source_times(table, self.stamp)
        values = table.stack(*self.values)
        return Track(times, values[:, :3], values[:, 3:], table.log_ns, clock=clock)


_FAMILIES = toml_table("schemas/schemas.toml")


def shapes_of(family: str) -> dict[str, PoseShape]:
    """Where the poses of each schema of a family stand in its messages."""
    return {schema: PoseShape(*paths) for schema, paths in _FAMILIES[family].get("poses", {}).items()}


def fields_of(family: str) -> dict[str, tuple[str, ...]]:
    """All paths that are read of each schema of a family; ``{x,y}`` stands for several."""
    paths = {schema: shape.paths for schema, shape in shapes_of(family).items()}
    for schema, text in _FAMILIES[family].get("fields", {}).items():
        words = [word.rstrip("}").partition("{") for word in text.split()]
        more = [start + end for start, _, ends in words for end in ends.split(",")]
        paths[schema] = (*paths.get(schema, ()), *more)
    return paths


FIELDS = {schema: paths for family in _FAMILIES for schema, paths in fields_of(family).items()}


def pose_track(table: Table, shape: PoseShape, only: str = "") -> Track:
    """The track of a table that holds one pose a row; poses of other frames than most are dropped.

    Raises InputError if there are several bodies, and `only` names the frame, parent or child, of none.
    """
    track = replace(shape.track(table), dropped=Counter(table.dropped))
    if not len(table):
        return track
    groups = groups_of(table, shape)
    if named := {pair: rows for pair, rows in groups.items() if only and only.lstrip("/") in pair}:
        track = track.take(np.sort(np.concatenate(list(named.values()))))
        return replace(track, parent=next(iter(named))[0], child=next(iter(named))[1])
    most = max(groups, key=lambda pair: len(groups[pair]))
    bodies = Counter[str]()
    for pair, rows in groups.items():
        bodies[pair[1]] += len(rows)
    if sum(number > _FEW_POSES_SHARE * len(table) for number in bodies.values()) > 1:
        listed = ", ".join(f"{name or 'without a name'} ({number})" for name, number in bodies.most_common(8))
        finding, rule = f"holds the poses of several bodies: {listed}", "several-publishers: one body"
        raise InputError(table.channel.topic, finding, rule, "name one by publisher")
    if len(groups) > 1:
        track = track.keep(np.isin(np.arange(len(table)), groups[most]), "other frame")
    return replace(track, parent=most[0], child=most[1])


def groups_of(table: Table, shape: PoseShape) -> dict[tuple[str, str], Ints]:
    """The rows (k,) of each pair of frames."""
    rows: dict[tuple[str, str], list[int]] = {}
    for row, pair in enumerate(zip(names(table, shape.parent), names(table, shape.child), strict=True)):
        rows.setdefault(pair, []).append(row)
    return {pair: np.array(of_pair) for pair, of_pair in rows.items()}


def names(table: Table, path: str) -> np.ndarray:
    """The names of frames in a column, without a leading slash; empty where there are none."""
    return np.array([name.lstrip("/") for name in table.texts(path).tolist()], object)
