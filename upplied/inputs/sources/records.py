"""Flight records as tables (.csv) of DJI and Airdata: columns by name, with the unit that they say."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from upplied.errors import InputError
from upplied.inputs.files import read_regular
from upplied.inputs.sources.source import (
    MAX_ROWS,
    Fields,
    Source,
    attitudes,
    cameras,
    fixes,
    focal_of_35mm,
    gimbals,
)
from upplied.inputs.tables import Table
from upplied.records import Floats, Ints

MAX_BYTES = 1 << 30
_DATE = re.compile(r"(\d{4})[-./](\d{1,2})[-./](\d{1,2}) (\d\d):(\d\d):(\d\d)(?:[.,](\d{3}))?(?:,(\d{3}))?")
_FOOT, _MS = 0.3048, 1e-3
_COLUMNS = {  # what a column says -> its names, in lower case without the unit; the first that is there
    "ms": ("time(millisecond)", "time(ms)"),
    "s": ("time(seconds)", "time(s)", "osd.flytime [s]", "osd.flytime"),
    "date": ("datetime(utc)", "custom.updatetime", "custom.date [utc]", "datetime", "datetime(local)"),
    "lat": ("latitude", "osd.latitude", "lat"),
    "lon": ("longitude", "osd.longitude", "lon", "lng"),
    "takeoff": ("height_above_takeoff", "osd.height", "relativealtitude", "altitude"),
    "alt": ("altitude_above_sealevel", "altitude_above_asl", "osd.altitude", "absolutealtitude"),
    "yaw": ("gimbal_heading", "gimbal.yaw", "gimbalheading"),
    "pitch": ("gimbal_pitch", "gimbal.pitch", "gimbalpitch"),
    "roll": ("gimbal_roll", "gimbal.roll", "gimbalroll"),
    "heading": ("compass_heading", "osd.yaw", "yaw", "heading"),
    "nose": ("pitch", "osd.pitch"), "bank": ("roll", "osd.roll"),
}  # fmt: skip
_UNIT = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")


def read(path: Path, fields: Fields) -> Source:
    """The tables of a record."""
    text = read_regular(path, MAX_BYTES).decode("utf-8-sig", "replace").replace("\r\n", "\n")
    return _table(path, text)


def is_record(head: str) -> bool:
    """Whether the first line of a text names columns of latitude and longitude."""
    found = _named(next(csv.reader([head.splitlines()[0]]), [])) if head.strip() else {}
    return {"lat", "lon"} <= found.keys()


def _table(path: Path, text: str) -> Source:
    reader = csv.reader(io.StringIO(text))
    head = next(reader, [])
    at = _named(head)
    if not {"lat", "lon"} <= at.keys():
        raise InputError(
            str(path), "names no columns of latitude and longitude", "a flight record with a head"
        )
    rows = [
        row
        for row, _ in zip(reader, range(MAX_ROWS), strict=False)
        if len(row) > max(at["lat"][0], at["lon"][0])
    ]
    columns: dict[str, Floats] = {}
    notes: list[str] = []
    for name, (column, factor) in at.items():
        if name != "date":
            columns[name] = factor * np.array(
                [_float(row[column]) if column < len(row) else np.nan for row in rows]
            )
    dates = np.array(
        [dated(row[at["date"][0]]) if "date" in at and at["date"][0] < len(row) else np.nan for row in rows]
    )
    since = columns["s"] * 1e3 if "s" in columns else columns.get("ms", np.full(len(rows), np.nan))
    return source_of("/record", times_of(since, dates, notes), columns, notes, path)


def _named(head: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Where each thing stands in a head, and what turns its unit into ours."""
    plain = [name.strip().lower().lstrip("\ufeff") for name in head]
    bare = [_UNIT.sub("", name).strip() for name in plain]
    found: dict[str, tuple[int, float]] = {}
    for name, choices in _COLUMNS.items():
        for choice in choices:
            for names in (plain, bare):
                if choice in names and name not in found:
                    column = names.index(choice)
                    unit = (_UNIT.search(plain[column]) or ["", ""])[1]
                    found[name] = column, _FOOT if unit in ("feet", "ft") else 1.0
    return found


def source_of(topic: str, t_ns: Ints, columns: dict[str, Floats], notes: list[str], path: Path) -> Source:
    heights = {"alt_takeoff": columns["takeoff"]} if "takeoff" in columns else {}
    if not heights and "alt" in columns:
        heights = {"alt": columns["alt"]}
        notes.append("altitudes are taken to be above mean sea level")
    if not heights:
        raise InputError(
            str(path), "says places without heights", "a record with heights", "use another log of the flight"
        )
    # Captions repeat a place until the next one is known: what changes counts.
    values = np.column_stack(
        [
            columns["lat"],
            columns["lon"],
            *heights.values(),
            *(columns[n] for n in ("yaw", "pitch") if n in columns),
        ]
    )
    new = np.append(True, (np.diff(values, axis=0) != 0).any(axis=1)) | (
        np.arange(len(values)) == len(values) - 1
    )
    new &= np.isfinite(values).all(axis=1) & (np.diff(t_ns, prepend=-1) > 0)
    if not (np.abs(values[new][:, :2]) > 0).any():
        raise InputError(
            str(path), "says no place: 0, 0 throughout", "a satellite fix", "use another log of the flight"
        )

    def keep(column: Any) -> Any:
        return np.asarray(column)[new]

    tables: list[Table] = [
        fixes(
            topic,
            keep(t_ns),
            keep(columns["lat"]),
            keep(columns["lon"]),
            **{n: keep(v) for n, v in heights.items()},
        )
    ]
    level = np.zeros(len(t_ns))
    if "pitch" in columns and ("yaw" in columns or "heading" in columns):
        yaw = columns.get("yaw", columns.get("heading", level))
        tables.append(
            gimbals(topic, keep(t_ns), keep(yaw), keep(columns["pitch"]), keep(columns.get("roll", level)))
        )
        if "yaw" not in columns:
            notes.append("the gimbal looks where the aircraft heads: the record says no yaw of its own")
    elif "heading" in columns:
        tables.append(
            attitudes(topic, keep(t_ns), *(keep(columns.get(n, level)) for n in ("heading", "nose", "bank")))
        )
    if "focal" in columns and np.isfinite(columns["focal"]).any():
        focal = np.where(
            columns["focal"] >= 100, columns["focal"] / 10, columns["focal"]
        )  # tenths in older ones
        tables.append(cameras(topic, keep(t_ns), 3840.0, 2160.0, focal_of_35mm(3840.0, 2160.0, keep(focal))))
    return Source(tables, notes=notes)


def times_of(since_ms: Floats, dates: Floats, notes: list[str]) -> Ints:
    """Times, ns: dates where they run on, else from the start."""
    if (
        np.isfinite(dates).all()
        and len(dates)
        and np.ptp(dates) >= 0.5 * (np.nanmax(since_ms, initial=0) - np.nanmin(since_ms, initial=0))
    ):
        if (
            np.isfinite(since_ms).all() and not (np.mod(dates, 1000) > 0).any()
        ):  # whole seconds: the clock tells between
            return np.round((since_ms + np.max(dates - since_ms)) * 1e6).astype(np.int64)
        notes.append("dates are taken to be UTC")
        return np.round(dates * 1e6).astype(np.int64)
    if np.isfinite(since_ms).any():
        notes.append("times count from the start of the record")
        return np.round((np.nan_to_num(since_ms) + 1000) * 1e6).astype(np.int64)
    notes.append("no times: one row a second")
    return (1 + np.arange(len(dates), dtype=np.int64)) * 10**9


def dated(text: str) -> float:
    """Milliseconds since 1970 of the first date in a text; NaN where there is none."""
    hit = _DATE.search(text)
    if hit is None:
        return float("nan")
    year, month, day, hour, minute, second = map(int, hit.groups()[:6])
    try:
        start = datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp() * 1e3
    except (ValueError, OverflowError):
        return float("nan")
    return start + int(hit[7] or 0) + int(hit[8] or 0) * _MS


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
