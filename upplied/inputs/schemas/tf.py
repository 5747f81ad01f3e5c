"""Trees of transforms: TF of ROS and of Foxglove, composed from the fixed frame to the camera.

A chain has the stamps of its busiest link; others are interpolated, never across a gap; static links hold.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight import tracks
from upplied.inputs.flight.clean import clean
from upplied.inputs.flight.tracks import Track, are_unit, at_times, groups_of
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Bools, Floats, Ints

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
        parents, frame, links = self.parents(), leaf, list[Link]()
        while frame != root and frame in parents and len(links) < len(parents):
            links.append((parents[frame], frame))
            frame = parents[frame]
        return links[::-1] if frame == root or not root else []

    def rigid(self, leaf: str) -> list[str]:
        """The frames above `leaf` that static links alone part from it, from below."""
        parents, frame, above = self.parents(), leaf, list[str]()
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
    """The tree of all transforms in a log; InputError if there are too many frames."""
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
            merged = replace(parts[0], **whole).take(
                np.argsort(whole["log_ns"], kind="stable")
            )  # as recorded
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
    """Poses of the camera's frame, else the body's, from the top or `frame_id`; InputError if in doubt."""
    leaf, root = _leaf(tree, facts, camera_frame, what), facts.frame_id.lstrip("/")
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
