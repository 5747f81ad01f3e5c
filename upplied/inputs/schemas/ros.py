"""Poses of ROS: stamped poses, odometry and single transforms, in ROS 2 and in ROS 1.

ROS says ENU and x forward, y left, z up (REP-103, REP-105), quaternions x y z w: nothing is
converted. MAVROS publishes these too, already turned from the autopilot's NED and FRD.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from upplied.inputs.flight.tracks import Track, pose_paths, pose_track, source_times, stamps
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

_HEADER = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
_PLACES = {  # schema -> position, rotation, path of the child frame's name
    "geometry_msgs/PoseStamped": ("pose.position", "pose.orientation", ""),
    "geometry_msgs/PoseWithCovarianceStamped": ("pose.pose.position", "pose.pose.orientation", ""),
    "nav_msgs/Odometry": ("pose.pose.position", "pose.pose.orientation", "child_frame_id"),
    "geometry_msgs/TransformStamped": ("transform.translation", "transform.rotation", "child_frame_id"),
}
SOURCES = tuple(_PLACES)
_MOTION = tuple(f"twist.twist.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz")
FIELDS = {
    schema: (*_HEADER, *pose_paths(position, rotation), *((child,) if child else ()))
    for schema, (position, rotation, child) in _PLACES.items()
}
FIELDS["nav_msgs/Odometry"] += _MOTION


def samples(table: Table, tables: Sequence[Table], facts: LogOptions) -> Track:
    """The poses of one channel."""
    position, rotation, child = _PLACES[table.schema]
    return pose_track(table, "header.stamp", position, rotation, "header.frame_id", child, facts.publisher)


def velocity(table: Table | None) -> tuple[Ints, Floats] | None:
    """When (N,), ns, and the velocity (N, 6), m/s and rad/s, that odometry says; None where it says none."""
    if table is None or _MOTION[0] not in table or not len(table):
        return None
    motion = table.stack(*_MOTION)
    good = np.isfinite(motion).all(axis=1)
    if not motion[good].any():
        return None
    return source_times(table, stamps(table, "header.stamp"))[0][good], motion[good]
