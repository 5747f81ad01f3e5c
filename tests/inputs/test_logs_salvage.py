"""Damaged logs give what is left of them, marked, or a clear refusal; never anything else."""

from __future__ import annotations

import re
import resource
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_logs import flight, poses, write_log
from mcap.writer import CompressionType, IndexType

from upplied.errors import InputError, UppliedError
from upplied.geometry.poses import angle_between
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.inputs.mcap import decoders, recording
from upplied.inputs.mcap.recording import MAGIC

POSE = "geometry_msgs/msg/PoseStamped"
FACTS = {"structure_id": "a320", "body_frame": "camera"}
OPTIONS = LogOptions(structure_id="a320", body_frame="camera", min_duration_s=0.0)


@pytest.fixture(scope="module")
def sound_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound log of 3000 poses in many chunks."""
    path = tmp_path_factory.mktemp("sound") / "a.mcap"
    return write_log(path, [poses("/pose", POSE, flight(3000, 100.0))], FACTS)


@pytest.fixture(scope="module")
def sound(sound_path: Path) -> bytes:
    """Its bytes."""
    return sound_path.read_bytes()


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Start of the record and length of the content of each chunk."""
    places, at = [], 8
    while data[at] != 0x0F:
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        if data[at] == 6:
            places.append((at, length))
        at += 9 + length
    return places


def read(tmp_path: Path, data: bytes, name: str = "a.mcap"):
    """The demonstration that these bytes hold."""
    path = tmp_path / name
    path.write_bytes(data)
    return read_demonstration(path, OPTIONS)


def test_a_sound_log_is_not_degraded(tmp_path: Path, sound: bytes) -> None:
    actual = read(tmp_path, sound)
    assert len(actual) == 3000 and not actual.degraded and not actual.notes.count("lost")


@pytest.mark.parametrize("share", [0.3, 0.55, 0.8])
def test_a_truncated_log_keeps_every_whole_chunk(tmp_path: Path, sound: bytes, share: float) -> None:
    cut = int(len(sound) * share)
    whole = [at for at, length in chunks(sound) if at + 9 + length <= cut]
    actual = read(tmp_path, sound[:cut])
    full = read(tmp_path, sound)
    per_chunk = len(full) / len(chunks(sound))
    assert actual.degraded and "not closed" in actual.notes
    assert abs(len(actual) - len(whole) * per_chunk) <= per_chunk
    assert np.array_equal(actual.positions, full.positions[: len(actual)])


@pytest.mark.parametrize(
    "damage",
    [
        "no magic",
        "no footer",
        "no summary",
        "summary flipped",
        "footer wrong",
        "zeros at the end",
        "garbage at the end",
    ],
)
def test_damage_after_the_data_loses_nothing(tmp_path: Path, sound: bytes, damage: str) -> None:
    last_at, last_length = chunks(sound)[-1]
    end = last_at + 9 + last_length
    spoilt = {
        "no magic": sound[:-8],
        "no footer": sound[:-37],
        "no summary": sound[:end],
        "summary flipped": sound[:-200] + bytes([sound[-200] ^ 0xFF]) + sound[-199:],
        "footer wrong": sound[:-28] + struct.pack("<Q", 12345) + sound[-20:],
        "zeros at the end": sound[:end] + bytes(5000),
        "garbage at the end": sound + b"garbage",
    }[damage]
    actual = read(tmp_path, spoilt)
    assert len(actual) == 3000 and actual.degraded


@pytest.mark.parametrize("damage", ["data", "length", "opcode", "size"])
@pytest.mark.parametrize("closed", [True, False])
def test_a_damaged_chunk_is_lost_alone(tmp_path: Path, sound: bytes, damage: str, closed: bool) -> None:
    places = chunks(sound)
    at, length = places[len(places) // 2]
    data = bytearray(sound if closed else sound[:-100])
    if damage == "data":
        data[at + 9 + length // 2] ^= 0xFF
    elif damage == "length":
        data[at + 1 : at + 9] = struct.pack("<Q", 2**40)
    elif damage == "opcode":
        data[at] = 0x77
    else:
        data[at + 9 + 16 : at + 9 + 24] = struct.pack("<Q", 2**62)
    actual = read(tmp_path, bytes(data))
    lost = 3000 - len(actual)
    assert lost <= 1.1 * 3000 / len(places)
    if lost or not closed:
        assert actual.degraded
    assert len(actual.breaks) == (1 if lost > 50 else 0)


@pytest.mark.parametrize(
    "writing",
    [
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"use_statistics": False, "use_summary_offsets": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"enable_crcs": False},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"chunk_size": 10},
    ],
    ids=lambda value: next(iter(value)) + str(next(iter(value.values()))),
)
def test_every_way_of_writing_is_read(tmp_path: Path, writing: dict) -> None:
    flown = flight(300)
    path = write_log(tmp_path / "a.mcap", [poses("/pose", POSE, flown)], FACTS, **writing)
    actual = read_demonstration(path, OPTIONS)
    assert np.array_equal(actual.positions, flown.positions) and not actual.degraded


def test_an_unchunked_log_that_is_cut_keeps_its_messages(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", [poses("/pose", POSE, flight())], FACTS, use_chunking=False)
    actual = read(tmp_path, path.read_bytes()[:20_000], "b.mcap")
    assert actual.degraded and 100 < len(actual) < 300


def test_a_flip_in_an_unchunked_log_is_told(tmp_path: Path) -> None:
    writing = {"use_chunking": False, "enable_data_crcs": True}
    path = write_log(tmp_path / "a.mcap", [poses("/pose", POSE, flight())], FACTS, **writing)
    assert not read_demonstration(path).degraded
    data = bytearray(path.read_bytes())
    at = data.find(struct.pack("<d", flight().positions[100][0]))
    data[at] ^= 1
    actual = read(tmp_path, bytes(data), "b.mcap")
    assert actual.degraded and "CRC" in actual.notes


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b"#ROSBAG V2.0\n" + bytes(50), "ROS 1 bag"),
        (b"SQLite format 3\0", "does not begin as a .mcap"),
        (b"ULog\x01\x12\x35\x01", "PX4 log"),
        (b"\x28\xb5\x2f\xfd" + bytes(9), "unpack it first"),
        (b"version https://git-lfs", "git LFS"),
        (b"hello", "does not begin as a .mcap"),
        (MAGIC, "holds no poses"),
        (MAGIC * 10, "holds no poses"),
    ],
)
def test_what_is_no_log_is_named(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, data)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.mcap"):
        read_demonstration(tmp_path / "nowhere.mcap")
    with pytest.raises(InputError):
        read_demonstration(tmp_path)


def bomb(chunk_bytes: int, count: int, header_bytes: int | None = None, content: bool = True) -> bytes:
    """A small log whose chunks unpack to zeros by the gigabyte."""
    packed = zstandard.ZstdCompressor(write_content_size=content).compress(bytes(chunk_bytes))
    size = chunk_bytes if header_bytes is None else header_bytes
    body = (
        struct.pack("<QQQI", 0, 1, size, 0)
        + struct.pack("<I", 4)
        + b"zstd"
        + struct.pack("<Q", len(packed))
        + packed
    )
    header = b"\x01" + struct.pack("<Q", 8) + bytes(8)
    return MAGIC + header + (b"\x06" + struct.pack("<Q", len(body)) + body) * count


@pytest.mark.ci
def test_a_bomb_does_not_go_off(tmp_path: Path) -> None:
    """100 kB in which each chunk unpacks to 200 MB, or lies about it, in a process of 1.5 GB."""
    paths = []
    for size in (None, 1000, 2**62):
        for content in (True, False):
            data = bomb(200 * 2**20, 8, size, content)
            assert len(data) < 200_000
            paths.append(tmp_path / f"bomb-{size}-{content}.mcap")
            paths[-1].write_bytes(data)
    limit = 1536 * 2**20
    code = (
        "import sys\nfrom upplied.errors import UppliedError\n"
        "from upplied.inputs.logs import read_demonstration\n"
        "for path in sys.argv[1:]:\n"
        "    try: read_demonstration(path)\n    except UppliedError as error: print(error)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code, *map(str, paths)],
        capture_output=True,
        text=True,
        timeout=60,
        env={"OPENBLAS_NUM_THREADS": "1", "PATH": ""},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )
    assert process.returncode == 0, process.stderr
    assert all(path.name in process.stdout for path in paths)


def test_many_indexes_of_one_chunk_are_one_chunk(tmp_path: Path, sound: bytes) -> None:
    """A summary that names one chunk a thousand times does not read it a thousand times."""
    summary_start = struct.unpack("<Q", sound[-28:-20])[0]
    body = sound[summary_start:-37]
    first = body.find(b"\x08", 0)
    entries, at = b"", 0
    while at < len(body):
        length = int.from_bytes(body[at + 1 : at + 9], "little")
        if body[at] == 8:
            entries += body[at : at + 9 + length] * 100
        at += 9 + length
    assert first >= 0
    summary = body + entries
    footer = b"\x02" + struct.pack("<QQQ", 20, summary_start, 0)
    crc = zlib.crc32(footer, zlib.crc32(summary))
    actual = read(tmp_path, sound[:summary_start] + summary + footer + struct.pack("<I", crc) + MAGIC)
    assert len(actual) == 3000


WOUNDS = st.lists(
    st.tuples(
        st.sampled_from(["flip", "cut", "remove", "insert"]),
        st.floats(0, 1),
        st.integers(1, 255),
        st.binary(min_size=1, max_size=50),
    ),
    min_size=1,
    max_size=4,
)


@pytest.mark.ci
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(WOUNDS)
def test_any_damage_is_a_record_or_a_refusal(tmp_path: Path, sound_path: Path, wounds: list[tuple]) -> None:
    spoilt = bytearray(sound_path.read_bytes())
    for kind, share, number, some in wounds:
        if not spoilt:
            break
        at = int(share * (len(spoilt) - 1))
        if kind == "flip":
            spoilt[at] ^= number
        elif kind == "cut":
            del spoilt[max(at, 1) :]
        elif kind == "remove":
            del spoilt[at : at + number]
        else:
            spoilt[at:at] = some
    try:
        actual = read(tmp_path, bytes(spoilt))
    except UppliedError:
        return
    assert 2 <= len(actual) <= 3000 and np.isfinite(actual.positions).all()
    assert actual.degraded or len(actual) == 3000


EXPECTED = {  # file -> poses, degraded and what notes or dropped say; or the refusal
    "empty.mcap": "is empty",
    "flip_chunk_v101.mcap": (9006, True, "1 of 3 chunks lost: a chunk fails its CRC"),
    "headeronly_fwd5.mcap": "holds no poses; the log was not closed",
    "nomagic_fwd5.mcap": (1930, True, "not closed"),
    "s_dup.mcap": (500, False, "500 repeated"),
    "s_emptyschema.mcap": "definition of geometry_msgs/msg/PoseStamped is empty",
    "s_fastwrite.mcap": (1000, False, ""),
    "s_logtime_zero.mcap": (1000, False, ""),
    "s_nan.mcap": (49, False, "1 not a number"),
    "s_noindex.mcap": (1000, False, ""),
    "s_outoforder.mcap": (1000, False, ""),
    "s_schema0.mcap": r"holds no poses; its topics: /uav/pose \(no schema\)",
    "s_shortpayload.mcap": (49, False, "1 unreadable message"),
    "s_twochannels_sametopic.mcap": "sources of poses that differ: .*PoseStamped.*Odometry",
    "s_zero.mcap": "holds no poses",
    "trunc_midchunk_v101.mcap": (5344, True, "not closed; read up to byte"),
    "trunc_nosummary_v101.mcap": (14356, True, "not closed"),
    "zerotail_fwd5.mcap": (1930, True, "not closed"),
}


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_the_broken_logs(real_data: Path, name: str) -> None:
    path, expected = real_data / "logs" / "broken" / name, EXPECTED[name]
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            read_demonstration(path, OPTIONS)
        return
    actual = read_demonstration(path, OPTIONS)
    words = actual.notes + ", ".join(f"{number} {reason}" for reason, number in actual.dropped.items())
    assert (len(actual), actual.degraded) == expected[:2]
    assert expected[2] in words
    assert (np.diff(actual.t_ns) > 0).all()


def test_a_short_log_is_refused_with_what_was_dropped(real_data: Path) -> None:
    with pytest.raises(InputError, match=re.escape("49 poses over 0.49 s (1 not a number dropped)")):
        read_demonstration(real_data / "logs" / "broken" / "s_nan.mcap", LogOptions(structure_id="x"))


def test_the_golden_pair(real_data: Path) -> None:
    """One flight as PX4 tells it (NED, FRD) and as MAVROS does (ENU, FLU)."""
    folder = real_data / "logs" / "converted"
    ned = read_demonstration(folder / "px4_posctl_indoor_ev_px4msgs_ned.mcap")
    enu = read_demonstration(folder / "px4_posctl_indoor_ev_mavros_enu.mcap")
    assert len(ned) == len(enu) == 762
    assert np.abs(ned.positions - enu.positions).max() < 1e-6
    # The twin took the nearest attitude, ours is interpolated to the position's moment.
    assert np.degrees(angle_between(ned.quat_xyzw, enu.quat_xyzw)).max() < 0.3


def test_a_flood_of_poses_in_a_small_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some kilobytes that unpack to more equal poses than a log of that size may hold."""
    assert recording.MAX_MESSAGES == decoders.MAX_MESSAGES == (500_000, 0.125)
    for module in (recording, decoders):
        monkeypatch.setattr(module, "MAX_MESSAGES", (20_000, 0.125))
    path = write_log(tmp_path / "a.mcap", [poses("/pose", POSE, flight(2))], FACTS, use_chunking=False)
    data = path.read_bytes()
    start = 8 + 9 + int.from_bytes(data[9:17], "little")  # after the header: schema, channel, message
    at = data.index(b"\x05" + struct.pack("<Q", 22 + 76))
    records = data[start:at] + data[at : at + 9 + 22 + 76] * 30_000
    packed = zstandard.ZstdCompressor().compress(records)
    body = struct.pack("<QQQI", 0, 1, len(records), 0) + struct.pack("<I", 4) + b"zstd"
    body += struct.pack("<Q", len(packed)) + packed
    flood = MAGIC + b"\x01" + struct.pack("<Q", 8) + bytes(8) + b"\x06" + struct.pack("<Q", len(body)) + body
    assert len(flood) < 100_000
    with pytest.raises(InputError, match="messages of poses"):
        read(tmp_path, flood, "b.mcap")
