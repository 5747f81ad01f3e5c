"""A demonstration as an MCAP log, as a drone's ROS 2 recorder leaves it: its bytes depend on that alone.

The structure is moved and turned in the log's fixed frame; a metadata record ``inspection`` states its place,
its ID and the mount of the camera.
"""

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.records import Schema
from mcap_ros2.writer import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from upplied.errors import SettingsError
from upplied.extras import extra
from upplied.files import replace_file
from upplied.geometry.poses import interpolate, matrices, moved
from upplied.geometry.scene import scene_of
from upplied.records import Camera, Demonstration, Floats, Structure, Trajectory

Encoding = Literal["pose_stamped", "odometry", "tf"]

CAMERA_FRAME, BODY_FRAME = "camera_optical_frame", "base_link"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_OPTICAL_XYZW = (-0.5, 0.5, -0.5, 0.5)  # ROS optical frame (z forward, y down) to camera (x forward, z up)
_LATENCY_NS = 4_000_000  # from measurement to recorder
_SECOND_NS = 1_000_000_000
# How the camera sits on the body (x forward, y left, z up): its place, m, and its turn, 10 deg upwards.
_MOUNT_M, _MOUNT = np.array([0.11, 0.0, -0.06]), Rotation.from_euler("y", -10.0, degrees=True)
_SCHEMAS = (
    "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage",
    CAMERA_INFO, "sensor_msgs/msg/CompressedImage",
)  # fmt: skip
_TOPICS = {
    "pose_stamped": ("/drone/camera/pose", "geometry_msgs/msg/PoseStamped"),
    "odometry": ("/drone/odom", "nav_msgs/msg/Odometry"),
    "tf": ("/tf", "tf2_msgs/msg/TFMessage"),
}
_Message = tuple[int, str, str, dict[str, Any]]  # stamp in ns, topic, schema, fields
_SIDE_PX = 192  # of a picture
_SKY, _GROUND, _PAINT = np.array([188, 214, 240]), np.array([168, 184, 150]), np.array([226, 228, 232])
_SUN = np.array([0.45, -0.35, 0.82])


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
    """Write a demonstration as an MCAP log; returns its path.

    The structure is the subject of the camera's pictures, and the log names its kind; pictures, or noise
    without a structure, are the `heavy_topic`. Poses are of the camera as PoseStamped, or of the body as
    Odometry or transforms, by `encoding`. A log that is marked as `simulated` never counts as the flight of a
    plan.
    """
    frame = frame or LogFrame()
    in_log = moved(demonstration.trajectory, frame.rotation.as_matrix(), np.array(frame.position_m))
    poses = in_log
    if encoding != "pose_stamped":  # of the body that carries the camera
        body = Rotation.from_quat(in_log.quat_xyzw) * _MOUNT.inv()
        places = in_log.positions - body.apply(_MOUNT_M)
        poses = Trajectory(in_log.t_s, places, np.asarray(body.as_quat()))
    messages = _static(demonstration, encoding)
    messages += _poses(demonstration, poses, frame, encoding)
    messages += _calibration(demonstration)
    if heavy_topic:
        messages += _pictures(demonstration, structure)
    messages.sort(key=lambda message: message[0])
    buffer = io.BytesIO()
    writer = Writer(buffer)
    schemas = registered(writer, _SCHEMAS)
    writer.add_metadata("inspection", _facts(demonstration, structure, frame, encoding, simulated))
    for number, (stamp, topic, schema, message) in enumerate(messages):
        sent = stamp + _LATENCY_NS // 2
        writer.write_message(topic, schemas[schema], message, stamp + _LATENCY_NS, sent, number)
    writer.finish()
    return replace_file(path, buffer.getvalue())


def _facts(
    flown: Demonstration, structure: Structure | None, frame: LogFrame, encoding: Encoding, simulated: bool
) -> dict[str, str]:
    camera = flown.camera
    facts = {
        "schema_version": "1",
        **{name: getattr(flown, name) for name in ("structure_id", "demonstration_id", "operator", "site")},
        "kind": structure.kind if structure is not None else "",
        "frame_id": frame.frame_id,
        "structure_position_m": _numbers(frame.position_m),
        "structure_quat_xyzw": _numbers(frame.rotation.as_quat()),
        "camera_min_range_m": repr(float(camera.min_range_m)),
        "camera_max_range_m": repr(float(camera.max_range_m)),
        "body_frame": {"pose_stamped": "camera", "odometry": "body", "tf": "optical"}[encoding],
        "notes": flown.notes,
    }
    facts |= {"simulated": "true"} if simulated else {}
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
    link = transform(stamp, parent, CAMERA_FRAME, position, rotation.as_quat())
    return [(stamp, "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [link]})]


def _poses(flown: Demonstration, poses: Trajectory, frame: LogFrame, encoding: Encoding) -> list[_Message]:
    if encoding not in _TOPICS:
        raise SettingsError(f"encoding {encoding!r}", "is unknown", f"one of {', '.join(_TOPICS)}")
    (topic, schema), frame_id = _TOPICS[encoding], frame.frame_id
    messages: list[_Message] = []
    for stamp, *place in zip(flown.t_ns.tolist(), poses.positions, poses.quat_xyzw, strict=True):
        stamped = {"header": header(stamp, frame_id), "pose": pose(*place)}
        # What is not stated of an odometry is zero.
        moving = {**stamped, "child_frame_id": BODY_FRAME, "pose": {"pose": stamped["pose"]}}
        links = {"transforms": [transform(stamp, frame_id, BODY_FRAME, *place)]}
        fields: dict[str, dict[str, Any]] = {"pose_stamped": stamped, "odometry": moving, "tf": links}
        messages.append((stamp, topic, schema, fields[encoding]))
    return messages


def _calibration(demonstration: Demonstration) -> list[_Message]:
    """The calibration every second; where the camera zooms, with every pose."""
    stamps = _stamps(demonstration, 1.0)
    cameras = [demonstration.camera] * len(stamps)
    if demonstration.fov_deg is not None:
        stamps = demonstration.t_ns.tolist()
        cameras = demonstration.camera.zoomed(demonstration.fov_deg)
    topic, info = "/camera/camera_info", camera_info
    return [
        (at, topic, CAMERA_INFO, info(camera, header(at, CAMERA_FRAME)))
        for at, camera in zip(stamps, cameras, strict=True)
    ]


def _stamps(demonstration: Demonstration, every_s: float) -> list[int]:
    first, last = int(demonstration.t_ns[0]), int(demonstration.t_ns[-1])
    return list(range(first, last + 1, int(every_s * _SECOND_NS)))


def _pictures(demonstration: Demonstration, structure: Structure | None) -> list[_Message]:
    stamps = _stamps(demonstration, 2.0)
    poses = interpolate(demonstration.trajectory, (np.array(stamps) - demonstration.t_ns[0]) * 1e-9)
    pictures = _jpegs(structure, poses, demonstration.camera)
    topic, schema = "/camera/image/compressed", "sensor_msgs/msg/CompressedImage"
    return [
        (at, topic, schema, {"header": header(at, CAMERA_FRAME), "format": "jpeg", "data": jpeg})
        for at, jpeg in zip(stamps, pictures, strict=True)
    ]


def _jpegs(structure: Structure | None, poses: Trajectory, camera: Camera) -> Iterator[bytes]:
    """A small JPEG of each pose; grey noise where no structure is given."""
    with extra("export"):
        from PIL import Image
    across, down = np.tan(np.radians(np.minimum([camera.hfov_deg, camera.vfov_deg], 150.0)) / 2)
    y, z = np.meshgrid(np.linspace(across, -across, _SIDE_PX), np.linspace(down, -down, _SIDE_PX))
    rays = np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3)  # row by row from the upper left
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rng = np.random.default_rng(len(poses))
    for position, turn in zip(poses.positions, matrices(poses.quat_xyzw), strict=True):
        if structure is None:
            pixels = np.repeat(rng.integers(0, 256, (len(rays), 1)).astype(float), 3, axis=1)
        else:
            pixels = _shaded(structure, position, rays @ turn.T)
        image = np.clip(pixels, 0, 255).astype(np.uint8).reshape(_SIDE_PX, _SIDE_PX, 3)
        stream = io.BytesIO()
        Image.fromarray(image).save(stream, "JPEG", quality=80)
        yield stream.getvalue()


def _shaded(structure: Structure, position: Floats, rays: Floats) -> Floats:
    reach, triangle, normal = scene_of(structure).cast(np.broadcast_to(position, rays.shape), rays)
    facing = np.einsum("ij,ij->i", normal, rays)
    normal = np.where(facing[:, None] > 0, -normal, normal)
    light = 0.35 + 0.4 * np.clip(normal @ _SUN, 0, 1) + 0.25 * np.abs(facing)
    background = np.where(rays[:, 2:] < 0, _GROUND, _SKY)
    hazed = light[:, None] * _PAINT * np.exp(-np.where(np.isfinite(reach), reach, 0) / 400)[:, None]
    return np.where(triangle[:, None] >= 0, hazed, background)


def registered(writer: Writer, names: Iterable[str]) -> dict[str, Schema]:
    """The schema of each message, by its name, with the definitions of ROS 2 Humble."""
    text_of = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef
    return {name: writer.register_msgdef(name, text_of(name, ros_version=2)[0]) for name in names}


def camera_info(camera: Camera, header: dict[str, Any]) -> dict[str, Any]:
    """The calibration message of a camera without distortion: a fisheye where no pinhole can be."""
    width, height = camera.width_px or 1000, camera.height_px or 1000
    half = np.radians([camera.hfov_deg, camera.vfov_deg]) / 2
    model = "plumb_bob" if half.max() < np.radians(80) else "equidistant"
    reach = np.tan(half) if model == "plumb_bob" else half
    fx, fy = (np.array([width, height]) / 2 / reach).tolist()
    return {"header": header, "height": height, "width": width, "distortion_model": model} | {
        "d": [0.0] * (4 if model == "equidistant" else 5),
        "k": [fx, 0.0, width / 2, 0.0, fy, height / 2, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, width / 2, 0.0, 0.0, fy, height / 2, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def header(stamp_ns: int, frame_id: str) -> dict[str, Any]:
    """The header of a stamped message."""
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame_id}


def pose(position: Floats, quat_xyzw: Floats) -> dict[str, Any]:
    """A pose, from a position (3,), m, and a quaternion (4,)."""
    orientation = dict(zip("xyzw", map(float, quat_xyzw), strict=True))
    return {"position": dict(zip("xyz", map(float, position), strict=True)), "orientation": orientation}


def transform(stamp_ns: int, parent: str, child: str, position: Floats, quat_xyzw: Floats) -> dict[str, Any]:
    """The pose of a frame in its parent."""
    place = pose(position, quat_xyzw)
    motion = {"translation": place["position"], "rotation": place["orientation"]}
    return {"header": header(stamp_ns, parent), "child_frame_id": child, "transform": motion}
