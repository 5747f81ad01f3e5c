"""The tables that readers fill, of schemas that `upplied.inputs.schemas` reads, whatever the file."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.inputs.tables import Channel, Table
from upplied.records import Floats, Ints, Lens, Placement

Numbers = Floats | float
Fields = Mapping[str, Sequence[str]]  # schema -> the paths that are read of it
MAX_ROWS = 5_000_000
SHAPE = (TypeError, AttributeError)  # what a value of another type in JSON or XML makes of a reader
MAX_BYTES = 1 << 30
_DATE = re.compile(r"(\d{4})[-./](\d{1,2})[-./](\d{1,2}) (\d\d):(\d\d):(\d\d)(?:[.,](\d{3}))?(?:,(\d{3}))?")
_IN_EARTH, _IN_VEHICLE = 64, 32  # flags of GIMBAL_DEVICE_ATTITUDE_STATUS


@dataclass
class Source:
    """Tables of one flight, and what its kind of file declares."""

    tables: list[Table]
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    listed: str = ""  # topics and schemas in words; those of the tables where empty
    read_pct: float = 100.0
    notes: list[str] = field(default_factory=list)
    defaults: dict[str, Any] = field(default_factory=dict)  # facts that hold where nothing else is declared
    stills: bool = False  # photos: no pose between them is missing
    place: Placement | None = None  # of the project's frame, where that is east, north and up of a place
    planned: bool = False  # a mission that was written, not a flight that was flown
    timed: bool = True  # False: it holds no times, and its poses are numbered


def refusal(finding: str, rule: str = "", remedy: str = "") -> InputError:
    """An error about the file that is read; `upplied.inputs.sources.door` adds its name."""
    return InputError("", finding, rule, remedy)


def table(topic: str, schema: str, t_ns: Ints, channel_id: int = 0, /, **columns: Any) -> Table:
    """A table of one topic, stamped as its schema is; ``__`` in the name of a column stands for a dot."""
    t_ns = np.asarray(t_ns, np.int64)
    stamp = {"header.stamp.sec": t_ns // 10**9, "header.stamp.nanosec": t_ns % 10**9}
    stamp = {"timestamp": t_ns // 1000} if schema.startswith("px4_msgs/") else stamp
    named = {name.replace("__", "."): np.asarray(column) for name, column in columns.items()}
    return Table(Channel(channel_id, topic, "", schema), stamp | named, t_ns, t_ns, len(t_ns))


def poses(topic: str, t_ns: Ints, positions: Floats, quat_xyzw: Floats, frame: str = "") -> Table:
    """Poses (N, 3), m, and (N, 4) in a frame with z up."""
    columns = {f"pose.position.{axis}": positions[:, at] for at, axis in enumerate("xyz")}
    columns |= {f"pose.orientation.{axis}": quat_xyzw[:, at] for at, axis in enumerate("xyzw")}
    frames = np.full(len(positions), frame, object)
    return table(topic, "geometry_msgs/PoseStamped", t_ns, **columns, header__frame_id=frames)


def fixes(topic: str, t_ns: Ints, lat: Floats, lon: Floats, **altitude: Floats) -> Table:
    """Places, deg; `altitude` is ``alt`` (mean sea level), ``alt_ellipsoid`` or ``alt_takeoff``, m."""
    place = np.column_stack([lat, lon]).astype(float)
    place[(place == 0).all(axis=1)] = np.nan  # before the first fix
    return table(topic, "px4_msgs/VehicleGlobalPosition", t_ns, lat=place[:, 0], lon=place[:, 1], **altitude)


def attitudes(topic: str, t_ns: Ints, yaw: Floats, pitch: Floats, roll: Floats) -> Table:
    """Attitudes of a vehicle, deg: yaw clockwise from north, pitch up, roll to the right."""
    return table(topic, "px4_msgs/VehicleAttitude", t_ns, q=ned_wxyz(yaw, pitch, roll))


def gimbals(topic: str, t_ns: Ints, yaw: Floats, pitch: Floats, roll: Floats, north: bool = True) -> Table:
    """Attitudes of a camera, deg; yaw from north, or from the vehicle's heading."""
    flags = np.full(len(t_ns), _IN_EARTH if north else _IN_VEHICLE)
    return gimbal_status(topic, t_ns, flags, ned_wxyz(yaw, pitch, roll))


def gimbal_status(topic: str, t_ns: Ints, flags: Ints, quat_wxyz: Floats) -> Table:
    """Attitudes (N, 4) of a gimbal as GIMBAL_DEVICE_ATTITUDE_STATUS gives them, with its flags (N,)."""
    return table(topic, "px4_msgs/GimbalDeviceAttitudeStatus", t_ns, device_flags=flags, q=quat_wxyz)


def cameras(
    topic: str, t_ns: Ints, width: Numbers, height: Numbers, focal: Numbers, lenses: Sequence[Lens] = ()
) -> Table:
    """A camera in time: sizes and focal length, pixels, and of each photo the lens, where that is known."""
    matrix = np.zeros((len(t_ns), 9))
    matrix[:, 0] = matrix[:, 4] = focal
    sizes = {"width": np.broadcast_to(width, len(t_ns)), "height": np.broadcast_to(height, len(t_ns))}
    more: dict[str, Any] = {}
    if len({lens.model for lens in lenses}) == 1:
        matrix[:, [2, 5]] = np.array([lens.middle for lens in lenses]) * np.column_stack(list(sizes.values()))
        more["d"] = np.array([(*lens.coefficients, *(0.0,) * 8)[:8] for lens in lenses])
        more["distortion_model"] = np.full(len(t_ns), lenses[0].model, object)
    return table(topic, "sensor_msgs/CameraInfo", t_ns, k=matrix, **sizes, **more)


def ned_wxyz(yaw: Floats, pitch: Floats, roll: Floats) -> Floats:
    """Quaternions (N, 4) ``w x y z``, forward, right, down in north, east, down; NaN where an angle is."""
    angles = np.column_stack([yaw, pitch, roll]).astype(float)
    quats = np.full((len(angles), 4), np.nan)
    if (good := np.isfinite(angles).all(axis=1)).any():
        quats[good] = Rotation.from_euler("ZYX", angles[good], degrees=True).as_quat()[:, [3, 0, 1, 2]]
    return quats


def focal_of_35mm(width: Numbers, height: Numbers, focal_mm: Numbers) -> Floats:
    """Focal lengths, pixels, of lengths for a picture of 43.27 mm from corner to corner."""
    return np.asarray(np.hypot(width, height) * np.asarray(focal_mm, float) / 43.2666)


def numbered(count: int) -> Ints:
    """Stamps, ns, for what has an order and no time: one every two seconds."""
    return (1 + np.arange(count, dtype=np.int64)) * 2_000_000_000


def spread(t_ns: Ints) -> Ints:
    """Stamps, ns, those that are the same spread over their second."""
    alike = pd.Series(t_ns).groupby(t_ns)
    return np.asarray(t_ns + alike.cumcount() * 10**9 // alike.transform("size"), np.int64)


def dated(text: str) -> float:
    """Milliseconds since 1970 of the first date in a text; NaN where there is none."""
    if (hit := _DATE.search(text)) is None:
        return float("nan")
    year, month, day, hour, minute, second = map(int, hit.groups()[:6])
    try:
        start = datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp() * 1e3
    except (ValueError, OverflowError):
        return float("nan")
    return start + int(hit[7] or 0) + int(hit[8] or 0) * 1e-3
