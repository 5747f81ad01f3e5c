"""Field of view from the calibration in a log: ROS CameraInfo and Foxglove CameraCalibration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.inputs.flight.tracks import names
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Camera

FIELDS = {
    "sensor_msgs/CameraInfo": ("header.frame_id", "width", "height", "k", "K", "distortion_model"),
    "foxglove.CameraCalibration": ("frame_id", "width", "height", "k", "K", "distortion_model"),
}
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "fisheye62")


def calibrated(table: Table) -> tuple[Camera, str] | None:
    """Camera and name of its optical frame; None where the camera was not calibrated.

    The pinhole model gives ``fov = 2 atan(w / 2 f)``, the fisheye models ``w / f``.
    """
    matrix = table.vectors("k" if "k" in table else "K", 9)
    values = np.column_stack([table.stack("width", "height"), matrix[:, [0, 4]]])
    good = ((values > 1e-3) & (values < 1e7)).all(axis=1)
    if not good.any():
        return None
    width, height, fx, fy = np.median(values[good], axis=0)
    model = str(names(table, "distortion_model")[good][0]).lower()
    angles = [_fov_deg(width, fx, model), _fov_deg(height, fy, model)]
    frame = "frame_id" if "frame_id" in table else "header.frame_id"
    camera = Camera(
        hfov_deg=min(angles[0], 360.0),
        vfov_deg=min(angles[1], 180.0),
        width_px=int(min(width, 1e6)),
        height_px=int(min(height, 1e6)),
    )
    return camera, str(names(table, frame)[good][0])


def camera_of(tables: Sequence[Table], facts: LogOptions, what: str) -> tuple[Camera, str, list[str]]:
    """The camera of a flight: what the log measured, what the facts say, and defaults for the rest.

    Returns
    -------
    camera : Camera
    frame : str
        Name of its optical frame, where known.
    notes : list of str

    Raises
    ------
    InputError
        If the log holds several cameras and nothing says which.
    """
    calibrations = [table for table in tables if table.schema in FIELDS]
    found = {t.channel.topic: cam for t in calibrations if (cam := calibrated(t)) is not None}
    if facts.camera_frame_id:
        found = {topic: cam for topic, cam in found.items() if cam[1] == facts.camera_frame_id.lstrip("/")}
    if len({(cam.hfov_deg, cam.vfov_deg, frame) for cam, frame in found.values()}) > 1:
        listed = ", ".join(
            f"{topic} (frame {frame}, {cam.hfov_deg:.0f} deg)" for topic, (cam, frame) in found.items()
        )
        raise InputError(
            what, f"holds several cameras: {listed}", "one camera", "name one by camera_frame_id"
        )
    camera, frame = next(iter(found.values()), (Camera(), ""))
    notes = [] if found else ["no camera calibration in the log"]
    told: dict[str, Any] = {
        "hfov_deg": facts.camera_hfov_deg,
        "vfov_deg": facts.camera_vfov_deg,
        "min_range_m": facts.camera_min_range_m,
        "max_range_m": facts.camera_max_range_m,
    }
    camera = replace(camera, **{name: value for name, value in told.items() if value is not None})
    if camera.min_range_m >= camera.max_range_m:
        found_range = f"{camera.min_range_m} to {camera.max_range_m} m"
        raise InputError(f"{what}, camera range", f"got {found_range}", "the least range below the greatest")
    return camera, facts.camera_frame_id.lstrip("/") or frame, notes


def _fov_deg(pixels: float, focal_px: float, model: str) -> float:
    if any(model.startswith(name) for name in _FISHEYE):
        return math.degrees(pixels / focal_px)
    return math.degrees(2 * math.atan(pixels / (2 * focal_px)))
