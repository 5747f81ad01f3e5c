"""A demonstration as an MCAP log, as a drone's ROS 2 recorder leaves it.

The structure is moved and turned in the log's fixed frame; a metadata record ``inspection``
states its place, its ID and the mount of the camera. The bytes depend on the demonstration and
the arguments alone.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap_ros2.writer import Writer
from scipy.spatial.transform import Rotation

from upplied.errors import SettingsError
from upplied.files import replace_file
from upplied.geometry.poses import interpolate, moved
from upplied.outputs import ros2_schemas
from upplied.outputs.camera_pictures import camera_pictures
from upplied.records import Demonstration, Structure, Trajectory

Encoding = Literal["pose_stamped", "odometry", "tf"]

CAMERA_FRAME, BODY_FRAME = "camera_optical_frame", "base_link"
_OPTICAL_XYZW = (-0.5, 0.5, -0.5, 0.5)  # ROS optical frame (z forward, y down) to camera (x forward, z up)
_LATENCY_NS = 4_000_000  # from measurement to recorder
_SECOND_NS = 1_000_000_000
# How the camera sits on the body (x forward, y left, z up): its place, m, and its turn, 10 deg upwards.
_MOUNT_M, _MOUNT = np.array([0.11, 0.0, -0.06]), Rotation.from_euler("y", -10.0, degrees=True)


@dataclass(frozen=True)
class LogFrame:
    """The log's fixed frame: its name, and the place of the structure in it."""

    frame_id: str = "map"
    position_m: tuple[float, float, float] = (41.5, -17.25, 0.8)
    heading_deg: float = 32.0  # of the structure's +X, counter-clockwise from the frame's x

    @property
    def rotation(self) -> Rotation:
        """Structure to log frame."""
        return Rotation.from_euler("z", self.heading_deg, degrees=True)


def write_log(
    path: str | Path,
    demonstration: Demonstration,
    structure: Structure | None = None,
    heavy_topic: bool = True,
    frame: LogFrame | None = None,
    encoding: Encoding = "pose_stamped",
    simulated: bool = False,
) -> Path:
    """Write a demonstration as an MCAP log.

    Parameters
    ----------
    path : path
    demonstration : Demonstration
    structure : Structure, optional
        Subject of the camera's pictures; the log names its kind.
    heavy_topic : bool
        Also write pictures from the camera, or noise without a structure.
    frame : LogFrame, optional
    encoding : {"pose_stamped", "odometry", "tf"}
        Poses of the camera as PoseStamped; of the body as Odometry, or as transforms.
    simulated : bool
        Mark the log as simulated, so that it never counts as the flight of a plan.

    Returns
    -------
    Path
        The file, complete.
    """
    frame = frame or LogFrame()
    in_log = moved(demonstration.trajectory, frame.rotation.as_matrix(), np.array(frame.position_m))
    poses = in_log if encoding == "pose_stamped" else _of_body(in_log)
    messages = _static(demonstration, encoding)
    messages += _poses(demonstration, poses, frame, encoding)
    messages += _calibration(demonstration)
    if heavy_topic:
        messages += _pictures(demonstration, structure)
    messages.sort(key=lambda message: message[0])
    buffer = io.BytesIO()
    writer = Writer(buffer)
    schemas = ros2_schemas.registered(writer, _SCHEMAS)
    writer.add_metadata("inspection", _facts(demonstration, structure, frame, encoding, simulated))
    for number, (stamp, topic, schema, message) in enumerate(messages):
        sent = stamp + _LATENCY_NS // 2
        writer.write_message(topic, schemas[schema], message, stamp + _LATENCY_NS, sent, number)
    writer.finish()
    return replace_file(path, buffer.getvalue())


_SCHEMAS = (
    "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage",
    ros2_schemas.CAMERA_INFO, "sensor_msgs/msg/CompressedImage",
)  # fmt: skip
_Message = tuple[int, str, str, dict[str, Any]]  # stamp in ns, topic, schema, fields


def _of_body(camera: Trajectory) -> Trajectory:
    """Poses of the body that carries the camera."""
    body = Rotation.from_quat(camera.quat_xyzw) * _MOUNT.inv()
    return Trajectory(camera.t_s, camera.positions - body.apply(_MOUNT_M), np.asarray(body.as_quat()))


def _facts(
    demonstration: Demonstration,
    structure: Structure | None,
    frame: LogFrame,
    encoding: Encoding,
    simulated: bool,
) -> dict[str, str]:
    camera = demonstration.camera
    facts = {
        "schema_version": "1",
        "structure_id": demonstration.structure_id,
        "demonstration_id": demonstration.demonstration_id,
        "operator": demonstration.operator,
        "site": demonstration.site,
        "kind": structure.kind if structure is not None else "",
        "frame_id": frame.frame_id,
        "structure_position_m": _numbers(frame.position_m),
        "structure_quat_xyzw": _numbers(frame.rotation.as_quat()),
        "camera_min_range_m": repr(float(camera.min_range_m)),
        "camera_max_range_m": repr(float(camera.max_range_m)),
        "body_frame": {"pose_stamped": "camera", "odometry": "body", "tf": "optical"}[encoding],
        "notes": demonstration.notes,
    }
    if simulated:
        facts["simulated"] = "true"
    if encoding == "odometry":
        facts["body_T_camera_position_m"] = _numbers(_MOUNT_M)
        facts["body_T_camera_quat_xyzw"] = _numbers(_MOUNT.as_quat())
    return facts


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def _static(demonstration: Demonstration, encoding: Encoding) -> list[_Message]:
    """The static transform of the camera's optical frame, from the body or from the tracked camera."""
    optical = Rotation.from_quat(_OPTICAL_XYZW)
    parent, position, rotation = "camera_link", np.zeros(3), optical
    if encoding != "pose_stamped":
        parent, position, rotation = BODY_FRAME, _MOUNT_M, _MOUNT * optical
    stamp = int(demonstration.t_ns[0])
    link = ros2_schemas.transform(stamp, parent, CAMERA_FRAME, position, rotation.as_quat())
    return [(stamp, "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [link]})]


def _poses(
    demonstration: Demonstration, poses: Trajectory, frame: LogFrame, encoding: Encoding
) -> list[_Message]:
    if encoding not in _TOPICS:
        raise SettingsError(f"encoding {encoding!r}", "is unknown", f"one of {', '.join(_TOPICS)}")
    (topic, schema), frame_id = _TOPICS[encoding], frame.frame_id
    messages: list[_Message] = []
    for stamp, *place in zip(demonstration.t_ns.tolist(), poses.positions, poses.quat_xyzw, strict=True):
        stamped = {"header": ros2_schemas.header(stamp, frame_id), "pose": ros2_schemas.pose(*place)}
        # What is not stated of an odometry is zero.
        moving = {**stamped, "child_frame_id": BODY_FRAME, "pose": {"pose": stamped["pose"]}}
        links = {"transforms": [ros2_schemas.transform(stamp, frame_id, BODY_FRAME, *place)]}
        fields: dict[str, dict[str, Any]] = {"pose_stamped": stamped, "odometry": moving, "tf": links}
        messages.append((stamp, topic, schema, fields[encoding]))
    return messages


_TOPICS = {
    "pose_stamped": ("/drone/camera/pose", "geometry_msgs/msg/PoseStamped"),
    "odometry": ("/drone/odom", "nav_msgs/msg/Odometry"),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage"),
}


def _calibration(demonstration: Demonstration) -> list[_Message]:
    """The calibration every second; where the camera zooms, with every pose."""
    stamps = _stamps(demonstration, 1.0)
    cameras = [demonstration.camera] * len(stamps)
    if demonstration.fov_deg is not None:
        stamps = demonstration.t_ns.tolist()
        cameras = demonstration.camera.zoomed(demonstration.fov_deg)
    topic, info = "/camera/camera_info", ros2_schemas.camera_info
    return [
        (at, topic, ros2_schemas.CAMERA_INFO, info(camera, _camera_header(at)))
        for at, camera in zip(stamps, cameras, strict=True)
    ]


def _camera_header(stamp: int) -> dict[str, Any]:
    return ros2_schemas.header(stamp, CAMERA_FRAME)


def _stamps(demonstration: Demonstration, every_s: float) -> list[int]:
    first, last = int(demonstration.t_ns[0]), int(demonstration.t_ns[-1])
    return list(range(first, last + 1, int(every_s * _SECOND_NS)))


def _pictures(demonstration: Demonstration, structure: Structure | None) -> list[_Message]:
    stamps = _stamps(demonstration, 2.0)
    t_s = (np.array(stamps) - demonstration.t_ns[0]) * 1e-9
    pictures = camera_pictures(structure, interpolate(demonstration.trajectory, t_s), demonstration.camera)
    topic, schema = "/camera/image/compressed", "sensor_msgs/msg/CompressedImage"
    return [
        (at, topic, schema, {"header": _camera_header(at), "format": "jpeg", "data": picture})
        for at, picture in zip(stamps, pictures, strict=True)
    ]
