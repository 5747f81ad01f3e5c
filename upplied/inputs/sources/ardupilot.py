"""ArduPilot's logs (DataFlash, binary and text) and a ground station's telemetry logs, by `pymavlink`.

An aircraft that flies on its filter's origin and on satellites says both: the place of the structure decides.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.extras import extra
from upplied.inputs.files import read_regular
from upplied.inputs.sources.source import MAX_ROWS, Fields, Source, attitudes, fixes, gimbals, table
from upplied.inputs.tables import Table
from upplied.records import Ints

MAX_BYTES = 2 << 30
_DATE_S = 1e9  # earlier, it is no date but the time since the start
_V1, _V2, _SIGNED = 0xFE, 0xFD, 1
_LOCAL = ("XKF1", "NKF1", "LOCAL_POSITION_NED")
# Message -> what is read of it.
_WANTED = {
    "POS": ("Lat", "Lng", "Alt"),
    "ATT": ("Yaw", "Pitch", "Roll"),
    "MNT": ("YawE", "YawB", "Pitch", "Roll"),
    "XKF1": ("PN", "PE", "PD", "C"),
    "NKF1": ("PN", "PE", "PD", "C"),
    "XKF2": ("VWN", "VWE", "C"),
    "NKF2": ("VWN", "VWE", "C"),
    "GLOBAL_POSITION_INT": ("lat", "lon", "alt"),
    "ATTITUDE": ("yaw", "pitch", "roll"),
    "LOCAL_POSITION_NED": ("x", "y", "z"),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": ("flags", "q"),
    "MOUNT_STATUS": ("pointing_c", "pointing_a", "pointing_b"),
    "SYSTEM_TIME": ("time_unix_usec",),
}
Rows = dict[str, list[tuple[int, Any]]]


def read(path: Path, fields: Fields) -> Source:
    """The tables of a log."""
    with extra("ardupilot"):
        import pymavlink  # noqa: F401 - said in words where it is missing
    with path.open("rb") as stream:
        head = stream.read(9)
    source = Source([])
    if head[:2] == b"\xa3\x95" or head[:3] == b"FMT":
        rows = _dataflash(path, head[:3] == b"FMT", source)
    else:
        rows = _telemetry(path, source)
    source.tables = [made for name, found in sorted(rows.items()) for made in _tables(name, found)]
    return source


def _dataflash(path: Path, text: bool, source: Source) -> Rows:
    from pymavlink import DFReader

    log = (DFReader.DFReader_text if text else DFReader.DFReader_binary)(str(path))
    rows: Rows = defaultdict(list)
    dated = True
    for _ in range(MAX_ROWS):
        message = log.recv_match(type=list(_WANTED))
        if message is None:
            break
        name = message.get_type()
        dated &= message._timestamp > _DATE_S
        rows[name].append(
            (round(message._timestamp * 1e9), [getattr(message, at, np.nan) for at in _WANTED[name]])
        )
    if not dated:
        source.notes.append("times count from the start of the autopilot: the log holds no date")
    return rows


def _telemetry(path: Path, source: Source) -> Rows:
    """Messages of the one vehicle that says where it is, by its own clock and the ground station's date."""
    from pymavlink.dialects.v20 import ardupilotmega

    link = ardupilotmega.MAVLink(None)
    rows: Rows = defaultdict(list)
    ahead: list[int] = []
    vehicles: set[int] = set()
    for t_us, packet in _packets(path, read_regular(path, MAX_BYTES), source):
        try:
            message = link.decode(bytearray(packet))
        except Exception:  # of a dialect that nobody here knows, or damaged
            continue
        name = message.get_type()
        if name not in _WANTED:
            continue
        boot_ms = getattr(message, "time_boot_ms", None)
        if boot_ms is not None:
            ahead.append(t_us * 1000 - boot_ms * 1_000_000)
        if name in ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"):
            vehicles.add(message.get_srcSystem())
        values = [getattr(message, at) for at in _WANTED[name]]
        rows[name].append((t_us * 1000 if boot_ms is None else -boot_ms - 1, values))
    if len(vehicles) > 1:
        raise InputError(
            str(path), f"holds {len(vehicles)} vehicles ({sorted(vehicles)})", "one vehicle", "split the log"
        )
    start = int(np.median(ahead)) if ahead else 0
    source.notes.append("dates by the clock of the ground station")
    return {
        name: [(start - (t + 1) * 1_000_000 if t < 0 else t, v) for t, v in found]
        for name, found in rows.items()
    }


def _packets(path: Path, data: bytes, source: Source) -> Iterator[tuple[int, bytes]]:
    """When each packet came, us, and its bytes."""
    at, lost = 0, 0
    while at + 17 <= len(data):
        magic, length = data[at + 8], data[at + 9]
        size = {_V1: length + 8, _V2: length + 12 + 13 * (data[at + 10] & _SIGNED)}.get(magic)
        if size is None or at + 8 + size > len(data):
            at, lost = at + 1, lost + 1
            continue
        yield struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + 8 + size]
        at += 8 + size
    if lost:
        source.losses.append(f"{lost} bytes between packets cannot be read")
        source.read_pct = 100 * (1 - lost / len(data))


def _tables(name: str, rows: list[tuple[int, Any]]) -> list[Table]:
    t_ns: Ints = np.array([t for t, _ in rows], np.int64)
    topic = f"/{name.lower()}"
    if name == "GIMBAL_DEVICE_ATTITUDE_STATUS":
        flags, quats = zip(*(values for _, values in rows), strict=True)
        schema = "px4_msgs/GimbalDeviceAttitudeStatus"
        return [
            table(topic, schema, t_ns, timestamp=t_ns // 1000, device_flags=flags, q=np.array(quats, float))
        ]
    values = np.array([values for _, values in rows], float)
    if name in ("POS", "GLOBAL_POSITION_INT"):
        lat, lon, alt = (values if name == "POS" else values * (1e-7, 1e-7, 1e-3)).T
        return [fixes(topic, t_ns, lat, lon, alt=alt)]
    if name == "ATT":
        return [attitudes(topic, t_ns, *values.T)]
    if name == "ATTITUDE":
        return [attitudes(topic, t_ns, *np.degrees(values).T)]
    if name == "MNT":
        north = bool(np.isfinite(values[:, 0]).mean() >= 0.5)
        return [gimbals(topic, t_ns, values[:, 0 if north else 1], values[:, 2], values[:, 3], north)]
    if name == "MOUNT_STATUS":
        yaw, pitch, roll = (values / 100).T
        return [gimbals(topic, t_ns, yaw, pitch, roll, north=False)]
    first = values[:, 3] == 0 if name in ("XKF1", "NKF1") else np.ones(len(values), bool)
    if name in _LOCAL:
        t_ns, (x, y, z) = t_ns[first], values[first, :3].T
        schema = "px4_msgs/VehicleLocalPosition"
        return [table(topic, schema, t_ns, timestamp=t_ns // 1000, x=x, y=y, z=z)]
    if name in ("XKF2", "NKF2"):
        return [
            table(topic, "px4_msgs/Wind", t_ns, windspeed_north=values[:, 0], windspeed_east=values[:, 1])
        ]
    return []
