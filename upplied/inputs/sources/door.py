"""The one door: the kind of each file, by its content, and the flights in a folder; none drops in silence."""

import csv
import os
import re
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from xml.etree.ElementTree import ParseError

from defusedxml.common import DefusedXmlException

from upplied.errors import InputError
from upplied.inputs.files import open_regular, table
from upplied.inputs.sidecar import sidecar_of
from upplied.inputs.sources import bags, photos, records
from upplied.inputs.sources.source import Fields, Source

MAX_FILES = 200_000
_HEAD = 1 << 16  # bytes by which a file is known
_FLIGHT, _PART, _OTHER, _REFUSED = "flight", "part", "other", "refused"
# What damaged bytes make of a parser. A fault of our own raises something else, and stays a fault.
_PARSING = (
    ValueError, LookupError, OverflowError, RecursionError, EOFError, struct.error, csv.Error, sqlite3.Error,
    zlib.error, zipfile.BadZipFile, NotImplementedError, ParseError, DefusedXmlException,
)  # fmt: skip


@dataclass(frozen=True)
class FileKind:
    """What one file, or folder of photos, is."""

    path: Path
    status: str  # "flight", "part" of one, "other", or "refused": looks like one and cannot be read
    words: str  # what it is, or why it is refused
    remedy: str = ""  # of what is refused

    @property
    def is_flight(self) -> bool:
        return self.status == _FLIGHT


_TABLES = table("kinds.toml")["flight"]
#: Each kind of file that holds a flight: in words, and its reader in `upplied.inputs.sources`.
KINDS: dict[str, tuple[str, str]] = {kind: tuple(row) for kind, row in _TABLES["kinds"].items()}
_LOGS = (".mcap", ".ulg", ".bag", ".db3", ".tlog", ".srt", ".plan", ".waypoints", ".kmz")  # by name a flight


def kind_of(path: Path) -> str:
    """The key in `KINDS` of a file or folder, empty where it is none; InputError if it cannot be read."""
    if path.is_dir():
        return "photos" if photos.members(path) else ""
    try:
        with open_regular(path) as stream:
            head = stream.read(_HEAD)
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "a readable file") from None
    tar = head[:1] == b"\x1f" and ".tar" in path.name
    unread = [why for why, it in _TABLES["unread"].items() if not tar and re.match(it.encode(), head)]
    unread += [why for why, name in _TABLES["unread_names"].items() if re.fullmatch(name, path.name)]
    if unread:
        raise InputError(str(path), unread[0])
    kind = next((kind for kind, begins in _TABLES["bytes"].items() if re.match(begins.encode(), head)), "")
    kind = kind or _binary(path, head) or ("" if b"\0" in head[:4096] else _text(path, head))
    if not kind and path.suffix.lower() in _LOGS:
        finding = f"does not begin as a {path.suffix} file does" if head.strip() else "is empty"
        raise InputError(str(path), finding, "a whole file", "copy it again from the recorder")
    return kind


def _binary(path: Path, head: bytes) -> str:
    if head.startswith(b"SQLite format 3\0") and b"topics" in head and b"messages" in head:
        return "ros2"
    if head.startswith(b"PK\x03\x04"):
        return "mission" if b".wpml" in head or b".kml" in head or path.suffix.lower() == ".kmz" else ""
    if len(head) > 16 and head[8] in (0xFE, 0xFD) and 10**15 < int.from_bytes(head[:8], "big") < 10**16:
        return "tlog"
    return "colmap" if path.name == "images.bin" and path.with_name("cameras.bin").is_file() else ""


def _text(path: Path, head: bytes) -> str:
    text = head.decode("utf-8-sig", "replace").replace("\r\n", "\n")
    if text.lstrip()[:1] in ("{", "[") and len(head) == _HEAD and path.stat().st_size < 1 << 28:
        text = path.read_bytes().decode("utf-8", "replace")  # of JSON all: its keys may follow a long list
    for reason, pattern in _TABLES["unread_texts"].items():
        if re.search(pattern, text):
            raise InputError(str(path), reason)
    for kind, pattern in _TABLES["texts"].items():
        if re.search(pattern, text, re.MULTILINE):
            return kind
    if records.CAPTION.search(text[:4096]):
        return "captions"
    if records.is_record(text[:8192]):
        return "record"
    data = [line for line in text.splitlines()[:200] if line.strip() and not line.startswith("#")]
    widths = [records.width_of(line.encode()) for line in data[:20]]
    same = len(widths) >= 2 and len(set(widths[:-1])) == 1
    return "poses" if same and widths[0] in records.WIDTHS else ""


def read(path: Path, fields: Fields) -> Source:
    """The tables of a file or a folder of photos; InputError if it is no flight, or damaged beyond use."""
    if not (kind := kind_of(path)):
        rule = f"one of: {', '.join(dict.fromkeys(words for words, _ in KINDS.values()))}"
        raise InputError(str(path), "is not a readable flight", rule, "check that it is the right file")
    words, name = KINDS[kind]
    module = import_module(f"upplied.inputs.sources.{name}")
    try:
        return module.read(path, fields)
    except InputError as error:
        raise InputError(error.what or str(path), error.finding, error.rule, error.remedy) from None
    except (*_PARSING, *getattr(module, "ERRORS", ())) as error:  # and what bytes make it raise besides
        finding = f"cannot be read as {words}: {type(error).__name__}: {str(error)[:200]}"
        rule = "a whole file, as its program writes it"
        raise InputError(str(path), finding, rule, "copy or export it again") from error


def parts_of(path: Path, kind: str) -> list[Path]:
    """All files of the flight at a path, that one first."""
    if kind == "photos" and path.is_dir():
        return photos.members(path)
    names: Iterable[Path] = ()
    if kind == "ros2":
        names = [*bags.siblings(path), path.with_name("metadata.yaml")]
    elif kind == "colmap":
        names = [path.with_name(f"{name}{path.suffix}") for name in ("cameras", "points3D", "frames", "rigs")]
    elif kind == "poses":
        names = records.times_beside(path)
    return [path, *(name for name in names if name != path and name.is_file())]


def survey(paths: Iterable[str | Path]) -> list[FileKind]:
    """What the named files are, or those in named folders; InputError if one is missing, or they are many."""
    files: list[FileKind] = []
    for name in map(Path, paths):
        if not name.exists():
            raise InputError(str(name), "does not exist", remedy="check the path")
        files += _folder(name) if name.is_dir() else _file(name, alone=True)
    parts: set[Path] = set()
    for each in files:
        if each.is_flight and each.path.is_file() and each.path not in parts:
            parts |= set(parts_of(each.path, kind_of(each.path))[1:])
    parts |= {sidecar_of(each.path) for each in files if each.is_flight or each.status == _REFUSED}
    words = "part of a flight beside it"
    return [FileKind(it.path, _PART, words) if it.path in parts else it for it in files]


def _file(path: Path, alone: bool = False) -> list[FileKind]:
    try:
        kind = kind_of(path)
    except InputError as error:
        return [FileKind(path, _REFUSED, error.finding, error.remedy)]
    if kind == "photos" and not alone:
        return []
    return [FileKind(path, _FLIGHT, KINDS[kind][0]) if kind else FileKind(path, _OTHER, "no flight")]


def _folder(folder: Path) -> list[FileKind]:
    files, count = list[FileKind](), 0
    for at, folders, names in os.walk(folder):  # links to folders are not followed
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if "catalog.json" in names and "heads" in folders:  # a catalog holds no flights of others
            folders.clear()
            continue
        place, count = Path(at), count + len(names)
        if count > MAX_FILES:
            rule = "the folder of some flights"
            raise InputError(str(folder), f"holds more than {MAX_FILES} files", rule, "name a folder in it")
        if images := set(photos.members(place)):
            words = f"{len(images)} photos" if len(images) > 1 else "one photo: no flight"
            files.append(FileKind(place, _FLIGHT if len(images) > 1 else _OTHER, words))
        for name in sorted(names):
            if not name.startswith(".") and place / name not in images:
                files += _file(place / name)
    return files
