"""What a file holds of a flight, whatever it is written in, and the tables that readers fill.

The tables bear the schemas that `upplied.inputs.schemas` reads, so frames, clocks, cleaning and passport
are one way for all kinds of file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from upplied.inputs.tables import Channel, Table
from upplied.records import Floats, Ints

Fields = Mapping[str, Sequence[str]]  # schema -> the paths that are read of it
MAX_ROWS = 5_000_000
_IN_EARTH, _IN_VEHICLE = 64, 32  # flags of GIMBAL_DEVICE_ATTITUDE_STATUS


@dataclass
class Source:
    """Tables of one flight, and what its kind of file says of itself."""

    tables: list[Table]
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    listed: str = ""  # topics and schemas in words; of the tables where empty
    read_pct: float = 100.0
    notes: list[str] = field(default_factory=list)
    defaults: dict[str, Any] = field(default_factory=dict)  # facts that hold where nobody says otherwise
    stills: bool = False  # photos: no pose between them is missing
    planned: bool = False  # a mission that was written, not a flight that was flown

    @property
    def topics(self) -> str:
        """Topics and schemas in words."""
        tables = [f"{table.channel.topic} ({table.schema})" for table in self.tables]
        return self.listed or ", ".join(tables[:12])


def table(topic: str, schema: str, t_ns: Ints, **columns: Any) -> Table:
    """A table of one topic; ``__`` in the name of a column stands for a dot."""
    t_ns = np.asarray(t_ns, np.int64)
    named = {name.replace("__", "."): np.asarray(column) for name, column in columns.items()}
    return Table(Channel(0, topic, "", schema), named, t_ns, t_ns, len(t_ns))


def poses(topic: str, t_ns: Ints, positions: Floats, quat_xyzw: Floats, frame: str = "") -> Table:
    """Poses (N, 3), m, and (N, 4) in a frame with z up."""
    t_ns = np.asarray(t_ns, np.int64)
    columns = {f"pose.position.{axis}": positions[:, at] for at, axis in enumerate("xyz")}
    columns |= {f"pose.orientation.{axis}": quat_xyzw[:, at] for at, axis in enumerate("xyzw")}
    named = np.full(len(t_ns), frame, object)
    return table(topic, "geometry_msgs/PoseStamped", t_ns, **columns, **_stamp(t_ns), header__frame_id=named)


def fixes(topic: str, t_ns: Ints, lat: Floats, lon: Floats, **altitude: Floats) -> Table:
    """Places, deg; `altitude` is ``alt`` (mean sea level), ``alt_ellipsoid`` or ``alt_takeoff``, m."""
    stamps = np.asarray(t_ns, np.int64) // 1000
    lat, lon = np.asarray(lat, float), np.asarray(lon, float)
    nowhere = (lat == 0) & (lon == 0)  # before the first fix
    where = {"lat": np.where(nowhere, np.nan, lat), "lon": np.where(nowhere, np.nan, lon)}
    return table(topic, "px4_msgs/VehicleGlobalPosition", t_ns, timestamp=stamps, **where, **altitude)


def attitudes(topic: str, t_ns: Ints, yaw: Floats, pitch: Floats, roll: Floats) -> Table:
    """Attitudes of a vehicle, deg: yaw clockwise from north, pitch up, roll to the right."""
    stamps = np.asarray(t_ns, np.int64) // 1000
    return table(topic, "px4_msgs/VehicleAttitude", t_ns, timestamp=stamps, q=ned_wxyz(yaw, pitch, roll))


def gimbals(topic: str, t_ns: Ints, yaw: Floats, pitch: Floats, roll: Floats, north: bool = True) -> Table:
    """Attitudes of a camera, deg; yaw from north, or from the vehicle's heading."""
    t_ns = np.asarray(t_ns, np.int64)
    flags = np.full(len(t_ns), _IN_EARTH if north else _IN_VEHICLE)
    quats = ned_wxyz(yaw, pitch, roll)
    schema = "px4_msgs/GimbalDeviceAttitudeStatus"
    return table(topic, schema, t_ns, timestamp=t_ns // 1000, device_flags=flags, q=quats)


def cameras(
    topic: str, t_ns: Ints, width: Floats | float, height: Floats | float, focal: Floats | float
) -> Table:
    """A pinhole camera in time: sizes and focal length, pixels."""
    t_ns = np.asarray(t_ns, np.int64)
    matrix = np.zeros((len(t_ns), 9))
    matrix[:, 0] = matrix[:, 4] = focal
    sizes = {"width": np.broadcast_to(width, len(t_ns)), "height": np.broadcast_to(height, len(t_ns))}
    return table(topic, "sensor_msgs/CameraInfo", t_ns, k=matrix, **sizes, **_stamp(t_ns))


def ned_wxyz(yaw: Floats, pitch: Floats, roll: Floats) -> Floats:
    """Quaternions (N, 4) ``w x y z``, forward, right, down in north, east, down; NaN where an angle is."""
    angles = np.column_stack([yaw, pitch, roll]).astype(float)
    good = np.isfinite(angles).all(axis=1)
    quats = np.full((len(angles), 4), np.nan)
    if good.any():
        quats[good] = Rotation.from_euler("ZYX", angles[good], degrees=True).as_quat()[:, [3, 0, 1, 2]]
    return quats


def focal_of_35mm(width: Floats | float, height: Floats | float, focal_mm: Floats | float) -> Floats:
    """Focal lengths, pixels, of lengths for a picture of 43.27 mm from corner to corner."""
    return np.asarray(np.hypot(width, height) * np.asarray(focal_mm, float) / 43.2666)


def numbered(count: int) -> Ints:
    """Stamps, ns, for what has an order and no time: one every two seconds."""
    return (1 + np.arange(count, dtype=np.int64)) * 2_000_000_000


def _stamp(t_ns: Ints) -> dict[str, Ints]:
    return {"header.stamp.sec": t_ns // 10**9, "header.stamp.nanosec": t_ns % 10**9}
