"""Field of view from the calibration in a log: ROS CameraInfo and Foxglove CameraCalibration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.inputs.flight.tracks import Track, names, source_times, stamps
from upplied.inputs.sidecar import LogOptions
from upplied.inputs.tables import Table
from upplied.records import Camera, Floats, Ints

_CALIBRATION = ("width", "height", "k", "K", "distortion_model")
FIELDS = {
    "sensor_msgs/CameraInfo": (
        "header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *_CALIBRATION,
    ),
    "foxglove.CameraCalibration": ("timestamp.sec", "timestamp.nanosec", "frame_id", *_CALIBRATION),
}  # fmt: skip
NO_CALIBRATION = "no camera calibration in the log"
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "fisheye62")


@dataclass(frozen=True)
class Zoom:
    """The field of view in time: from each of these stamps on, horizontal and vertical, deg."""

    t_ns: Ints  # (K,) increasing
    hfov_deg: Floats  # (K,)
    vfov_deg: Floats  # (K,)

    def during(self, first_ns: int, last_ns: int) -> Zoom:
        """The fields of view between two stamps; all of them where the clocks have nothing in common."""
        start = max(int(np.searchsorted(self.t_ns, first_ns, side="right")) - 1, 0)
        stop = int(np.searchsorted(self.t_ns, last_ns, side="right"))
        part = slice(start, stop) if stop > start else slice(None)
        return Zoom(self.t_ns[part], self.hfov_deg[part], self.vfov_deg[part])

    @property
    def spread_pct(self) -> float:
        """By how much the widest exceeds the narrowest, %."""
        return float(100 * (self.hfov_deg.max() / self.hfov_deg.min() - 1)) if len(self.t_ns) else 0.0


def calibrated(table: Table) -> tuple[Camera, str, Zoom] | None:
    """Camera, name of its optical frame, and its field of view in time; None where it is not calibrated.

    The pinhole model gives ``fov = 2 atan(w / 2 f)``, the fisheye models ``w / f``.
    """
    matrix = table.vectors("k" if "k" in table else "K", 9)
    values = np.column_stack([table.stack("width", "height"), matrix[:, [0, 4]]])
    good = ((values > 1e-3) & (values < 1e7)).all(axis=1)
    if not good.any():
        return None
    model = str(names(table, "distortion_model")[good][0]).lower()
    frame = "frame_id" if "frame_id" in table else "header.frame_id"
    prefix = "timestamp" if "frame_id" in table else "header.stamp"
    t_ns = source_times(table, stamps(table, prefix))[0][good]
    fields = np.array([[_fov_deg(w, fx, model), _fov_deg(h, fy, model)] for w, h, fx, fy in values[good]])
    fields = np.minimum(fields, [360.0, 180.0])
    order = np.argsort(t_ns, kind="stable")
    changes = order[np.append(True, np.abs(np.diff(fields[order, 0])) > 1e-3)]
    width, height = np.median(values[good][:, :2], axis=0)
    middle = np.median(fields, axis=0)
    camera = Camera(
        hfov_deg=float(middle[0]),
        vfov_deg=float(middle[1]),
        width_px=int(min(width, 1e6)),
        height_px=int(min(height, 1e6)),
    )
    return camera, str(names(table, frame)[good][0]), Zoom(t_ns[changes], *fields[changes].T)


def camera_of(
    tables: Sequence[Table], facts: LogOptions, what: str
) -> tuple[Camera, str, list[str], Zoom | None]:
    """The camera of a flight: what the log measured, what the facts say, and defaults for the rest.

    Returns
    -------
    camera : Camera
    frame : str
        Name of its optical frame, where known.
    notes : list of str
    zoom : Zoom or None
        Its field of view in time, where the log measured it and nothing else is said.

    Raises
    ------
    InputError
        If the log holds several cameras and nothing says which.
    """
    calibrations = [table for table in tables if table.schema in FIELDS]
    found = {t.channel.topic: cam for t in calibrations if (cam := calibrated(t)) is not None}
    if facts.camera_frame_id:
        found = {topic: cam for topic, cam in found.items() if cam[1] == facts.camera_frame_id.lstrip("/")}
    if len({(cam.hfov_deg, cam.vfov_deg, frame) for cam, frame, _ in found.values()}) > 1:
        listed = ", ".join(
            f"{topic} (frame {frame}, {cam.hfov_deg:.0f} deg)" for topic, (cam, frame, _) in found.items()
        )
        raise InputError(
            what, f"holds several cameras: {listed}", "one camera", "name one by camera_frame_id"
        )
    camera, frame, zoom = next(iter(found.values()), (Camera(), "", None))
    notes = [] if found else [NO_CALIBRATION]
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
    said = facts.camera_hfov_deg is not None
    return camera, facts.camera_frame_id.lstrip("/") or frame, notes, None if said else zoom


def through(camera: Camera, zoom: Zoom | None, track: Track, facts: LogOptions, what: str) -> Camera:
    """The camera of the flight that was chosen: the one there was, never an average of several.

    Raises
    ------
    InputError
        If the field of view changes, and that is not allowed. Where it is, the narrowest field of
        view counts for the whole flight: what it claims to have seen, it saw.
    """
    if zoom is None or not len(track):
        return camera
    flown = zoom.during(int(track.t_ns[0]), int(track.t_ns[-1]))
    if flown.spread_pct > facts.passport.zoom_pct and "zoom" not in facts.allow:
        seconds = (flown.t_ns[:6] - track.t_ns[0]) * 1e-9
        listed = ", ".join(
            f"{angle:.1f} deg from {max(second, 0):.0f} s on"
            for angle, second in zip(flown.hfov_deg, seconds, strict=False)
        )
        raise InputError(
            what,
            f"zoom: the field of view changes in flight ({listed}{', ...' if len(flown.t_ns) > 6 else ''})",
            f"one field of view, within {facts.passport.zoom_pct:g} %",
            "take the part with one by start_s and stop_s, or --allow zoom: the narrowest then counts",
        )
    narrow = int(np.argmin(flown.hfov_deg))
    vfov = camera.vfov_deg if facts.camera_vfov_deg is not None else float(flown.vfov_deg[narrow])
    return replace(camera, hfov_deg=float(flown.hfov_deg[narrow]), vfov_deg=vfov)


def _fov_deg(pixels: float, focal_px: float, model: str) -> float:
    if any(model.startswith(name) for name in _FISHEYE):
        return math.degrees(pixels / focal_px)
    return math.degrees(2 * math.atan(pixels / (2 * focal_px)))
