"""The one door: what each file is, told by its content, and which flights a folder holds.

Nothing is dropped in silence: every file is a flight, part of one, none, or refused with the reason.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from upplied.errors import InputError
from upplied.inputs.sources import photos
from upplied.inputs.sources.source import Fields, Source

MAX_FILES = 200_000
_HEAD = 1 << 16  # bytes that tell what a file is
_FLIGHT, _PART, _OTHER, _REFUSED = "flight", "part", "other", "refused"


@dataclass(frozen=True)
class Kind:
    """A kind of file that holds a flight."""

    words: str
    reader: str  # module of `upplied.inputs.sources`


@dataclass(frozen=True)
class Found:
    """What one file, or folder of photos, is."""

    path: Path
    status: str  # "flight", "part" of one, "other", or "refused": looks like one and cannot be read
    words: str  # what it is, or why it is not taken

    @property
    def is_flight(self) -> bool:
        """Whether a demonstration can be read of it."""
        return self.status == _FLIGHT


KINDS = {
    "mcap": Kind("MCAP log", "mcap"),
    "ulog": Kind("PX4 log", "ulog"),
    "ros1": Kind("ROS 1 bag", "bags"),
    "ros2": Kind("ROS 2 bag", "bags"),
    "dataflash": Kind("ArduPilot log", "ardupilot"),
    "tlog": Kind("MAVLink telemetry log", "ardupilot"),
    "photos": Kind("drone photos", "photos"),
    "captions": Kind("captions of a video", "captions"),
    "record": Kind("flight record", "records"),
    "poses": Kind("poses as text", "trajectories"),
    "project": Kind("photogrammetry project", "projects"),
    "placed": Kind("photogrammetry project", "placed_projects"),
    "colmap": Kind("COLMAP model", "colmap"),
    "mission": Kind("planned mission", "missions"),
}
_MAGIC = {
    b"\x89MCAP0\r\n": "mcap", b"ULog\x01\x12\x35": "ulog", b"#ROSBAG V2.0": "ros1",
    b"\xa3\x95\x80": "dataflash", b"FMT, 128": "dataflash", b"FMT,128": "dataflash",
    b"QGC WPL": "mission", b"# Bundle file": "project", b"NVM_V3": "project",
    **dict.fromkeys(photos.MAGIC, "photos"),
}  # fmt: skip
_REASONS = {  # what looks like a flight and cannot be read -> why, and what to do
    b"\x28\xb5\x2f\xfd": "it is compressed as a whole: unpack it first (zstd -d)",
    b"\x1f\x8b": "it is compressed as a whole: unpack it first (gunzip)",
    b"version https://git-lfs": "it is a pointer of git LFS: fetch the file itself (git lfs pull)",
    b"#ROSBAG V1": "bags of version 1 are not read: rosbag fix writes version 2",
}
_LOGS = {
    ".mcap",
    ".ulg",
    ".bag",
    ".db3",
    ".tlog",
    ".srt",
    ".plan",
    ".waypoints",
}  # by name a flight, whatever it holds
_TEXTS: tuple[tuple[str, str], ...] = (  # what stands in a text -> the kind that it is of
    (r'"fileType"\s*:\s*"Plan"', "mission"),
    (r'"shots"\s*:\s*\{', "project"),
    (r'"transform_matrix"', "project"),
    (r"<document\b[\s\S]*<chunks?\b", "placed"),
    (r"<kml\b", "mission"),
    (r"^#?name,x,y,alt,heading,pitch,roll", "placed"),
    (r"^latitude,longitude,altitude\(m\),heading\(deg\),curvesize", "mission"),
    (r"^# Image list with two lines of data per image", "colmap"),
)
_UNREADABLE: tuple[tuple[str, str], ...] = (
    (
        r'"class_name"\s*:\s*"PinholeCameraTrajectory"',
        "Open3D's camera trajectories are not read: export TUM",
    ),
    (
        r"^['\"]?filename['\"]?[,\s]['\"]?(latitude|x)\b",
        "orientations of single photos (OPK, RPY) are not read: take the project's cameras",
    ),
    (r"^\d+\t[\d.]+\t\[\d+\]", "times of photos for RTK: the photos themselves say where they were taken"),
    (r'"world_crs"', "orientations of single photos are not read: take the project's cameras"),
)


def kind_of(path: Path) -> str:
    """The key in `KINDS` of a file or a folder of photos; empty where it is none.

    Raises
    ------
    InputError
        If it looks like a flight and cannot be read.
    """
    if path.is_dir():
        return "photos" if photos.members(path) else ""
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "a readable file") from None
    for magic, reason in _REASONS.items():
        if head.startswith(magic) and (magic[0] != 0x1F or ".tar" not in path.name):
            raise InputError(str(path), reason)
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind
    kind = _by_content(path, head)
    if not kind and (path.suffix.lower() in _LOGS or not head):
        found = "is empty" if not head.strip() else f"does not begin as a {path.suffix} file does"
        if path.suffix.lower() in _LOGS:
            raise InputError(str(path), found, "a whole file", "copy it again from the recorder")
    return kind


def _by_content(path: Path, head: bytes) -> str:
    if head.startswith(b"SQLite format 3\0"):
        return "ros2" if b"topics" in head and b"messages" in head else ""
    if head.startswith(b"PK\x03\x04"):
        return "mission" if b".wpml" in head or b".kml" in head or path.suffix.lower() == ".kmz" else ""
    if len(head) > 16 and head[8] in (0xFE, 0xFD) and 10**15 < int.from_bytes(head[:8], "big") < 10**16:
        return "tlog"
    if path.name == "images.bin" and path.with_name("cameras.bin").is_file():
        return "colmap"
    if b"\0" in head[:4096]:
        return ""
    text = _whole(path, head)
    for pattern, reason in _UNREADABLE:
        if re.search(pattern, text):
            raise InputError(str(path), reason)
    return next((kind for pattern, kind in _TEXTS if re.search(pattern, text, re.MULTILINE)), "") or _lines(
        text
    )


def _whole(path: Path, head: bytes) -> str:
    """The text; of JSON all of it, since what tells it may stand behind a long list."""
    text = head.decode("utf-8-sig", "replace").replace("\r\n", "\n")
    if text.lstrip()[:1] in ("{", "[") and len(head) == _HEAD and path.stat().st_size < 1 << 28:
        text = path.read_bytes().decode("utf-8", "replace")
    return text


def _lines(text: str) -> str:
    """The kind of a text of captions, columns or numbers."""
    from upplied.inputs.sources import captions, records, trajectories

    if captions.BLOCK.search(text[:4096]) or re.search(r"\[latitude ?: ", text[:4096]):
        return "captions"
    if records.is_record(text[:8192]):
        return "record"
    data = [line for line in text.splitlines()[:200] if line.strip() and not line.startswith("#")]
    widths = [trajectories.width_of(line.encode()) for line in data[:20]]
    many = len(widths) >= 2 and len(set(widths[:-1])) == 1
    return "poses" if many and widths[0] in (trajectories.TUM, trajectories.KITTI, trajectories.EUROC) else ""


def read(path: Path, fields: Fields) -> Source:
    """The tables of a file, or of a folder of photos, whatever it is.

    Raises
    ------
    InputError
        If nobody reads it, or it is damaged beyond use.
    """
    kind = kind_of(path)
    if not kind:
        rule = f"one of: {', '.join(each.words for each in KINDS.values())}"
        raise InputError(str(path), "is no flight that can be read", rule, "check that it is the right file")
    reader: Callable[[Path, Fields], Source] = import_module(
        f"upplied.inputs.sources.{KINDS[kind].reader}"
    ).read
    try:
        return reader(path, fields)
    except (InputError, OSError):
        raise
    except Exception as error:  # whatever the bytes of a file do to a library
        words = f"cannot be read as {KINDS[kind].words}: {type(error).__name__}: {str(error)[:200]}"
        raise InputError(
            str(path), words, "a whole file, as its program writes it", "copy or export it again"
        ) from None


def parts_of(path: Path, kind: str) -> list[Path]:
    """All files that tell of the flight at a path, that one first."""
    if kind == "photos" and path.is_dir():
        return photos.members(path)
    names: Iterable[Path] = ()
    if kind == "ros2":
        from upplied.inputs.sources.bags import siblings

        names = [*siblings(path), path.with_name("metadata.yaml")]
    elif kind == "colmap":
        names = [path.with_name(f"{name}{path.suffix}") for name in ("cameras", "points3D", "frames", "rigs")]
    elif kind == "poses":
        names = [path.with_name(f"{path.stem}_times.txt"), path.with_name("times.txt")]
    return [path, *(name for name in names if name != path and name.is_file())]


def survey(paths: Iterable[str | Path]) -> list[Found]:
    """What the files are that are named, or lie in folders that are named: each of them, in order.

    Raises
    ------
    InputError
        If a name does not exist, or there are too many files.
    """
    found: list[Found] = []
    for name in map(Path, paths):
        if not name.exists():
            raise InputError(str(name), "does not exist", remedy="check the path")
        found += _folder(name) if name.is_dir() else _file(name, alone=True)
    taken = {
        part
        for each in found
        if each.is_flight and each.path.is_file()
        for part in parts_of(each.path, kind_of(each.path))[1:]
    }
    return [
        Found(each.path, _PART, "part of a flight beside it")
        if each.path in taken and not _leads(each, taken)
        else each
        for each in found
    ]


def _leads(found: Found, taken: set[Path]) -> bool:
    """Whether a file is the first of those that belong together: a bag that was split names itself."""
    return (
        found.is_flight
        and parts_of(found.path, kind_of(found.path))[0] == found.path
        and found.path not in taken
    )


def _file(path: Path, alone: bool = False) -> list[Found]:
    try:
        kind = kind_of(path)
    except InputError as error:
        return [Found(path, _REFUSED, error.found)]
    if kind == "photos" and not alone:
        return []
    if kind:
        return [Found(path, _FLIGHT, KINDS[kind].words)]
    side = "what is said of a flight beside it" if path.suffix.lower() == ".toml" else "no flight"
    return [Found(path, _OTHER, side)]


def _folder(folder: Path) -> list[Found]:
    found: list[Found] = []
    count = 0
    for place, folders, names in _walked(folder):
        folders.sort()
        count += len(names)
        if count > MAX_FILES:
            raise InputError(
                str(folder),
                f"holds more than {MAX_FILES} files",
                "the folder of some flights",
                "name a folder in it",
            )
        images = set(photos.members(place))
        if images:
            words = f"{len(images)} photos" if len(images) > 1 else "one photo: no flight"
            found.append(Found(place, _FLIGHT if len(images) > 1 else _OTHER, words))
        for name in sorted(names):
            if not name.startswith(".") and place / name not in images:
                found += _file(place / name)
    return found


def _walked(folder: Path) -> Iterator[tuple[Path, list[str], Sequence[str]]]:
    """A folder and those in it; links are not followed."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        if "catalog.json" in names and "heads" in folders:  # a catalog holds no flights of others
            folders.clear()
            continue
        yield Path(place), folders, [name for name in names if (Path(place) / name).is_file()]
