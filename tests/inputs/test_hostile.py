"""Hostile files of each kind: a clear error with the file, and nothing that is stored changes."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from made_logs import flight
from made_sources import WRITERS

from upplied.errors import InputError
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.sources import door, records

_ENTITIES = (
    b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">'
    b'<!ENTITY c SYSTEM "file:///etc/passwd">]>'
)
_POSE = "{} 0 0 1 0 0 0 1\n"
_POSES = "".join(_POSE.format(at) for at in range(30)).encode()
_KML = b"<kml><LineString><coordinates>1,1 1,1</coordinates></LineString></kml>"


def _zip(name: str, size: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, bytes(size))
    return out.getvalue()


def _shots(**shot: object) -> bytes:
    return json.dumps([{"shots": {"a": shot, "b": shot}, "cameras": {}}]).encode()


def _plan(**mission: object) -> bytes:
    return json.dumps({"fileType": "Plan", "version": 1, "mission": {"version": 2, **mission}}).encode()


HOSTILE: dict[str, tuple[str, bytes]] = {
    "ulog of an endless array": ("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(8) + b"a[99999999999] x;"),
    "ulog of a huge message": ("a.ulg", b"ULog\x01\x12\x35\x01" + bytes(8) + b"\xff\xffF" + bytes(99)),
    "dataflash of nothing": ("a.bin", b"\xa3\x95\x80" + bytes(500)),
    "telemetry of noise": ("a.tlog", struct.pack(">Q", 1_700_000_000_000_000) + b"\xfe\xff" + bytes(400)),
    "bag of huge records": ("a.bag", b"#ROSBAG V2.0\n" + b"\xff\xff\xff\x7f" * 50),
    "database without tables": ("a.db3", b"SQLite format 3\0" + bytes(100) + b"topics messages" + bytes(900)),
    "colmap of 2^60 images": ("images.bin", struct.pack("<Q", 1 << 60) + bytes(200)),
    "colmap without an end": ("images.bin", struct.pack("<QI7dI", 2, 1, *[0.0] * 7, 1) + b"a" * 90),
    "bundler of 10^12 cameras": ("a.out", b"# Bundle file v0.3\n1000000000000 0\n1 2\n"),
    "nvm of 10^12 cameras": ("a.nvm", b"NVM_V3\n\n1000000000000\na.jpg 1 1 0 0 0 0 0 0 0 0\n"),
    "opensfm with text for a turn": ("reconstruction.json", _shots(rotation="x", translation=[0, 0, 0])),
    "opensfm with NaN": ("reconstruction.json", _shots(rotation=[float("nan")] * 3, translation=[0, 0, 0])),
    "opensfm with a number for shots": ("reconstruction.json", b'[{"shots": {"a": 5, "b": 6}}]'),
    "nerfstudio with short rows": ("transforms.json", b'{"frames": [{"transform_matrix": [[1]]}]}'),
    "deep json": ("transforms.json", b'{"transform_matrix":' + b"[" * 100_000 + b"]" * 100_000 + b"}"),
    "metashape with entities": ("cameras.xml", _ENTITIES + b"<document><chunks><chunk/></chunks></document>"),
    "metashape without numbers": ("cameras.xml", b"<document><chunk><camera><transform>x</transform></camera>"
                                  b"<camera><transform>1</transform></camera></chunk></document>"),
    "realitycapture of text": ("a.csv", b"#name,x,y,alt,heading,pitch,roll\na,b,c,d,e,f,g\na,b,c,d,e,f,g\n"),
    "kml with entities": ("a.kml", _ENTITIES + _KML.replace(b"1,1", b"&b;")),
    "kml of NaN": ("a.kml", _KML.replace(b"1,1", b"nan,nan")),
    "kmz bomb": ("a.kmz", _zip("wpmz/waylines.wpml", 300 << 20)),
    "kmz of something else": ("a.kmz", _zip("readme.txt", 10)),
    "plan of another version": ("a.plan", b'{"fileType": "Plan", "version": 9}'),
    "plan with text for items": ("a.plan", _plan(items="none")),
    "plan of NaN": ("a.plan", _plan(items=[{"type": "SimpleItem", "command": 16, "frame": 3,
                                           "params": [0, 0, 0, 0, "nan", 8, 9]}] * 3)),
    "waypoints of text": ("a.waypoints", b"QGC WPL 110\nhome\na b c d e f g h i j k l\n"),
    "captions without places": ("a.srt", b"1\n00:00:00,000 --> 00:00:01,000\nhello\n\n" * 50),
    "record without rows": ("a.csv", b"latitude,longitude,height_above_takeoff(feet)\n"),
    "record of nowhere": ("a.csv", b"latitude,longitude,altitude(m)\n" + b"0,0,0\n" * 50),
    "poses of NaN": ("a.txt", _POSES.replace(b" 0 ", b" nan ")),
    "poses of another width": ("a.txt", _POSES + b"1 2 3\n" * 9),
    "poses of an infinite stamp": ("a.txt", _POSE.format("inf").encode() * 9),
    "a mesh named as a log": ("a.mcap", b"ply\nformat ascii 1.0\n"),
    "a log named as a photo": ("a.bag", b"\xff\xd8\xff\xe0" + bytes(50)),
    "an empty plan": ("a.plan", b""),
}  # fmt: skip


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_is_an_error_that_names_it(tmp_path: Path, kind: str) -> None:
    name, data = HOSTILE[kind]
    path = tmp_path / name
    path.write_bytes(data)
    if name == "images.bin":
        (tmp_path / "cameras.bin").write_bytes(struct.pack("<Q", 0))
    with pytest.raises(InputError) as caught:
        read_demonstration(path, LogOptions(structure_id="tank", unit_m=1.0))
    assert str(path) in str(caught.value) and caught.value.finding
    assert path.read_bytes() == data


def test_a_log_with_a_hole_is_read_as_damaged_and_nothing_is_printed(tmp_path: Path, capfd) -> None:
    path, facts = WRITERS["dataflash"](tmp_path, flight(60, 10.0))
    whole = path.read_bytes()
    half = len(whole) // 2
    path.write_bytes(whole[:half] + bytes(5000) + whole[half:])
    flown = read_demonstration(path, LogOptions(structure_id="tank", **facts))
    assert flown.degraded and "bytes between messages cannot be read" in flown.notes
    assert len(flown.t_ns) >= 59 and capfd.readouterr() == ("", "")
    path.write_bytes(whole[:half] + bytes(10 * len(whole)))
    with pytest.raises(InputError, match=r"holds \d+ messages in \d+ bytes"):
        read_demonstration(path, LogOptions(structure_id="tank", **facts))


def test_pipes_and_broken_links_are_refused_by_name(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap")  # opening it would wait for ever
    (tmp_path / "b.ulg").symlink_to(tmp_path / "nowhere")
    (tmp_path / "c").symlink_to(tmp_path)  # a folder that holds itself
    pipe, link = door.survey([tmp_path])
    assert (pipe.path.name, link.path.name) == ("a.mcap", "b.ulg") and pipe.status == link.status == "refused"
    assert "no regular file" in pipe.words and "No such file" in link.words


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("DJIFlightRecord_2026-01-02_[10-00-00].txt", bytes(range(200)), "encrypted: export it as CSV"),
        ("FLY012.DAT", bytes(200), "encrypted"),
        ("logs.zip", _zip("day 1/flight.mcap", 10), "an archive: unpack it first"),
        ("mission.kmz", b"PK\x05\x06" + bytes(18), "does not begin as a .kmz file does"),
    ],
)
def test_a_flight_that_cannot_be_read_is_refused_with_what_to_do(
    tmp_path: Path, name: str, data: bytes, reason: str
) -> None:
    (tmp_path / name).write_bytes(data)
    (tmp_path / "photos.zip").write_bytes(_zip("readme.txt", 10))
    refused, other = sorted(door.survey([tmp_path]), key=lambda one: one.status != "refused")
    assert (refused.path.name, refused.status, other.status) == (name, "refused", "other")
    assert reason in refused.words


@pytest.mark.parametrize("fault", [AttributeError, AssertionError, NameError, ZeroDivisionError])
def test_a_fault_of_our_own_is_not_called_a_damaged_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: type[Exception]
) -> None:
    (tmp_path / "a.txt").write_bytes(_POSES)

    def broken(path: Path, fields: object) -> None:
        raise fault("ours")

    reader: Callable[[Path, object], None] = broken
    monkeypatch.setattr(records, "read", reader)
    with pytest.raises(fault, match="ours"):
        door.read(tmp_path / "a.txt", {})
