"""Records (.csv) of DJI and Airdata, captions of DJI's videos (.srt), poses of TUM, EuRoC and KITTI."""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from upplied.inputs.files import read_regular, table
from upplied.inputs.sources import source as fill
from upplied.inputs.sources.source import MAX_BYTES, MAX_ROWS, Fields, Source, refusal
from upplied.records import Floats, Ints

_FOOT = 0.3048
_COLUMNS: dict[str, list[str]] = table("kinds.toml")["record"]["columns"]
_UNIT = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")
CAPTION = re.compile(r"^\d+\s*\n\d\d:\d\d:\d\d[,.]\d{3} --> |\[latitude ?: ", re.MULTILINE)
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"
_CLOCK = re.compile(r"(\d\d):(\d\d):(\d\d)[,.](\d{3}) -->")
_GPS = re.compile(rf"(?<![A-Z])GPS ?\({_NUMBER}, ?{_NUMBER}(?:, ?{_NUMBER}(M?))?\)")
_PRY = re.compile(rf"G\.PRY \({_NUMBER}\D*, {_NUMBER}\D*, {_NUMBER}")
_WORDS: dict[str, str] = table("kinds.toml")["record"]["captions"]
_CAPTIONS = {name: re.compile(f"(?:{words}){_NUMBER}") for name, words in _WORDS.items()}
_VIDEO = 3840.0, 2160.0  # pixels, to which the focal length of captions belongs
_SPLIT = re.compile(rb"[,;\s]+")
WIDTHS = (8, 17, 12)  # numbers in a line of TUM, EuRoC and KITTI
_NANOSECONDS = 1e15  # a stamp beyond is no second
# KITTI's world is the first camera's: x right, y down, z forward. Here x forward, y left, z up.
_UPRIGHT = Rotation.from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def read(path: Path, fields: Fields) -> Source:
    """The flight of a record, of captions or of poses; without an attitude it is positions alone."""
    data = read_regular(path, MAX_BYTES)
    text = data.decode("utf-8-sig", "replace").replace("\r\n", "\n")
    if is_record(text[:8192]):
        return _record(text)
    return _captions(text) if CAPTION.search(text[:4096]) else _poses(path, data)


def is_record(head: str) -> bool:
    """Whether the first line of a text names columns of latitude and longitude."""
    columns = _named(next(csv.reader([head.splitlines()[0]]), [])) if head.strip() else {}
    return {"lat", "lon"} <= columns.keys()


def _record(text: str) -> Source:
    reader = csv.reader(io.StringIO(text))
    at = _named(next(reader, []))
    least = max(at["lat"][0], at["lon"][0])
    rows = [row for row, _ in zip(reader, range(MAX_ROWS), strict=False) if len(row) > least]
    cells = {name: [it[place] if place < len(it) else "" for it in rows] for name, (place, _) in at.items()}
    dates = np.array([fill.dated(cell) for cell in cells.pop("date", [""] * len(rows))])
    columns = {
        name: at[name][1] * np.asarray(pd.to_numeric(pd.Series(cell, dtype=object), errors="coerce"), float)
        for name, cell in cells.items()
    }
    since = columns["s"] * 1e3 if "s" in columns else columns.get("ms", np.full(len(rows), np.nan))
    notes: list[str] = []
    return _source("/record", _times(since, dates, notes), columns, notes)


def _named(head: Sequence[str]) -> dict[str, tuple[int, float]]:
    """The column of each content of a head, and the factor to our unit."""
    plain = [name.strip().lower().lstrip("\ufeff") for name in head]
    bare = [_UNIT.sub("", name).strip() for name in plain]
    columns: dict[str, tuple[int, float]] = {}
    for name, choices in _COLUMNS.items():
        if hits := [names.index(choice) for choice in choices for names in (plain, bare) if choice in names]:
            unit = _UNIT.search(plain[hits[0]])
            columns[name] = hits[0], _FOOT if unit is not None and unit[1] in ("feet", "ft") else 1.0
    return columns


def _captions(text: str) -> Source:
    blocks = re.split(r"\n\s*\n(?=\d+\s*\n)", text.strip())[:MAX_ROWS]
    rows, since = [], []
    for block in blocks:
        row = {name: float(hit[1]) for name, each in _CAPTIONS.items() if (hit := each.search(block))}
        if hit := _GPS.search(block):
            latitude_first = float(hit[4] == "M" or "BAROMETER(" in block)
            row |= {"first": float(hit[1]), "second": float(hit[2]), "latitude_first": latitude_first}
        if hit := _PRY.search(block):
            row |= dict(zip(("pitch", "roll", "yaw"), map(float, hit.groups()), strict=True))
        rows.append(row)
        clock = _CLOCK.search(block)
        parts = (3_600_000.0, 60_000.0, 1000.0, 1.0)
        since.append(np.dot(parts, [*map(int, clock.groups())]) if clock else np.nan)
    if not (names := {name for row in rows for name in row}) & {"lat", "first"}:
        finding = f"has {len(blocks) if text.strip() else 0} captions, none with a place"
        raise refusal(finding, "captions with latitude and longitude", "let the camera record GPS")
    if {"lat", "first"} <= names:
        raise refusal("holds captions of two kinds", "one flight", "split it where another camera begins")
    columns = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
    notes = []
    if "lat" not in columns:  # of GPS(a, b, c): most models write the longitude first, some do not
        first, second = columns["first"], columns["second"]
        far = np.nanmax(np.abs(first)) > 90
        ordered = np.nanmax(np.abs(second)) > 90 or (not far and columns["latitude_first"].any())
        columns["lat"], columns["lon"] = (first, second) if ordered else (second, first)
        order = "latitude, longitude" if ordered else "longitude, latitude"
        notes.append(f"captions give GPS({order})")
    if "takeoff" not in columns and "baro" in columns:
        columns["takeoff"] = columns["baro"]
    dates = np.array([fill.dated(block) for block in blocks])
    return _source("/captions", _times(np.array(since), dates, notes), columns, notes)


def _source(topic: str, t_ns: Ints, columns: dict[str, Floats], notes: list[str]) -> Source:
    """The flight of columns; rows that repeat a place until the next one is known are left out."""
    datum = "alt_takeoff" if "takeoff" in columns else "alt"
    if (height := columns.get("takeoff", columns.get("alt"))) is None:
        raise refusal("gives places without heights", "a record with heights", "use another log")
    if datum == "alt":
        notes.append("altitudes are taken to be above mean sea level")
    changing = [columns[name] for name in ("yaw", "pitch") if name in columns]
    values = np.column_stack([columns["lat"], columns["lon"], height, *changing])
    new = np.append(True, (np.diff(values, axis=0) != 0).any(axis=1))
    new[-1:] = True
    new &= np.isfinite(values).all(axis=1) & (np.diff(t_ns, prepend=-1) > 0)
    if not (np.abs(values[new][:, :2]) > 0).any():
        raise refusal("gives no place: 0, 0 throughout", "a satellite fix", "use another log of the flight")
    t_ns, height, level = t_ns[new], height[new], np.zeros(new.sum())
    columns = {name: column[new] for name, column in columns.items()}
    tables = [fill.fixes(topic, t_ns, columns["lat"], columns["lon"], **{datum: height})]
    yaw = columns.get("yaw", heading := columns.get("heading"))
    if "pitch" in columns and yaw is not None:
        tables.append(fill.gimbals(topic, t_ns, yaw, columns["pitch"], columns.get("roll", level)))
        if "yaw" not in columns:
            notes.append("the gimbal looks where the aircraft heads: the record has no yaw of its own")
    elif heading is not None:
        nose, bank = columns.get("nose", level), columns.get("bank", level)
        tables.append(fill.attitudes(topic, t_ns, heading, nose, bank))
    if np.isfinite(focal := columns.get("focal", np.full(1, np.nan))).any():
        focal = np.where(focal >= 100, focal / 10, focal)  # tenths of a millimetre in older captions
        tables.append(fill.cameras(topic, t_ns, *_VIDEO, fill.focal_of_35mm(*_VIDEO, focal)))
    return Source(tables, notes=notes)


def _times(since_ms: Floats, dates: Floats, notes: list[str]) -> Ints:
    """Times, ns: dates where they run on, else from the start."""
    lasted = np.nanmax(since_ms, initial=0) - np.nanmin(since_ms, initial=0)
    if len(dates) and np.isfinite(dates).all() and np.ptp(dates) >= 0.5 * lasted:
        if np.isfinite(since_ms).all() and not (np.mod(dates, 1000) > 0).any():  # the clock refines seconds
            return np.round((since_ms + np.max(dates - since_ms)) * 1e6).astype(np.int64)
        notes.append("dates are taken to be UTC")
        return np.round(dates * 1e6).astype(np.int64)
    if np.isfinite(since_ms).any():
        notes.append("times count from the start of the record")
        return np.round((np.nan_to_num(since_ms) + 1000) * 1e6).astype(np.int64)
    notes.append("no times: one row a second")
    return (1 + np.arange(len(dates), dtype=np.int64)) * 10**9


def width_of(line: bytes) -> int:
    """How many numbers a line holds; 0 where it holds something else."""
    try:
        return len([float(part) for part in _SPLIT.split(line.strip()) if part])
    except ValueError:
        return 0


def _poses(path: Path, data: bytes) -> Source:
    words = _words(data)
    rows, stamps = np.array([[float(word) for word in line] for line in words]), [line[0] for line in words]
    if rows.shape[1] == WIDTHS[2]:
        return _kitti(path, rows.reshape(-1, 3, 4))
    if rows[0, 0] > _NANOSECONDS:
        times = np.array([int(float(stamp)) if b"." in stamp else int(stamp) for stamp in stamps])
        table = fill.poses("/pose", times, rows[:, 1:4], rows[:, [5, 6, 7, 4]], "world")
        return Source([table], notes=["EuRoC: poses of the inertial unit, quaternions w x y z"])
    return Source([fill.poses("/pose", _nanoseconds(stamps), rows[:, 1:4], rows[:, 4:8], "world")])


def times_beside(path: Path) -> list[Path]:
    """The files that may hold the times of KITTI's poses, the first that exists counts."""
    return [path.with_name(f"{path.stem}_times.txt"), path.with_name("times.txt")]


def _kitti(path: Path, matrices: np.ndarray) -> Source:
    notes = ["KITTI: the first camera's axes, turned until z points up"]
    beside = [name for name in times_beside(path) if name.is_file()]
    listed = _words(read_regular(beside[0], MAX_BYTES)) if beside else []
    times = 1_000_000_000 + _nanoseconds([line[0] for line in listed])
    if not (timed := len(times) == len(matrices)):
        times = fill.numbered(len(matrices))
        notes.append("no times beside it: one pose every 2 s")
    if (np.abs(np.linalg.det(matrices[:, :, :3]) - 1) > 1e-2).any():
        raise refusal("holds matrices that are no rotations", "three rows of [R t] a line")
    quats = (_UPRIGHT * Rotation.from_matrix(matrices[:, :, :3])).as_quat()
    table = fill.poses("/poses", times, _UPRIGHT.apply(matrices[:, :, 3]), quats, "kitti")
    return Source([table], notes=notes, defaults={"body_frame": "optical"}, timed=timed)


def _words(data: bytes) -> list[list[bytes]]:
    lines = [line for line in data.splitlines() if width_of(line)]
    words = [[word for word in _SPLIT.split(line.strip()) if word] for line in lines]
    if len(words) > 1 and len(words[-1]) < len(words[0]):
        words.pop()
    odd = sum(len(each) != len(words[0]) for each in words)
    if not words or odd:
        raise refusal(f"{odd} of {len(words)} lines hold another count of numbers", "one pose a line")
    return words


def _nanoseconds(seconds: list[bytes]) -> Ints:
    """Seconds as nanoseconds, digit by digit where they are written so."""
    stamps = []
    for text in seconds:
        whole, _, rest = text.partition(b".")
        exact = whole.isdigit() and (not rest or rest.isdigit())
        stamps.append(int(whole) * 10**9 + int((rest + b"0" * 9)[:9]) if exact else round(float(text) * 1e9))
    return np.array(stamps, np.int64)
