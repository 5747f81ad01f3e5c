"""Small sound inputs of every kind, from which the fuzzer starts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from made_logs import (
    Topic,
    flight,
    foxglove_file,
    header,
    json_topic,
    pose,
    poses,
    protobuf_topic,
    px4,
    transform,
    write_log,
    xyzw,
)
from mcap.writer import CompressionType

FACTS = {
    "schema_version": "1",
    "structure_id": "a320",
    "camera_max_range_m": "40",
    "structure_position_m": "1 2 3",
}
PLACE = {
    "structure_lat_deg": "47",
    "structure_lon_deg": "8",
    "structure_alt_m": "4",
    "structure_heading_deg": "3",
}
SIDECAR = """[inspection]
structure_id = "a320"
body_frame = "body"
body_T_camera_position_m = [0.1, 0, 0]
body_T_camera_quat_xyzw = [0, 0, 0, 1]
start_s = 0.1
topic = "/pose"
"""
MANIFEST = """[[structure]]
id = "a320"
kind = "airliner"
path = "a320.ply"
units = "m"
up = "z"
forward = "+x"
lat_deg = 47.1
lon_deg = 8.5
alt_m = 400.0
heading_deg = 12.0
notes = "x"
"""
TABLE = "id,kind,path,units,up,forward\na320,airliner,a320.ply,m,z,+x\nb747,airliner,b.stl,ft,y,-x\n"


def topics() -> dict[str, list[Topic]]:
    """A few messages of each family."""
    flown = flight(6, 10.0)
    times = [int(t) for t in flown.t_ns]
    tf = [
        (t, {"transforms": [transform(t, "map", "base_link", p, q)]})
        for t, p, q in zip(times, flown.positions, flown.quat_xyzw, strict=True)
    ]
    static = [(times[0], {"transforms": [transform(0, "base_link", "cam_optical", (0, 0, 0), (0, 0, 0, 1))]})]
    stamped: list[tuple[int, Any]] = [
        (t, {"timestamp": {"seconds": t // 10**9, "nanos": t % 10**9}, "frame_id": "map", "pose": pose(p, q)})
        for t, p, q in zip(times, flown.positions, flown.quat_xyzw, strict=True)
    ]
    event = {"start_time": stamped[1][1]["timestamp"], "end_time": stamped[4][1]["timestamp"]}
    info = {
        "header": header(times[0], "cam_optical"),
        "width": 64,
        "height": 48,
        "distortion_model": "plumb_bob",
    }
    info |= {"d": [0.0], "k": [32.0, 0, 32, 0, 32.0, 24, 0, 0, 1], "r": [0.0] * 9, "p": [0.0] * 12}
    fix = [
        (
            t,
            {
                "header": header(t),
                "status": {"status": 0},
                "latitude": 47.0,
                "longitude": 8.0 + i * 1e-6,
                "altitude": 9.0,
            },
        )
        for i, t in enumerate(times)
    ]
    imu = [
        (t, {"header": header(t), "orientation": xyzw((0, 0, 0, 1)), "orientation_covariance": [0.0] * 9})
        for t in times
    ]
    gimbal = [(t, {"timestamp": t // 1000, "device_flags": 16, "q": [1.0, 0, 0, 0]}) for t in times]
    by_name = {
        name: [poses("/pose", f"{package}/msg/{name}", flown)]
        for package, name in (
            ("geometry_msgs", "PoseStamped"),
            ("geometry_msgs", "TransformStamped"),
            ("nav_msgs", "Odometry"),
        )
    }
    json_stamped = [(t, body | {"timestamp": {"sec": t // 10**9, "nsec": t % 10**9}}) for t, body in stamped]
    return by_name | {
        "tf": [
            Topic("/tf", "tf2_msgs/msg/TFMessage", tf),
            Topic("/tf_static", "tf2_msgs/msg/TFMessage", static),
            Topic("/info", "sensor_msgs/msg/CameraInfo", [(times[0], info)]),
        ],
        "px4": [
            Topic(
                "/fmu/out/vehicle_local_position",
                "px4_msgs/msg/VehicleLocalPosition",
                px4(flown, xy_valid=True, z_valid=True),
            ),
            Topic("/fmu/out/vehicle_attitude", "px4_msgs/msg/VehicleAttitude", px4(flown)),
            Topic("/fmu/out/gimbal", "px4_msgs/msg/GimbalDeviceAttitudeStatus", gimbal),
        ],
        "odometry": [
            Topic("/fmu/out/vehicle_odometry", "px4_msgs/msg/VehicleOdometry", px4(flown, pose_frame=1))
        ],
        "fix": [Topic("/fix", "sensor_msgs/msg/NavSatFix", fix), Topic("/imu", "sensor_msgs/msg/Imu", imu)],
        "json": [json_topic("/pose", "foxglove.PoseInFrame", json_stamped)],
        "protobuf": [
            protobuf_topic("/pose", "foxglove.PoseInFrame", foxglove_file(), stamped),
            protobuf_topic("/events", "foxglove.Event", foxglove_file(), [(times[0], event)]),
        ],
    }


def seed_inputs(folder: Path) -> dict[str, bytes]:
    """Name to input: a byte for the kind, then the file. Plain and without CRCs, so that a change tells."""
    plain = {"compression": CompressionType.NONE, "enable_crcs": False}
    inputs = {
        "sidecar": b"S" + SIDECAR.encode(),
        "manifest": b"T" + MANIFEST.encode(),
        "table": b"C" + TABLE.encode(),
    }
    for name, some in topics().items():
        facts = FACTS | (PLACE if name == "fix" else {})
        if name == "fix":
            del facts["structure_position_m"]
        inputs[name] = b"L" + write_log(folder / "seed.mcap", some, facts, **plain).read_bytes()
    some = topics()["PoseStamped"]
    for name, writing in {
        "unchunked": {"use_chunking": False},
        "unindexed": {"use_chunking": False, "use_statistics": False, "use_summary_offsets": False},
        "zstd": {"compression": CompressionType.ZSTD},
        "lz4": {"compression": CompressionType.LZ4},
    }.items():
        inputs[name] = b"L" + write_log(folder / "seed.mcap", some, FACTS, **(plain | writing)).read_bytes()
    (folder / "seed.mcap").unlink()
    return inputs
