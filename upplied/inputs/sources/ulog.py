"""PX4 logs (ULog), by `pyulog`: the topics are those of `px4_msgs`, a message is an array."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from pyulog import ULog
from pyulog.exceptions import ULogException

from upplied.inputs.files import open_regular, silent
from upplied.inputs.sources.source import Fields, Source, refusal, table

ERRORS = (ULogException, TypeError)  # what `pyulog` raises of damaged logs
_GPS = ("sensor_gps", "vehicle_gps_position")
_FIXED = 3  # fix_type: a position in three dimensions
_HEAD = 1 << 20  # bytes that hold the definitions of messages
_HUGE = re.compile(rb"[a-z0-9_]\[\d{6,}\] [a-z]")  # of a message of 65 535 bytes at most
_LATER = 1_000_000_000_000_000  # us: a date, not the time since the start


def read(path: Path, fields: Fields) -> Source:
    """The tables of a log."""
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
        tables.append(table(topic, names[data.name], t_ns, number, **columns))
    lost = [f"{len(log.dropouts)} dropouts of the recorder"] if log.dropouts else []
    damage = ["part of the log cannot be read"] if log.file_corruption else []
    return Source(tables, losses=damage, notes=[*notes, *lost])


def _start(log: Any) -> tuple[int, list[str]]:
    """What to add to times since the start for a date, us, by the satellites."""
    for data in log.data_list:
        if data.name in _GPS and {"time_utc_usec", "fix_type"} <= data.data.keys():
            utc, since = data.data["time_utc_usec"].astype(np.int64), data.data["timestamp"].astype(np.int64)
            good = (data.data["fix_type"] >= _FIXED) & (utc > _LATER)
            if good.any():
                return int(np.median(utc[good] - since[good])), []
    return 0, ["times count from the start of the autopilot: the log holds no date"]
