"""Definitions of the ROS 2 messages that we write, as an MCAP log carries them."""

from __future__ import annotations

from typing import Any

import numpy as np

from upplied.records import Camera

_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
_POINT = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE = "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"

_PARTS = {
    "builtin_interfaces/Time": _TIME,
    "std_msgs/Header": _HEADER,
    "geometry_msgs/Point": _POINT,
    "geometry_msgs/Vector3": _POINT,
    "geometry_msgs/Quaternion": _QUATERNION,
    "geometry_msgs/Pose": _POSE,
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
    "sensor_msgs/RegionOfInterest": (
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    ),
}


def _definition(fields: str, *parts: str) -> str:
    """A message's own fields, followed by those of every message it is made of."""
    rule = "=" * 80
    return fields + "".join(f"{rule}\nMSG: {name}\n{_PARTS[name]}" for name in parts)


POSE_STAMPED = _definition(
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "std_msgs/Header",
    "builtin_interfaces/Time",
    "geometry_msgs/Pose",
    "geometry_msgs/Point",
    "geometry_msgs/Quaternion",
)
ODOMETRY = _definition(
    "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    "std_msgs/Header",
    "builtin_interfaces/Time",
    "geometry_msgs/PoseWithCovariance",
    "geometry_msgs/Pose",
    "geometry_msgs/Point",
    "geometry_msgs/Quaternion",
    "geometry_msgs/TwistWithCovariance",
    "geometry_msgs/Twist",
    "geometry_msgs/Vector3",
)
TF = _definition(
    "geometry_msgs/TransformStamped[] transforms\n",
    "geometry_msgs/TransformStamped",
    "std_msgs/Header",
    "builtin_interfaces/Time",
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3",
    "geometry_msgs/Quaternion",
)
CAMERA_INFO = _definition(
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n"
    "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
    "uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
    "std_msgs/Header",
    "builtin_interfaces/Time",
    "sensor_msgs/RegionOfInterest",
)
COMPRESSED_IMAGE = _definition(
    "std_msgs/Header header\nstring format\nuint8[] data\n", "std_msgs/Header", "builtin_interfaces/Time"
)


def camera_info(camera: Camera, header: dict[str, Any]) -> dict[str, Any]:
    """The calibration message of a camera without distortion."""
    width, height = camera.width_px or 1000, camera.height_px or 1000
    model, fx, fy = _focal(camera, width, height)
    return {
        "header": header,
        "height": height,
        "width": width,
        "distortion_model": model,
        "d": [0.0] * (4 if model == "equidistant" else 5),
        "k": [fx, 0.0, width / 2, 0.0, fy, height / 2, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, width / 2, 0.0, 0.0, fy, height / 2, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


def _focal(camera: Camera, width: int, height: int) -> tuple[str, float, float]:
    """Model and focal lengths, px: a pinhole, or a fisheye where a pinhole cannot be."""
    half = np.radians([camera.hfov_deg, camera.vfov_deg]) / 2
    if half.max() < np.radians(80):
        fx, fy = np.array([width, height]) / 2 / np.tan(half)
        return "plumb_bob", float(fx), float(fy)
    fx, fy = np.array([width, height]) / 2 / half
    return "equidistant", float(fx), float(fy)
