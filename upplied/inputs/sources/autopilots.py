"""Logs of autopilots: PX4's (ULog) by `pyulog`; ArduPilot's (DataFlash) and telemetry by `pymavlink`."""

import mmap
import re
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pyulog import ULog
from pyulog.exceptions import ULogException

from upplied.extras import extra
from upplied.inputs.files import open_regular, read_regular, silent
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.source import MAX_ROWS, Fields, Source, refusal
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

MAX_BYTES = 2 << 30
_DATE_S = 1e9  # earlier, it is no date but the time since the start
_LONGEST, _SPARE = 255, 528  # bytes of a message; behind the last one, where logs are kept in blocks
_V1, _V2, _SIGNED = 0xFE, 0xFD, 1
ERRORS = (ULogException, TypeError)  # what `pyulog` raises of damaged logs
_GPS = ("sensor_gps", "vehicle_gps_position")
_FIXED = 3  # fix_type: a position in three dimensions
_HEAD = 1 << 20  # bytes that hold the definitions of messages
_HUGE = re.compile(rb"[a-z0-9_]\[\d{6,}\] [a-z]")  # of a message of 65 535 bytes at most
_LATER = 1_000_000_000_000_000  # us: a date, not the time since the start
Rows = dict[str, list[tuple[int, Any]]]


def _fixes(topic: str, t_ns: Ints, values: Floats) -> Table:
    return fill.fixes(topic, t_ns, values[:, 0], values[:, 1], alt=values[:, 2])


def _mount(topic: str, t_ns: Ints, values: Floats) -> Table:
    north = bool(np.isfinite(values[:, 0]).mean() >= 0.5)
    return fill.gimbals(topic, t_ns, values[:, 0 if north else 1], values[:, 2], values[:, 3], north)


def _local(topic: str, t_ns: Ints, values: Floats) -> Table:
    core = values[:, 3] == 0 if values.shape[1] > 3 else np.ones(len(values), bool)
    t_ns, (x, y, z) = t_ns[core], values[core, :3].T
    return fill.table(topic, "px4_msgs/VehicleLocalPosition", t_ns, x=x, y=y, z=z)


def _wind(topic: str, t_ns: Ints, v: Floats) -> Table:
    return fill.table(topic, "px4_msgs/Wind", t_ns, windspeed_north=v[:, 0], windspeed_east=v[:, 1])


# Message -> the fields that are read of it, and what makes a table of them.
_MESSAGES: dict[str, tuple[tuple[str, ...], Callable[[str, Ints, Floats], Table]]] = {
    "POS": (("Lat", "Lng", "Alt"), _fixes),
    "ATT": (("Yaw", "Pitch", "Roll"), lambda topic, t, v: fill.attitudes(topic, t, *v.T)),
    "MNT": (("YawE", "YawB", "Pitch", "Roll"), _mount),
    "XKF1": (("PN", "PE", "PD", "C"), _local),
    "NKF1": (("PN", "PE", "PD", "C"), _local),
    "XKF2": (("VWN", "VWE"), _wind),
    "NKF2": (("VWN", "VWE"), _wind),
    "GLOBAL_POSITION_INT": (
        ("lat", "lon", "alt"), lambda topic, t, v: _fixes(topic, t, v * (1e-7, 1e-7, 1e-3)),
    ),
    "ATTITUDE": (("yaw", "pitch", "roll"), lambda topic, t, v: fill.attitudes(topic, t, *np.degrees(v).T)),
    "LOCAL_POSITION_NED": (("x", "y", "z"), _local),
    "GIMBAL_DEVICE_ATTITUDE_STATUS": (
        ("flags", "q"), lambda topic, t, v: fill.gimbal_status(topic, t, v[:, 0].astype(int), v[:, 1:]),
    ),
    "MOUNT_STATUS": (
        ("pointing_c", "pointing_a", "pointing_b"),
        lambda topic, t, v: fill.gimbals(topic, t, v[:, 0] / 100, v[:, 1] / 100, v[:, 2] / 100, north=False),
    ),
}  # fmt: skip


def read(path: Path, fields: Fields) -> Source:
    """The tables of a log."""
    with path.open("rb") as stream:
        head = stream.read(4)
    if head == b"ULog":
        return _ulog(path, fields)
    with extra("ardupilot"):
        import pymavlink  # noqa: F401 - a clear message where it is missing
    source = Source([])
    text = head[:3] == b"FMT"
    rows = _dataflash(path, text, source) if text or head[:2] == b"\xa3\x95" else _telemetry(path, source)
    for name, stamped in sorted(rows.items()):
        t_ns = np.array([t for t, _ in stamped], np.int64)
        values = np.array([np.hstack(each) for _, each in stamped], float)
        source.tables.append(_MESSAGES[name][1](f"/{name.lower()}", t_ns, values))
    return source


def _dataflash(path: Path, text: bool, source: Source) -> Rows:
    from pymavlink import DFReader

    rows: Rows = defaultdict(list)
    dated, log, size = True, None, path.stat().st_size
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        heads = size if text else sum(1 for _ in re.finditer(rb"\xa3\x95", data))
    if 2 * _LONGEST * heads < size:  # passed over byte by byte, it would take for ever
        finding = f"holds {heads} messages in {size} bytes"
        raise refusal(finding, "a whole log", "copy it again from the autopilot")
    for _ in range(MAX_ROWS):
        try:
            if log is None:
                with silent():  # a line for each byte that is passed over
                    log = (DFReader.DFReader_text if text else DFReader.DFReader_binary)(str(path))
            message = log.recv_match(type=list(_MESSAGES))
        except Exception as error:  # the library raises `Exception` itself of damaged logs
            finding = f"cannot be read as ArduPilot log: {str(error)[:200]}"
            raise refusal(finding, "a whole log", "copy it again from the autopilot") from None
        if message is None:
            break
        dated &= message._timestamp > _DATE_S
        values = [getattr(message, name, np.nan) for name in _MESSAGES[message.get_type()][0]]
        rows[message.get_type()].append((round(message._timestamp * 1e9), values))
    if log is not None and not text:
        length = sum(len(at) * log.formats[kind].len for kind, at in enumerate(log.offsets) if len(at))
        _lost(source, size - length - _SPARE, size)
    if not dated:
        source.notes.append("times count from the start of the autopilot: the log holds no date")
    return rows


def _telemetry(path: Path, source: Source) -> Rows:
    """Messages of the one vehicle that sends its place, by its own clock and the ground station's date."""
    from pymavlink.dialects.v20 import ardupilotmega

    link = ardupilotmega.MAVLink(None)
    rows: Rows = defaultdict(list)
    ahead, vehicles = list[int](), set[int]()
    for t_us, packet in _packets(read_regular(path, MAX_BYTES), source):
        try:
            message = link.decode(bytearray(packet))
        except Exception:  # of an unknown dialect, or damaged
            continue
        if (name := message.get_type()) not in _MESSAGES:
            continue
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            ahead.append(t_us * 1000 - boot_ms * 1_000_000)
        if name in ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"):
            vehicles.add(message.get_srcSystem())
        values = [getattr(message, part) for part in _MESSAGES[name][0]]
        rows[name].append((t_us * 1000 if boot_ms is None else -boot_ms - 1, values))
    if len(vehicles) > 1:
        raise refusal(f"holds {len(vehicles)} vehicles ({sorted(vehicles)})", "one vehicle", "split the log")
    start = int(np.median(ahead)) if ahead else 0
    source.notes.append("dates by the clock of the ground station")
    for stamped in rows.values():
        stamped[:] = [(start - (t + 1) * 1_000_000 if t < 0 else t, values) for t, values in stamped]
    return rows


def _packets(data: bytes, source: Source) -> Iterator[tuple[int, bytes]]:
    at, lost = 0, 0
    while at + 17 <= len(data):
        magic, length = data[at + 8], data[at + 9]
        size = {_V1: length + 8, _V2: length + 12 + 13 * (data[at + 10] & _SIGNED)}.get(magic)
        if size is None or at + 8 + size > len(data):
            at, lost = at + 1, lost + 1
            continue
        yield struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + 8 + size]
        at += 8 + size
    _lost(source, lost, len(data))


def _lost(source: Source, lost: int, size: int) -> None:
    if lost > 0:
        source.losses.append(f"{lost} bytes between messages cannot be read")
        source.read_pct = 100 * (1 - lost / size)


def _ulog(path: Path, fields: Fields) -> Source:
    with open_regular(path) as stream:
        if _HUGE.search(stream.read(_HEAD)):
            raise refusal("defines an array larger than any message", "a log that PX4 wrote")
    # The log calls px4_msgs/VehicleLocalPosition vehicle_local_position.
    names = {re.sub(r"(?<!^)(?=[A-Z])", "_", schema.removeprefix("px4_msgs/")).lower(): schema
             for schema in fields if schema.startswith("px4_msgs/")}  # fmt: skip
    with silent():
        log = ULog(str(path), [*names, *_GPS])
    offset_us, notes = _start(log)
    tables = []
    for number, data in enumerate(log.data_list):
        if data.name not in names or not len(data.data["timestamp"]):
            continue
        columns = {}
        for name in (*fields[names[data.name]], "timestamp"):
            if name in data.data:
                columns[name] = np.asarray(data.data[name])
            elif parts := [part for at in range(16) if (part := f"{name}[{at}]") in data.data]:
                columns[name] = np.column_stack([data.data[part] for part in parts])
        if offset_us:
            for stamp in {"timestamp", "timestamp_sample"} & columns.keys():
                columns[stamp] = np.where(columns[stamp] > 0, columns[stamp].astype(np.int64) + offset_us, 0)
        topic = f"/{data.name}" + (f"_{data.multi_id}" if data.multi_id else "")
        t_ns = columns["timestamp"].astype(np.int64) * 1000
        tables.append(fill.table(topic, names[data.name], t_ns, number, **columns))
    lost = [f"{len(log.dropouts)} dropouts of the recorder"] if log.dropouts else []
    damage = ["part of the log cannot be read"] if log.file_corruption else []
    return Source(tables, losses=damage, notes=[*notes, *lost])


def _start(log: Any) -> tuple[int, list[str]]:
    """What to add to times since the start for a date, us, by the satellites."""
    for data in log.data_list:
        if data.name in _GPS and {"time_utc_usec", "fix_type"} <= data.data.keys():
            utc, since = data.data["time_utc_usec"].astype(np.int64), data.data["timestamp"].astype(np.int64)
            if (good := (data.data["fix_type"] >= _FIXED) & (utc > _LATER)).any():
                return int(np.median(utc[good] - since[good])), []
    return 0, ["times count from the start of the autopilot: the log holds no date"]
