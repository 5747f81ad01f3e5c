"""Logs made in the tests: schemas as ROS 2 writes them, and a flight around a structure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import json_format
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, Writer
from mcap_ros2._dynamic import serialize_dynamic
from scipy.spatial.transform import Rotation

from upplied.geometry.poses import from_yaw_pitch


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
    content: dict[str, Any] = {"header": header(t_ns, frame), "pose": inner}
    if schema.endswith("Odometry"):
        content |= {"child_frame_id": child, "twist": {"covariance": [0.0] * 36}}
    return content


@dataclass
class Topic:
    """Messages of one topic: (log time, content) pairs; the content is encoded by `encode`."""

    topic: str
    schema: str
    messages: list[tuple[int, Any]] = field(default_factory=list)
    encoding: tuple[str, str] = ("cdr", "ros2msg")  # of the messages, of the schema
    definition: bytes = b""
    encode: Callable[[Any], bytes] | None = None


def poses(topic: str, schema: str, flown: Flight, frame: str = "map", child: str = "base_link") -> Topic:
    """A topic with every pose of a flight."""
    rows = zip(flown.t_ns, flown.positions, flown.quat_xyzw, strict=True)
    return Topic(topic, schema, [(int(t), message(schema, int(t), p, q, frame, child)) for t, p, q in rows])


def json_topic(topic: str, schema: str, messages: list[tuple[int, Any]]) -> Topic:
    """A topic of JSON messages."""
    return Topic(
        topic, schema, messages, ("json", "jsonschema"), b"{}", lambda content: json.dumps(content).encode()
    )


def protobuf_topic(
    topic: str, schema: str, file: FileDescriptorProto, messages: list[tuple[int, Any]]
) -> Topic:
    """A topic of protobuf messages, given as dictionaries."""
    pool = DescriptorPool()
    pool.Add(file)
    kind = GetMessageClass(pool.FindMessageTypeByName(schema))
    definition = FileDescriptorSet(file=[file]).SerializeToString()
    return Topic(
        topic, schema, messages, ("protobuf", "protobuf"), definition,
        lambda content: json_format.ParseDict(content, kind()).SerializeToString(),
    )  # fmt: skip


def foxglove_file() -> FileDescriptorProto:
    """Descriptors of the Foxglove schemas that the reader knows, in one file."""
    file = FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3")
    stamp = {"timestamp": "Stamp", "frame_id": "string"}
    frames = {"timestamp": "Stamp", "parent_frame_id": "string", "child_frame_id": "string"}
    for name, fields in {
        "Stamp": {"seconds": "int64", "nanos": "int32"},
        "Vector3": dict.fromkeys("xyz", "double"),
        "Quaternion": dict.fromkeys("xyzw", "double"),
        "Pose": {"position": "Vector3", "orientation": "Quaternion"},
        "PoseInFrame": stamp | {"pose": "Pose"},
        "FrameTransform": frames | {"translation": "Vector3", "rotation": "Quaternion"},
        "FrameTransforms": {"transforms": "FrameTransform*"},
        "CameraCalibration": stamp
        | {"width": "uint32", "height": "uint32", "distortion_model": "string", "K": "double*"},
        "LocationFix": stamp | {"latitude": "double", "longitude": "double", "altitude": "double"},
        "KeyValuePair": {"key": "string", "value": "string"},
        "Event": {"start_time": "Stamp", "end_time": "Stamp", "metadata": "KeyValuePair*"},
    }.items():
        message_type = file.message_type.add(name=name)
        for number, (key, kind) in enumerate(fields.items(), 1):
            part = message_type.field.add(name=key, number=number, label=3 if kind.endswith("*") else 1)
            kind = kind.rstrip("*")
            if kind in _SCALARS:
                part.type = _SCALARS[kind]
            else:
                part.type, part.type_name = 11, f".foxglove.{kind}"
    return file


_SCALARS = {"double": 1, "int64": 3, "int32": 5, "string": 9, "uint32": 13}


def px4(flown: Flight, **extra: Any) -> list[tuple[int, dict[str, Any]]]:
    """The flight as PX4 tells it: NED, FRD, w x y z, microseconds; `extra` goes into every message."""
    ned = flown.positions[:, [1, 0, 2]] * (1, 1, -1)
    half = np.sqrt(0.5)
    turn = Rotation.from_quat([half, half, 0, 0])
    quats = (turn * Rotation.from_quat(flown.quat_xyzw) * Rotation.from_quat([1, 0, 0, 0])).as_quat()
    messages = []
    for t, p, q in zip(flown.t_ns, ned, quats, strict=True):
        content = {"timestamp": int(t) // 1000 + 500, "timestamp_sample": int(t) // 1000}
        content |= {"q": [q[3], q[0], q[1], q[2]], "position": list(p), "x": p[0], "y": p[1], "z": p[2]}
        messages.append((int(t), content | extra))
    return messages


PX4_STAMPS = "uint32 MESSAGE_VERSION = 0\nuint64 timestamp # us\nuint64 timestamp_sample\n"
ROS2 |= {
    "px4_msgs/msg/Wind": PX4_STAMPS + "float32 windspeed_north\nfloat32 windspeed_east\n",
    "geometry_msgs/msg/TwistWithCovarianceStamped": (
        _STAMPED + "geometry_msgs/TwistWithCovariance twist\n" + _HEADER + _TWIST
    ),
    "px4_msgs/msg/VehicleOdometry": PX4_STAMPS
    + "uint8 POSE_FRAME_NED = 1\nuint8 pose_frame\nfloat32[3] position\nfloat32[4] q\nuint8 reset_counter\n",
    "px4_msgs/msg/VehicleLocalPosition": PX4_STAMPS
    + "bool xy_valid\nbool z_valid\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32[2] delta_xy\n"
    + "uint8 xy_reset_counter\nfloat32 delta_z\nuint8 z_reset_counter\n",
    "px4_msgs/msg/VehicleAttitude": PX4_STAMPS
    + "float32[4] q\nfloat32[4] delta_q_reset\nuint8 quat_reset_counter\n",
    "px4_msgs/msg/VehicleGlobalPosition": PX4_STAMPS
    + "float64 lat\nfloat64 lon\nfloat32 alt\nfloat32 alt_ellipsoid\nbool lat_lon_valid\nbool alt_valid\n",
    "px4_msgs/msg/GimbalDeviceAttitudeStatus": "uint64 timestamp\nuint8 target_system\n"
    + "uint16 device_flags\nfloat32[4] q\n",
    "mavros_msgs/msg/GimbalDeviceAttitudeStatus": _STAMPED
    + "uint8 target_system\nuint16 flags\ngeometry_msgs/Quaternion q\n" + _HEADER + _QUAT,
    "sensor_msgs/msg/NavSatFix": _STAMPED
    + "sensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n" + _HEADER
    + _part("sensor_msgs/NavSatStatus", "int8 STATUS_NO_FIX=-1", "int8 status -2", "uint16 service"),
    "sensor_msgs/msg/Imu": _STAMPED
    + "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    + "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    + "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    + _HEADER + _QUAT + _part("geometry_msgs/Vector3", *_XYZ),
}  # fmt: skip


def write_log(
    path: Path,
    topics: Sequence[Topic],
    metadata: Mapping[str, str] | None = None,
    chunk_size: int = 2**14,
    compression: CompressionType = CompressionType.ZSTD,
    **writing: Any,
) -> Path:
    """An MCAP log of these topics in the order of their log times."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=compression, **writing)
        writer.start("", "test")
        queue = []
        for topic in topics:
            definition, encode = topic.definition, topic.encode
            if encode is None:
                definition = ROS2[topic.schema].encode()
                encode = serialize_dynamic(topic.schema, ROS2[topic.schema])[topic.schema]
            schema = writer.register_schema(topic.schema, topic.encoding[1], definition)
            channel = writer.register_channel(topic.topic, topic.encoding[0], schema)
            queue += [(log_ns, channel, encode(content)) for log_ns, content in topic.messages]
        for log_ns, channel, data in sorted(queue, key=lambda item: item[0]):
            writer.add_message(channel, log_ns, data, log_ns)
        if metadata is not None:
            writer.add_metadata("inspection", dict(metadata))
        writer.finish()
    return path
