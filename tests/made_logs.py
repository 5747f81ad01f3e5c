"""Logs made in the tests: schemas as ROS 2 writes them, and a flight around a structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic

from upplied.poses import from_yaw_pitch


def _part(name: str, *lines: str) -> str:
    return "\n".join(["", "=" * 80, f"MSG: {name}", *lines, ""])


_XYZ = ("float64 x", "float64 y", "float64 z")
_HEADER = _part("std_msgs/Header", "builtin_interfaces/Time stamp", "string frame_id") + _part(
    "builtin_interfaces/Time", "int32 sec", "uint32 nanosec"
)
_QUAT = _part("geometry_msgs/Quaternion", "float64 x 0", "float64 y 0", "float64 z 0", "float64 w 1")
_POSE = (
    _part("geometry_msgs/Pose", "Point position", "Quaternion orientation")
    + _part("geometry_msgs/Point", *_XYZ)
    + _QUAT
)
_UNSURE_POSE = _part("geometry_msgs/PoseWithCovariance", "Pose pose", "float64[36] covariance") + _POSE
_TWIST = (
    _part("geometry_msgs/TwistWithCovariance", "Twist twist", "float64[36] covariance")
    + _part("geometry_msgs/Twist", "Vector3 linear", "Vector3 angular")
    + _part("geometry_msgs/Vector3", *_XYZ)
)
_TRANSFORM = (
    _part("geometry_msgs/Transform", "Vector3 translation", "Quaternion rotation")
    + _part("geometry_msgs/Vector3", *_XYZ)
    + _QUAT
)
_STAMPED = "std_msgs/Header header\n"
_LINK = _STAMPED + "string child_frame_id\ngeometry_msgs/Transform transform\n"

ROS2 = {
    "geometry_msgs/msg/PoseStamped": _STAMPED + "geometry_msgs/Pose pose\n" + _HEADER + _POSE,
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        _STAMPED + "geometry_msgs/PoseWithCovariance pose\n" + _HEADER + _UNSURE_POSE
    ),
    "nav_msgs/msg/Odometry": (
        _STAMPED
        + "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        + "geometry_msgs/TwistWithCovariance twist\n"
        + _HEADER
        + _UNSURE_POSE
        + _TWIST
    ),
    "geometry_msgs/msg/TransformStamped": _LINK + _HEADER + _TRANSFORM,
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms\n"
        + _part("geometry_msgs/TransformStamped", _LINK)
        + _HEADER
        + _TRANSFORM
    ),
    "sensor_msgs/msg/CameraInfo": (
        _STAMPED
        + "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        + "float64[9] r\nfloat64[12] p\n"
        + _HEADER
    ),
    "sensor_msgs/msg/CompressedImage": _STAMPED + "string format\nuint8[] data\n" + _HEADER,
}


@dataclass
class Flight:
    """A flight with known truth: positions (N, 3) m, quaternions (N, 4), times (N,) ns."""

    t_ns: np.ndarray
    positions: np.ndarray
    quat_xyzw: np.ndarray


def flight(n: int = 300, rate_hz: float = 30.0, start_ns: int = 1_700_000_000_000_000_000) -> Flight:
    """A spiral at 10 m that looks inwards and a little down."""
    t_s = np.arange(n) / rate_hz
    angle = 0.05 * t_s
    positions = np.column_stack([10 * np.cos(angle), 10 * np.sin(angle), 5 + 0.1 * t_s])
    quats = from_yaw_pitch(angle + np.pi, np.full(n, -0.3))
    return Flight(start_ns + np.round(t_s * 1e9).astype(np.int64), positions, quats)


def header(t_ns: int, frame: str = "map") -> dict[str, Any]:
    """A std_msgs/Header."""
    return {"stamp": {"sec": int(t_ns // 10**9), "nanosec": int(t_ns % 10**9)}, "frame_id": frame}


def xyz(vector: Sequence[float]) -> dict[str, float]:
    """A point or vector."""
    return dict(zip("xyz", map(float, vector), strict=True))


def xyzw(quat: Sequence[float]) -> dict[str, float]:
    """A quaternion."""
    return dict(zip("xyzw", map(float, quat), strict=True))


def pose(position: Sequence[float], quat: Sequence[float]) -> dict[str, Any]:
    """A geometry_msgs/Pose."""
    return {"position": xyz(position), "orientation": xyzw(quat)}


def transform(
    t_ns: int, parent: str, child: str, position: Sequence[float], quat: Sequence[float]
) -> dict[str, Any]:
    """A geometry_msgs/TransformStamped."""
    return {
        "header": header(t_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": xyz(position), "rotation": xyzw(quat)},
    }


def message(
    schema: str,
    t_ns: int,
    position: Sequence[float],
    quat: Sequence[float],
    frame: str = "map",
    child: str = "base_link",
) -> dict[str, Any]:
    """A message of one of the four pose schemas of ROS."""
    if schema.endswith("TransformStamped"):
        return transform(t_ns, frame, child, position, quat)
    inner = pose(position, quat)
    if schema.endswith(("Odometry", "PoseWithCovarianceStamped")):
        inner = {"pose": inner, "covariance": [0.0] * 36}
    found: dict[str, Any] = {"header": header(t_ns, frame), "pose": inner}
    if schema.endswith("Odometry"):
        found |= {"child_frame_id": child, "twist": {"covariance": [0.0] * 36}}
    return found


@dataclass
class Topic:
    """Messages of one topic: (log time, message) pairs."""

    topic: str
    schema: str
    messages: list[tuple[int, Mapping[str, Any]]] = field(default_factory=list)


def poses(topic: str, schema: str, flown: Flight, frame: str = "map", child: str = "base_link") -> Topic:
    """A topic with every pose of a flight."""
    rows = zip(flown.t_ns, flown.positions, flown.quat_xyzw, strict=True)
    return Topic(topic, schema, [(int(t), message(schema, int(t), p, q, frame, child)) for t, p, q in rows])


def write_log(
    path: Path,
    topics: Sequence[Topic],
    metadata: Mapping[str, str] | None = None,
    chunk_size: int = 2**14,
    compression: CompressionType = CompressionType.ZSTD,
    **writing: Any,
) -> Path:
    """An MCAP log of ROS 2 messages in the order of their log times."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression, **writing)
        writer.start("ros2", "test")
        queue = []
        for topic in topics:
            encode = serialize_dynamic(topic.schema, ROS2[topic.schema])[topic.schema]
            schema = writer.register_schema(topic.schema, "ros2msg", ROS2[topic.schema].encode())
            channel = writer.register_channel(topic.topic, "cdr", schema)
            queue += [(log_ns, channel, encode(content)) for log_ns, content in topic.messages]
        for log_ns, channel, data in sorted(queue, key=lambda item: item[0]):
            writer.add_message(channel, log_ns, data, log_ns)
        if metadata is not None:
            writer.add_metadata("inspection", dict(metadata))
        writer.finish()
    return path
