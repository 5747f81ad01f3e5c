"""Definitions of the ROS 2 messages that we write, as an MCAP log carries them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.writer import Writer
from rosbags.typesys import Stores, get_typestore

from upplied.records import Camera, Floats

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


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
    return {
        "header": header,
        "height": height,
        "width": width,
        "distortion_model": model,
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
    return {
        "position": dict(zip("xyz", map(float, position), strict=True)),
        "orientation": dict(zip("xyzw", map(float, quat_xyzw), strict=True)),
    }


def transform(stamp_ns: int, parent: str, child: str, position: Floats, quat_xyzw: Floats) -> dict[str, Any]:
    """The pose of a frame in its parent."""
    place = pose(position, quat_xyzw)
    return {
        "header": header(stamp_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": place["position"], "rotation": place["orientation"]},
    }
