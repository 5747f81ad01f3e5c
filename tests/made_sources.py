"""The same known flight, written as each kind of file that people own."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymap3d
from made_logs import ROS2, Flight, message, poses, write_log
from mcap_ros2._dynamic import serialize_dynamic
from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

PLACE = {
    "structure_lat_deg": 47.0,
    "structure_lon_deg": 8.0,
    "structure_alt_m": 400.0,
    "structure_heading_deg": 30.0,
    "structure_datum": "ellipsoid",
}
TAKEOFF_M = 390.0  # above the ellipsoid, as the structure
_CAMERA = {"body_frame": "camera"}
_HALF = np.sqrt(0.5)
_NED_R_ENU, _FRD_R_FLU = Rotation.from_quat([_HALF, _HALF, 0, 0]), Rotation.from_quat([1, 0, 0, 0])
CAMERA_R_OPTICAL = Rotation.from_matrix([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
_POSE = "geometry_msgs/msg/PoseStamped"
Written = tuple[Path, dict[str, object]]  # and what a side-car would say


def on_earth(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray, Rotation]:
    """Latitude, longitude, altitude above the ellipsoid, and orientations, east, north and up."""
    turn = Rotation.from_euler("z", 90 - PLACE["structure_heading_deg"], degrees=True)
    lat, lon, alt = pymap3d.enu2geodetic(*turn.apply(flight.positions).T, 47.0, 8.0, 400.0)
    return lat, lon, alt, turn * Rotation.from_quat(flight.quat_xyzw)


def angles(flight: Flight) -> np.ndarray:
    """Yaw from north, pitch and roll, deg."""
    ned = _NED_R_ENU * on_earth(flight)[3] * _FRD_R_FLU
    return ned.as_euler("ZYX", degrees=True)


def _mcap(folder: Path, flight: Flight) -> Written:
    return write_log(folder / "flight.mcap", [poses("/camera/pose", _POSE, flight)], {}), _CAMERA


def _bag1(folder: Path, flight: Flight) -> Written:
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    with Writer1(folder / "flight.bag") as bag:
        link = bag.add_connection("/camera/pose", _POSE, typestore=store)
        for number, (t_ns, p, q) in enumerate(
            zip(flight.t_ns, flight.positions, flight.quat_xyzw, strict=True)
        ):
            stamp = kinds["builtin_interfaces/msg/Time"](int(t_ns // 10**9), int(t_ns % 10**9))
            pose = kinds[_POSE](
                kinds["std_msgs/msg/Header"](number, stamp, "map"),
                kinds["geometry_msgs/msg/Pose"](
                    kinds["geometry_msgs/msg/Point"](*p), kinds["geometry_msgs/msg/Quaternion"](*q)
                ),
            )
            bag.write(link, int(t_ns), store.serialize_ros1(pose, _POSE))
    return folder / "flight.bag", _CAMERA


def bag2(folder: Path, flight: Flight, defined: bool = True) -> Written:
    """A ROS 2 bag in SQLite; before ROS Iron without definitions."""
    folder.mkdir(exist_ok=True)
    encode = serialize_dynamic(_POSE, ROS2[_POSE])[_POSE]
    with sqlite3.connect(folder / "flight_0.db3") as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute("INSERT INTO topics VALUES (1, '/camera/pose', ?, 'cdr')", [_POSE])
        if defined:
            database.execute(
                "CREATE TABLE message_definitions(topic_type TEXT, encoded_message_definition TEXT)"
            )
            database.execute("INSERT INTO message_definitions VALUES (?, ?)", [_POSE, ROS2[_POSE]])
        rows = zip(flight.t_ns, flight.positions, flight.quat_xyzw, strict=True)
        database.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)",
            [(int(t), encode(message(_POSE, int(t), p, q))) for t, p, q in rows],
        )
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    return folder / "flight_0.db3", _CAMERA


def _ulog(folder: Path, flight: Flight) -> Written:
    """A PX4 log by its documented format: positions and attitudes on two topics, and one satellite fix."""
    boot_us = 5_000_000
    since = boot_us + (flight.t_ns - flight.t_ns[0]) // 1000
    quats = (_NED_R_ENU * Rotation.from_quat(flight.quat_xyzw) * _FRD_R_FLU).as_quat()
    formats = {
        "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;"
        "bool xy_valid;bool z_valid",
        "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q",
        "sensor_gps": "uint64_t timestamp;uint64_t time_utc_usec;uint8_t fix_type",
    }
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", boot_us)]

    def add(kind: bytes, body: bytes) -> None:
        out.append(struct.pack("<H", len(body)) + kind + body)

    add(b"B", bytes(40))
    for name, text in formats.items():
        add(b"F", f"{name}:{text};".encode())
    for number, name in enumerate(formats):
        add(b"A", struct.pack("<BH", 0, number) + name.encode())
    add(b"D", struct.pack("<HQQB", 2, int(since[0]), int(flight.t_ns[0] // 1000), 3))
    for t, p, q in zip(since.tolist(), flight.positions, quats, strict=True):
        add(b"D", struct.pack("<HQQfff??", 0, t, t, p[1], p[0], -p[2], True, True))
        add(b"D", struct.pack("<HQQ4f", 1, t, t, q[3], *q[:3]))
    (folder / "flight.ulg").write_bytes(b"".join(out))
    return folder / "flight.ulg", {}


def _dataflash(folder: Path, flight: Flight) -> Written:
    """An ArduPilot log: formats, one satellite fix for the date, positions and attitudes."""
    lat, lon, alt, _ = on_earth(flight)
    yaw, pitch, roll = angles(flight).T
    formats = (
        (128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        (1, 0, "GPS", "QBIHBcLLe", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt"),
        (2, 0, "POS", "QLLe", "TimeUS,Lat,Lng,Alt"),
        (3, 0, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    )
    sizes = {"B": 1, "Q": 8, "I": 4, "H": 2, "c": 2, "L": 4, "e": 4, "f": 4, "n": 4, "N": 16, "Z": 64}
    out = []
    for number, _, name, form, columns in formats:
        length = 3 + sum(sizes[letter] for letter in form)
        out.append(
            b"\xa3\x95\x80"
            + struct.pack("<BB4s16s64s", number, length, name.encode(), form.encode(), columns.encode())
        )
    start_us = 7_000_000
    unix_s = flight.t_ns[0] * 1e-9
    gps_s = unix_s - 315_964_800 + 18
    week = int(gps_s // 604_800)
    fix = struct.pack("<QBIHBhiii", start_us, 3, round((gps_s - week * 604_800) * 1e3), week, 10, 100,
                      round(lat[0] * 1e7), round(lon[0] * 1e7), round(alt[0] * 100))  # fmt: skip
    out.append(b"\xa3\x95\x01" + fix)
    for at, t_ns in enumerate(flight.t_ns):
        since = start_us + int(t_ns - flight.t_ns[0]) // 1000
        place = round(lat[at] * 1e7), round(lon[at] * 1e7), round(alt[at] * 100)
        out.append(b"\xa3\x95\x02" + struct.pack("<Qiii", since, *place))
        out.append(b"\xa3\x95\x03" + struct.pack("<Qfff", since, roll[at], pitch[at], yaw[at] % 360))
    (folder / "flight.bin").write_bytes(b"".join(out))
    return folder / "flight.bin", PLACE | {"geoid_undulation_m": 0.0}


def _tlog(folder: Path, flight: Flight) -> Written:
    from pymavlink.dialects.v20 import ardupilotmega

    link = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    lat, lon, alt, _ = on_earth(flight)
    yaw, pitch, roll = np.radians(angles(flight)).T
    out = []
    for at, t_ns in enumerate(flight.t_ns):
        boot = 9_000 + round(int(t_ns - flight.t_ns[0]) / 1e6)
        place = round(lat[at] * 1e7), round(lon[at] * 1e7), round(alt[at] * 1000)
        for packet in (
            link.global_position_int_encode(boot, *place, 0, 0, 0, 0, 0),
            link.attitude_encode(boot, roll[at], pitch[at], yaw[at], 0, 0, 0),
        ):
            out.append(struct.pack(">Q", int(t_ns) // 1000) + packet.pack(link))
    (folder / "flight.tlog").write_bytes(b"".join(out))
    return folder / "flight.tlog", PLACE | {"geoid_undulation_m": 0.0}


def photos(folder: Path, flight: Flight, relative_yaw: bool = False, **fixed: str) -> Written:
    """Photos as DJI writes them: places and angles in XMP, times to the second in EXIF; `fixed`: of RTK."""
    folder.mkdir(exist_ok=True)
    lat, lon, alt, _ = on_earth(flight)
    for at, (yaw, pitch, roll) in enumerate(angles(flight)):
        gimbal = 0.0 if relative_yaw else yaw
        flown = yaw if relative_yaw else yaw + 3
        values = {
            "GpsLatitude": f"{lat[at]:.9f}", "GpsLongitude": f"{lon[at]:.9f}",
            "AbsoluteAltitude": f"{alt[at] + 40:+.2f}", "RelativeAltitude": f"{alt[at] - TAKEOFF_M:+.2f}",
            "GimbalYawDegree": f"{gimbal:+.2f}", "GimbalPitchDegree": f"{pitch:+.2f}",
            "GimbalRollDegree": f"{roll:+.2f}", "FlightYawDegree": f"{flown:+.2f}", **fixed,
        }  # fmt: skip
        attributes = " ".join(f'drone-dji:{name}="{value}"' for name, value in values.items())
        xmp = (
            '<x:xmpmeta xmlns:x="adobe:ns:meta/">'
            '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
            f'<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {attributes}/>'
            "</rdf:RDF></x:xmpmeta>"
        )
        exif = Image.Exif()
        exif[0x010F], exif[0x0110] = "DJI", "FC6310"
        second = np.datetime64(int(flight.t_ns[at]), "ns").astype("datetime64[s]").item()
        exif.get_ifd(0x8769).update(
            {0x9003: second.strftime("%Y:%m:%d %H:%M:%S"), 0xA405: 24, 0xA002: 4000, 0xA003: 3000}
            | {0x829A: IFDRational(1, 800 - at), 0x829D: IFDRational(56, 10), 0x920A: IFDRational(88, 10)}
        )
        exif.get_ifd(0x8825).update(
            {
                1: "N",
                2: _sixty(lat[at]),
                3: "E",
                4: _sixty(lon[at]),
                5: b"\0",
                6: IFDRational(int(alt[at] * 100), 100),
            }
        )
        Image.new("RGB", (8, 8)).save(folder / f"DJI_{at:04d}.JPG", exif=exif, xmp=xmp.encode())
    return folder, PLACE | {"takeoff_alt_m": TAKEOFF_M}


def _sixty(value: float) -> tuple[IFDRational, ...]:
    whole = int(value)
    minutes = int((value - whole) * 60)
    seconds = (value - whole - minutes / 60) * 3600
    return IFDRational(whole, 1), IFDRational(minutes, 1), IFDRational(round(seconds * 1e4), 10_000)


def _optical(flight: Flight) -> Rotation:
    """Of the camera's frame that looks along z to the structure's."""
    return Rotation.from_quat(flight.quat_xyzw) * CAMERA_R_OPTICAL


def _opensfm(folder: Path, flight: Flight) -> Written:
    inverse = _optical(flight).inv()
    shots = {
        f"{at:04d}.jpg": {
            "rotation": inverse[at].as_rotvec().tolist(),
            "translation": (-inverse[at].apply(p)).tolist(),
            "camera": "c",
            "capture_time": flight.t_ns[at] * 1e-9,
        }
        for at, p in enumerate(flight.positions)
    }
    lens = {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.8}
    content = [{"cameras": {"c": lens}, "shots": shots, "points": {}}]
    (folder / "reconstruction.json").write_text(json.dumps(content))
    return folder / "reconstruction.json", {"unit_m": 1.0}


def _colmap_images(flight: Flight) -> list[tuple[int, np.ndarray, np.ndarray, str]]:
    inverse = _optical(flight).inv()
    shifts = -inverse.apply(flight.positions)
    return [
        (at + 1, inverse[at].as_quat()[[3, 0, 1, 2]], shifts[at], f"{at:04d}.jpg")
        for at in range(len(shifts))
    ]


def _colmap_text(folder: Path, flight: Flight) -> Written:
    lines = ["# Image list with two lines of data per image:", "#   IMAGE_ID, ..."]
    for number, quat, shift, name in _colmap_images(flight):
        lines += [" ".join(map(str, [number, *quat, *shift, 1, name])), "1.0 2.0 -1"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "cameras.txt").write_text("# Camera list\n1 PINHOLE 4000 3000 3200 3200 2000 1500\n")
    return folder / "images.txt", {"unit_m": 1.0}


def _colmap_binary(folder: Path, flight: Flight) -> Written:
    images = _colmap_images(flight)
    out = [struct.pack("<Q", len(images))]
    for number, quat, shift, name in images:
        out.append(struct.pack("<I7dI", number, *quat, *shift, 1) + name.encode() + b"\0")
        out.append(struct.pack("<Qddq", 1, 1.0, 2.0, -1))
    (folder / "images.bin").write_bytes(b"".join(out))
    (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 1, 4000, 3000, 3200, 3200, 2000, 1500))
    return folder / "images.bin", {"unit_m": 1.0}


def _matrices(flight: Flight) -> np.ndarray:
    matrices = np.tile(np.eye(4), (len(flight.t_ns), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = _optical(flight).as_matrix(), flight.positions
    return matrices


def _nerfstudio(folder: Path, flight: Flight) -> Written:
    applied = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]])
    matrices = np.vstack([applied, [0, 0, 0, 1]]) @ _matrices(flight) @ np.diag([1.0, -1, -1, 1])
    frames = [{"file_path": f"{at:04d}.png", "transform_matrix": m.tolist()} for at, m in enumerate(matrices)]
    content = {"w": 4000, "h": 3000, "fl_x": 3200, "applied_transform": applied.tolist(), "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder / "transforms.json", {"unit_m": 1.0}


def _metashape(folder: Path, flight: Flight) -> Written:
    """A chunk on the Earth: its transform leads to the Earth's centre, its scale is another."""
    turn = Rotation.from_euler("z", 90 - PLACE["structure_heading_deg"], degrees=True).as_matrix()
    origin = np.array(pymap3d.geodetic2ecef(47.0, 8.0, 400.0))
    axes = np.column_stack([pymap3d.enu2uvw(*axis, 47.0, 8.0) for axis in np.eye(3)]) @ turn
    matrices = _matrices(flight)
    matrices[:, :3, 3] /= 2.5

    def text(values: np.ndarray) -> str:
        return " ".join(repr(float(value)) for value in np.ravel(values))

    cameras = "".join(
        f'<camera id="{at}" sensor_id="0" label="{at:04d}"><transform>{text(m)}</transform></camera>'
        for at, m in enumerate(matrices)
    )
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="c" enabled="true">'
        '<sensors><sensor id="0"><resolution width="4000" height="3000"/>'
        "<calibration><f>3200</f></calibration></sensor></sensors>"
        f'<cameras>{cameras}<camera id="99" sensor_id="0"/></cameras>'
        f"<transform><rotation>{text(axes)}</rotation>"
        f"<translation>{text(origin)}</translation><scale>2.5</scale></transform></chunk></document>"
    )
    return folder / "cameras.xml", PLACE


def _bundler(folder: Path, flight: Flight) -> Written:
    inverse = (_optical(flight) * Rotation.from_quat([1, 0, 0, 0])).inv()
    shifts = -inverse.apply(flight.positions)
    lines = ["# Bundle file v0.3", f"{len(shifts)} 0"]
    for turn, shift in zip(inverse.as_matrix(), shifts, strict=True):
        lines += ["3200 0 0", *(" ".join(map(repr, map(float, row))) for row in (*turn, shift))]
    (folder / "bundle.out").write_text("\n".join(lines) + "\n")
    return folder / "bundle.out", {"unit_m": 1.0}


def _nvm(folder: Path, flight: Flight) -> Written:
    lines = ["NVM_V3", "", str(len(flight.t_ns))]
    for (_, quat, _, name), centre in zip(_colmap_images(flight), flight.positions, strict=True):
        lines.append(" ".join(map(str, [f"images/{name}", 3200, *quat, *centre, 0, 0])))
    (folder / "model.nvm").write_text("\n".join(lines) + "\n\n0\n")
    return folder / "model.nvm", {"unit_m": 1.0}


def _realitycapture(folder: Path, flight: Flight) -> Written:
    lat, lon, alt, _ = on_earth(flight)
    lines = ["#name,x,y,alt,heading,pitch,roll,f"]
    for at, (yaw, pitch, roll) in enumerate(angles(flight)):
        lines.append(
            f"{at:04d}.jpg,{lon[at]:.10f},{lat[at]:.10f},{alt[at]:.4f},"
            f"{yaw:.4f},{pitch + 90:.4f},{roll:.4f},24"
        )
    (folder / "cameras.csv").write_text("\n".join(lines) + "\n")
    return folder / "cameras.csv", PLACE


def _seconds(t_ns: int) -> str:
    return f"{t_ns // 10**9}.{t_ns % 10**9:09d}"


def _tum(folder: Path, flight: Flight) -> Written:
    rows = zip(flight.t_ns.tolist(), flight.positions, flight.quat_xyzw, strict=True)
    lines = [
        "# timestamp tx ty tz qx qy qz qw",
        *(" ".join(map(str, [_seconds(t), *p, *q])) for t, p, q in rows),
    ]
    (folder / "flight.txt").write_text("\n".join(lines) + "\n")
    return folder / "flight.txt", _CAMERA


def _euroc(folder: Path, flight: Flight) -> Written:
    rows = zip(flight.t_ns.tolist(), flight.positions, flight.quat_xyzw[:, [3, 0, 1, 2]], strict=True)
    lines = [
        "#timestamp, p_RS_R_x [m], q_RS_w []",
        *(",".join(map(str, [t, *p, *q, *[0.0] * 9])) for t, p, q in rows),
    ]
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    return folder / "data.csv", _CAMERA


def _kitti(folder: Path, flight: Flight) -> Written:
    back = Rotation.from_matrix([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # to x right, y down, z forward
    turns = (back * _optical(flight)).as_matrix()
    rows = np.concatenate([turns, back.apply(flight.positions)[:, :, None]], axis=2).reshape(-1, 12)
    np.savetxt(folder / "00.txt", rows, fmt="%.12e")
    np.savetxt(folder / "00_times.txt", (flight.t_ns - flight.t_ns[0]) * 1e-9, fmt="%.9f")
    return folder / "00.txt", {}


def _captions(folder: Path, flight: Flight) -> Written:
    lat, lon, alt, _ = on_earth(flight)
    blocks = []
    for at, (yaw, pitch, roll) in enumerate(angles(flight)):
        ms = round(int(flight.t_ns[at] - flight.t_ns[0]) / 1e6)
        clock = f"{ms // 3_600_000:02d}:{ms // 60_000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"
        date = np.datetime64(int(flight.t_ns[at]), "ns").astype("datetime64[ms]").item()
        height = alt[at] - TAKEOFF_M
        blocks.append(
            f'{at + 1}\n{clock} --> {clock}\n<font size="28">FrameCnt: {at + 1}, DiffTime: 33ms\n'
            f"{date:%Y-%m-%d %H:%M:%S}.{date.microsecond // 1000:03d}\n[focal_len: 24.00] "
            f"[latitude: {lat[at]:.9f}] [longitude: {lon[at]:.9f}] [rel_alt: {height:.3f} abs_alt: 12.0] "
            f"[gb_yaw: {yaw:.2f} gb_pitch: {pitch:.2f} gb_roll: {roll:.2f}]</font>\n"
        )
    (folder / "flight.srt").write_text("\n".join(blocks))
    return folder / "flight.srt", PLACE | {"takeoff_alt_m": TAKEOFF_M}


def _airdata(folder: Path, flight: Flight) -> Written:
    lat, lon, alt, _ = on_earth(flight)
    lines = [
        "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),"
        "gimbal_heading(degrees),gimbal_pitch(degrees)"
    ]
    for at, (yaw, pitch, _) in enumerate(angles(flight)):
        ms = round(int(flight.t_ns[at] - flight.t_ns[0]) / 1e6)
        second = np.datetime64(int(flight.t_ns[at]), "ns").astype("datetime64[s]").item()
        height = (alt[at] - TAKEOFF_M) / 0.3048
        place = f"{lat[at]:.9f},{lon[at]:.9f},{height:.4f}"
        lines.append(f"{ms},{second:%Y-%m-%d %H:%M:%S},{place},{yaw:.3f},{pitch:.3f}")
    (folder / "airdata.csv").write_text("\n".join(lines) + "\n")
    return folder / "airdata.csv", PLACE | {"takeoff_alt_m": TAKEOFF_M}


WRITERS: dict[str, Callable[[Path, Flight], Written]] = {
    "mcap": _mcap, "ros1": _bag1, "ros2": bag2, "ulog": _ulog, "dataflash": _dataflash, "tlog": _tlog,
    "photos": photos, "opensfm": _opensfm, "colmap text": _colmap_text, "colmap binary": _colmap_binary,
    "nerfstudio": _nerfstudio, "metashape": _metashape, "bundler": _bundler, "nvm": _nvm,
    "realitycapture": _realitycapture, "tum": _tum, "euroc": _euroc, "kitti": _kitti, "captions": _captions,
    "airdata": _airdata,
}  # fmt: skip
UNTIMED = ("colmap text", "colmap binary", "nerfstudio", "metashape", "bundler", "nvm", "realitycapture")
