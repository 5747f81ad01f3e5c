"""Trees of transforms: TF of ROS and Foxglove, composed from the fixed frame to the camera.

Several publishers fill one tree at different rates. A chain is evaluated at the stamps of its
busiest link; the others are interpolated, never across a gap; static links hold at all times.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.flight.clean import clean
from upplied.inputs.flight.tracks import Track, at_times, names, pose_paths, source_times, stamps
from upplied.inputs.mcap.tables import Table
from upplied.inputs.sidecar import LogOptions
from upplied.records import Floats, Ints

_ROS = (
    "transforms[].header.stamp",
    "transforms[].transform",
    "transforms[].header.frame_id",
    "transforms[].child_frame_id",
)
_MANY = (
    "transforms[].timestamp",
    "transforms[]",
    "transforms[].parent_frame_id",
    "transforms[].child_frame_id",
)
_ONE = ("timestamp", "", "parent_frame_id", "child_frame_id")
_PLACES = {  # schema -> stamp, transform, parent, child
    "tf2_msgs/TFMessage": _ROS,
    "tf/tfMessage": _ROS,
    "foxglove.FrameTransforms": _MANY,
    "foxglove.FrameTransform": _ONE,
}
_MAX_FRAMES = 2000
_BODIES = ("base_link", "body", "fcu", "base_footprint", "imu")


def _parts(transform: str) -> tuple[str, str]:
    dot = f"{transform}." if transform else ""
    return f"{dot}translation", f"{dot}rotation"


FIELDS = {
    schema: (f"{stamp}.sec", f"{stamp}.nanosec", parent, child, *pose_paths(*_parts(transform)))
    for schema, (stamp, transform, parent, child) in _PLACES.items()
}


@dataclass
class Tree:
    """Which frame hangs on which, and how: a track for a moving link, a pose for a static one."""

    moving: dict[tuple[str, str], Track] = field(default_factory=dict)  # (parent, child)
    static: dict[tuple[str, str], tuple[Floats, Rotation]] = field(default_factory=dict)

    def parents(self) -> dict[str, str]:
        """The parent of each frame; a moving link counts more than a static one."""
        return {child: parent for parent, child in (*self.static, *self.moving)}

    def path(self, leaf: str, root: str = "") -> list[tuple[str, str]]:
        """Links from `root` (or the top) down to `leaf`; empty where there is no way."""
        links: list[tuple[str, str]] = []
        parents, frame = self.parents(), leaf
        while frame != root and frame in parents and len(links) < len(parents):
            links.append((parents[frame], frame))
            frame = parents[frame]
        return links[::-1] if frame == root or not root else []

    def fixed(self, leaf: str, root: str) -> tuple[Floats, Rotation] | None:
        """The pose of `leaf` in `root` where every link between them is static."""
        links = self.path(leaf, root)
        if leaf != root and (not links or any(link in self.moving for link in links)):
            return None
        position, rotation = np.zeros(3), Rotation.identity()
        for link in links:
            step, turn = self.static[link]
            position, rotation = position + rotation.apply(step), rotation * turn
        return position, rotation

    def track(self, leaf: str, root: str, limits: LogOptions) -> Track:
        """Poses of `leaf` in `root` at the stamps of the busiest moving link between them."""
        links = self.path(leaf, root)
        lead = max((self.moving[link] for link in links if link in self.moving), key=len)
        positions = np.zeros((len(lead), 3))
        rotation = Rotation.identity(len(lead))
        epoch: Ints | None = None
        for link in links:
            step, turn, known = self._link(link, lead.t_ns, limits)
            positions = positions + rotation.apply(step)
            rotation = rotation * turn
            positions[~known] = np.nan
        return replace(
            lead,
            positions=positions,
            quat_xyzw=rotation.as_quat(),
            parent=links[0][0],
            child=leaf,
            epoch=epoch,
        )

    def _link(
        self, link: tuple[str, str], t_ns: Ints, limits: LogOptions
    ) -> tuple[Floats, Rotation, np.ndarray]:
        if link not in self.moving:
            step, turn = self.static[link]
            return step, turn, np.ones(len(t_ns), bool)
        step, quats = at_times(self.moving[link], t_ns, limits.gap_s)
        known = np.asarray(np.isfinite(step).all(axis=1))
        quats[~known] = (0, 0, 0, 1)
        return step, Rotation.from_quat(quats), known


def tree_of(tables: Sequence[tuple[Table, str]], limits: LogOptions) -> Tree:
    """The tree of all transforms in a log.

    Parameters
    ----------
    tables : sequence of (Table, schema)
    limits : LogOptions

    Raises
    ------
    InputError
        If there are too many frames, or too much of a moving link is unusable.
    """
    tree = Tree()
    loose: dict[tuple[str, str], list[Track]] = {}
    for table, schema in tables:
        static = table.channel.topic.rstrip("/").endswith("static")
        for link, track in _links(table, schema):
            if static:
                _keep_static(tree, link, track)
            else:
                loose.setdefault(link, []).append(track)
        if len(loose) + len(tree.static) > _MAX_FRAMES:
            raise InputError(table.channel.topic, "holds too many frames", f"at most {_MAX_FRAMES}")
    for link, tracks in loose.items():
        whole = (
            clean(_merged(tracks), replace(limits, max_dropped=1.0), f"transform {link[0]} -> {link[1]}")
            if tracks
            else None
        )
        if whole is not None and len(whole) > 1:
            tree.moving[link] = whole
            tree.static.pop(link, None)
        elif whole is not None:
            _keep_static(tree, link, whole)
    return tree


def camera_frame(tree: Tree, facts: LogOptions, named: str, what: str) -> str:
    """The frame whose poses are asked for: the camera's, else the body's.

    Raises
    ------
    InputError
        If several frames could be meant.
    """
    frames = set(tree.parents())
    if named in frames:
        return named
    if facts.camera_frame_id:
        listed = ", ".join(sorted(frames)[:20])
        raise InputError(what, f"has no frame {named!r}", f"one of {listed}", "correct camera_frame_id")
    moved = {frame for frame in frames if any(link in tree.moving for link in tree.path(frame))}
    optical = sorted(frame for frame in moved if "optical" in frame)
    if len(optical) == 1:
        return optical[0]
    if not optical:
        ends = {child for _, child in tree.moving} - {parent for parent, _ in tree.moving}
        usual = [name for name in _BODIES if name in moved]
        if usual or len(ends) == 1:
            return usual[0] if usual else ends.pop()
        optical = sorted(ends)
    raise InputError(
        what,
        f"has {len(optical)} frames that could be the camera: {', '.join(optical[:20])}",
        "one",
        "name it by camera_frame_id",
    )


def _links(table: Table, schema: str) -> list[tuple[tuple[str, str], Track]]:
    stamp, transform, parent, child = _PLACES[schema]
    paths = pose_paths(*_parts(transform))
    if not len(table) or any(path not in table for path in paths):
        return []
    times, clock = source_times(table, stamps(table, stamp))
    values = table.stack(*paths)
    whole = Track(times, values[:, :3], values[:, 3:], table.log_ns, clock=clock)
    found = []
    keys, which = np.unique(
        np.column_stack([names(table, parent), names(table, child)]), axis=0, return_inverse=True
    )
    for index, (first, second) in enumerate(keys[:_MAX_FRAMES]):
        part = whole.take(which.ravel() == index)
        found.append(
            (
                (str(first), str(second)),
                replace(part, parent=str(first), child=str(second), dropped=Counter()),
            )
        )
    return found


def _merged(tracks: list[Track]) -> Track:
    if len(tracks) == 1:
        return tracks[0]
    return replace(
        tracks[0],
        t_ns=np.concatenate([track.t_ns for track in tracks]),
        positions=np.concatenate([track.positions for track in tracks]),
        quat_xyzw=np.concatenate([track.quat_xyzw for track in tracks]),
        log_ns=np.concatenate([track.log_ns for track in tracks]),
    )


def _keep_static(tree: Tree, link: tuple[str, str], track: Track) -> None:
    position, quat = track.positions[-1], track.quat_xyzw[-1]
    if np.isfinite(position).all() and abs(np.linalg.norm(quat) - 1) <= 1e-2 and link not in tree.moving:
        tree.static[link] = (position, Rotation.from_quat(quat))
