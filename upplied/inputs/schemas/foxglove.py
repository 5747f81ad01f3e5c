"""Poses of Foxglove's schemas, in protobuf, JSON and ROS 2.

Foxglove states no axes; its poses are taken as ROS means them, z up and x forward.
"""

from __future__ import annotations

from collections.abc import Sequence

from upplied.inputs.flight.tracks import Track, pose_paths, pose_track
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table

_STAMP = ("timestamp.sec", "timestamp.nanosec", "frame_id")
_POSE = pose_paths("pose.position", "pose.orientation")
FIELDS = {
    "foxglove.PoseInFrame": (*_STAMP, *_POSE),
    "foxglove.Odometry": (*_STAMP, *_POSE, "child_frame_id"),
}
SOURCES = tuple(FIELDS)


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel."""
    child = "child_frame_id" if table.schema == "foxglove.Odometry" else ""
    return pose_track(
        table, "timestamp", "pose.position", "pose.orientation", "frame_id", child, facts.publisher
    )
