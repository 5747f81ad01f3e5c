"""Poses and transforms of ROS 2, ROS 1 and Foxglove's schemas, and velocity, turn rates and wind beside them.

ROS and MAVROS have ENU and x forward, y left, z up (REP-103, REP-105), quaternions x y z w; Foxglove states
no axes and is read alike. PX4 and ArduPilot log the wind to north and east, MAVROS a twist
(`wind_estimation`). A chain of transforms has the stamps of its busiest link; others are interpolated, never
across a gap; static links always hold.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight import tracks
from upplied.inputs.flight.clean import clean
from upplied.inputs.flight.tracks import Track, are_unit, at_times, groups_of, pose_track, source_times
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints
from upplied.records.flights import LoggedWind

_SHAPES, _FIELDS = tracks.shapes_of("ros"), tracks.fields_of("ros")
SOURCES = tuple(_SHAPES)
IMU = "sensor_msgs/Imu"
_MOTION, _INERTIAL = _FIELDS["nav_msgs/Odometry"][-6:], _FIELDS[IMU][-6:]
_GRAVITY_MPS2 = (6.0, 14.0)  # mean of an accelerometer: others had it taken out, or are none
_EAST_NORTH = tracks.fields_of("wind")
_MOST_MPS = 60.0  # a hurricane: an estimate of the wind beyond has diverged


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel."""
    return pose_track(table, _SHAPES[table.schema], facts.publisher)


def velocity(tables: Sequence[Table], topic: str) -> tuple[Ints, Floats] | None:
    """When (N,), ns, and the velocity (N, 6), m/s and rad/s, of the odometry of a topic; None without.

    Where several publish on it, that of most messages counts.
    """
    table = max((each for each in tables if each.channel.topic == topic), key=len, default=None)
    if table is None or _MOTION[0] not in table or not len(table):
        return None
    motion = table.stack(*_MOTION)
    good = np.isfinite(motion).all(axis=1)
    if not motion[good].any():
        return None
    return source_times(table)[0][good], motion[good]


def turning(tables: Sequence[Table]) -> list[tuple[Ints, Floats]]:
    """Of each inertial unit when (N,), ns, and its turn rate about the vertical (N,), rad/s.

    The accelerometer gives the vertical, so how the unit is mounted does not count. Counter-clockwise
    from above.
    """
    units = []
    for table in tables:
        if table.schema != IMU or not len(table) or any(path not in table for path in _INERTIAL):
            continue
        felt = table.stack(*_INERTIAL)
        good = np.isfinite(felt).all(axis=1)
        t_ns, felt = source_times(table)[0][good], felt[good]
        length = np.linalg.norm(felt[:, 3:], axis=1)
        if not len(felt) or not felt[:, :3].any() or not _GRAVITY_MPS2[0] < length.mean() < _GRAVITY_MPS2[1]:
            continue
        order = np.argsort(t_ns, kind="stable")
        rate = 1e9 * (len(t_ns) - 1) / max(int(t_ns[order[-1]] - t_ns[order[0]]), 1)
        up = uniform_filter1d(felt[order, 3:], max(round(rate), 1), axis=0, mode="nearest")
        up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)
        about = uniform_filter1d((felt[order, :3] * up).sum(axis=1), max(round(rate / 2), 1), mode="nearest")
        units.append((t_ns[order], about))
    return units


def wind_of(tables: Sequence[Table], track: Track, heading_deg: float | None) -> LoggedWind | None:
    """The wind while the poses of a track were logged; None where the log holds none.

    Without the heading of the structure's +X, clockwise from north, where it blows to is not known.
    """
    usable = []
    for table in tables:
        topic = table.channel.topic  # a twist tells of a vehicle, unless it is named for the wind
        if table.schema not in _EAST_NORTH or (table.schema[:4] == "geom" and "wind" not in topic.lower()):
            continue
        air = table.stack(*_EAST_NORTH[table.schema])
        speed = np.linalg.norm(air, axis=1)
        good = (table.log_ns >= track.log_ns.min()) & (table.log_ns <= track.log_ns.max())
        good &= np.isfinite(speed) & (speed <= _MOST_MPS)
        if (speed[good] > 0).any():  # an estimate that never began is zero
            usable.append((int(good.sum()), topic, air[good]))
    if not usable:
        return None
    _, topic, air = max(usable, key=lambda each: each[:2])
    speed, mean = np.linalg.norm(air, axis=1), air.mean(axis=0)
    bearing = np.degrees(np.arctan2(mean[0], mean[1]))
    towards = None if heading_deg is None else float((heading_deg - bearing) % 360.0)
    return LoggedWind(topic, float(speed.mean()), float(speed.max()), towards)


SCHEMAS = tracks.shapes_of("tf")
_MAX_FRAMES = 1000
_VALUES = ("t_ns", "positions", "quat_xyzw", "log_ns")  # of links that several topics give
_BODIES = ("base_link", "body", "fcu", "base_footprint", "imu")

Link = tuple[str, str]  # parent, child


@dataclass
class Tree:
    """Which frame hangs on which, and how: a track for a moving link, a pose for a static one."""

    moving: dict[Link, Track] = field(default_factory=dict)
    static: dict[Link, tuple[Floats, Rotation]] = field(default_factory=dict)
    topic: str = ""

    def parents(self) -> dict[str, str]:
        """The parent of each frame; a moving link counts more than a static one."""
        return {child: parent for parent, child in (*self.static, *self.moving)}

    def path(self, leaf: str, root: str = "") -> list[Link]:
        """Links from `root` (or the top) down to `leaf`; empty where there is no way."""
        links: list[Link] = []
        parents, frame = self.parents(), leaf
        while frame != root and frame in parents and len(links) < len(parents):
            links.append((parents[frame], frame))
            frame = parents[frame]
        return links[::-1] if frame == root or not root else []

    def rigid(self, leaf: str) -> list[str]:
        """The frames above `leaf` that static links alone part from it, from below."""
        parents, frame = self.parents(), leaf
        above: list[str] = []
        while (parents.get(frame), frame) in self.static and len(above) < len(parents):
            frame = parents[frame]
            above.append(frame)
        return above

    def camera(self) -> str:
        """The one frame on a static link that is called a camera's; empty where none or several are."""
        named = [child for _, child in self.static if re.search(r"optical|cam", child, re.IGNORECASE)]
        candidates = [name for name in named if "optical" in name.lower()] or named
        return candidates[0] if len(candidates) == 1 else ""

    def moves(self, frame: str, root: str = "") -> bool:
        """Whether a moving link lies above a frame, below `root` (or the top)."""
        return any(link in self.moving for link in self.path(frame, root))

    def at(self, leaf: str, root: str, t_ns: Ints, gap_s: float) -> tuple[Floats, Rotation, Bools]:
        """Poses of `leaf` in `root` at these times (N,), and where known; static links always are."""
        positions, rotation = np.zeros((len(t_ns), 3)), Rotation.identity(len(t_ns))
        known = np.ones(len(t_ns), bool)
        for link in self.path(leaf, root):
            step, turn = self.static.get(link, (np.zeros(3), Rotation.identity()))
            if track := self.moving.get(link):  # a localisation corrects once a second
                usual_s = float(np.median(np.diff(track.t_ns))) * 1e-9
                step, quats = at_times(track, t_ns, max(gap_s, 3 * usual_s))
                there = np.isfinite(step).all(axis=1)
                step[~there], quats[~there] = 0.0, (0.0, 0.0, 0.0, 1.0)
                turn, known = Rotation.from_quat(quats), known & there
            positions, rotation = positions + rotation.apply(step), rotation * turn
        return positions, rotation, known

    def track(self, leaf: str, root: str, limits: LogOptions) -> Track:
        """Poses of `leaf` in `root` at the stamps of the busiest moving link between them."""
        links = self.path(leaf, root)
        lead = max((self.moving[link] for link in links if link in self.moving), key=len)
        positions, rotation, known = self.at(leaf, root, lead.t_ns, limits.gap_s)
        quats, parent = rotation.as_quat(), links[0][0]
        chain = replace(lead, positions=positions, quat_xyzw=quats, parent=parent, child=leaf)
        return chain.during(known, "complete chain of transforms")


def tree_of(tables: Sequence[Table], limits: LogOptions) -> Tree:
    """The tree of all transforms in a log.

    Raises InputError if there are too many frames.
    """
    tables = [table for table in tables if table.schema in SCHEMAS]
    tree = Tree(topic=tables[0].channel.topic if tables else "")
    loose: dict[Link, list[Track]] = {}
    for table in tables:
        latched = table.channel.topic.rstrip("/").endswith("static")
        for link, track in _links(table):
            if latched:
                _hold(tree, link, track)
            else:
                loose.setdefault(link, []).append(track)
    if len(loose) + len(tree.static) > _MAX_FRAMES:
        raise InputError(tree.topic, f"holds more than {_MAX_FRAMES} links", "fewer")
    for link, parts in loose.items():
        try:
            whole: dict[str, Any] = {
                name: np.concatenate([getattr(part, name) for part in parts]) for name in _VALUES
            }
            order = np.argsort(whole["log_ns"], kind="stable")  # as recorded
            merged = replace(parts[0], **whole).take(order)
            track = clean(merged, replace(limits, max_dropped=1.0), "a transform")
        except InputError:  # nothing usable: as if the link had never been published
            continue
        if len(track) > 1 and np.ptp(np.hstack([track.positions, track.quat_xyzw]), axis=0).any():
            tree.moving[link] = track
            tree.static.pop(link, None)
        else:
            _hold(tree, link, track)
    return tree


def transformed(tree: Tree, facts: LogOptions, camera_frame: str, what: str) -> Track:
    """Poses of the camera's frame, else of the body's, from the top of the tree or `facts.frame_id`.

    Raises InputError if several frames could be meant, or the frame that is asked for does not exist.
    """
    leaf = _leaf(tree, facts, camera_frame, what)
    root = facts.frame_id.lstrip("/")
    return tree.track(leaf, root if tree.moves(leaf, root) else "", facts)


def _leaf(tree: Tree, facts: LogOptions, named: str, what: str) -> str:
    frames = set(tree.parents())
    if named in frames and tree.moves(named):
        return named
    if facts.camera_frame_id:
        shown = ", ".join(sorted(frames)[:20])
        raise InputError(what, f"has no moving frame {named!r}", f"one of {shown}", "correct camera_frame_id")
    moved = {frame for frame in frames if tree.moves(frame)}
    optical = sorted(frame for frame in moved if "optical" in frame)
    ends = sorted({child for _, child in tree.moving} - {parent for parent, _ in tree.moving})
    usual = [name for name in _BODIES if name in moved]
    for choice in (optical, usual[:1], ends):
        if len(choice) == 1:
            return choice[0]
        if choice:
            break
    finding = f"has several frames that could be the camera: {', '.join((optical or ends)[:20])}"
    raise InputError(what, finding, "one", "name it by camera_frame_id")


def _links(table: Table) -> list[tuple[Link, Track]]:
    if not len(table):
        return []
    shape = SCHEMAS[table.schema]
    whole, groups = shape.track(table), groups_of(table, shape)
    if len(groups) > _MAX_FRAMES:
        raise InputError(table.channel.topic, f"holds {len(groups)} links", f"at most {_MAX_FRAMES}")
    return [
        (link, replace(whole.take(rows), parent=link[0], child=link[1], dropped=Counter()))
        for link, rows in groups.items()
        if link[1] and link[0] != link[1]  # what has no name, or hangs on itself, hangs nowhere
    ]


def _hold(tree: Tree, link: Link, track: Track) -> None:
    position, quat = track.positions[-1], track.quat_xyzw[-1]
    if np.isfinite(position).all() and are_unit(quat[None])[0] and link not in tree.moving:
        tree.static[link] = (position, Rotation.from_quat(quat))
