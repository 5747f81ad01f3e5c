"""One flight told by every family of schemas gives one and the same demonstration."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pymap3d
import pytest
import zstandard
from made_logs import (
    ROS2,
    Flight,
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
    xyz,
    xyzw,
)
from mcap_ros2._dynamic import serialize_dynamic
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.poses import angle_between, from_yaw_pitch
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.records import Demonstration, Placement

FACTS = {"structure_id": "a320", "body_frame": "camera"}
BODY = {"structure_id": "a320"}
PLACE = {
    "structure_lat_deg": "47.3",
    "structure_lon_deg": "8.5",
    "structure_alt_m": "450",
    "structure_heading_deg": "30",
    "structure_datum": "ellipsoid",
}


def assert_flown(actual: Demonstration, flown: Flight, metres: float = 1e-9, radians: float = 1e-6) -> None:
    """The same poses at the same times."""
    index = np.searchsorted(actual.t_ns, flown.t_ns)
    assert np.array_equal(actual.t_ns[index], flown.t_ns)
    assert np.abs(actual.positions[index] - flown.positions).max() <= metres
    assert angle_between(actual.quat_xyzw[index], flown.quat_xyzw).max() <= radians


def stamped(flown: Flight, key: str = "nsec") -> list[tuple[int, dict]]:
    """The flight as foxglove.PoseInFrame."""
    sec = "sec" if key == "nsec" else "seconds"
    return [
        (
            int(t),
            {"timestamp": {sec: int(t // 10**9), key: int(t % 10**9)}, "frame_id": "map", "pose": pose(p, q)},
        )
        for t, p, q in zip(flown.t_ns, flown.positions, flown.quat_xyzw, strict=True)
    ]


def test_foxglove_json(tmp_path: Path) -> None:
    flown = flight()
    path = write_log(
        tmp_path / "a.mcap", [json_topic("/pose", "foxglove.PoseInFrame", stamped(flown))], FACTS
    )
    assert_flown(read_demonstration(path), flown)


def test_foxglove_protobuf(tmp_path: Path) -> None:
    flown = flight()
    topic = protobuf_topic("/pose", "foxglove.PoseInFrame", foxglove_file(), stamped(flown, "nanos"))
    del topic.messages[3][1]["pose"]  # an absent pose is no pose at the origin
    actual = read_demonstration(write_log(tmp_path / "a.mcap", [topic], FACTS))
    assert actual.dropped == {"not a number": 1}
    keep = np.arange(len(flown.t_ns)) != 3
    assert_flown(actual, Flight(flown.t_ns[keep], flown.positions[keep], flown.quat_xyzw[keep]))


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_foxglove_transforms_and_calibration(tmp_path: Path, encoding: str) -> None:
    flown = flight()
    optical = Rotation.from_quat(flown.quat_xyzw) * Rotation.from_euler("ZYX", [-90, 0, -90], degrees=True)
    key = "nsec" if encoding == "json" else "nanos"
    messages = []
    for (t, content), p, q in zip(stamped(flown, key), flown.positions, optical.as_quat(), strict=True):
        link = {"parent_frame_id": "map", "child_frame_id": "cam", "translation": xyz(p), "rotation": xyzw(q)}
        messages.append((t, {"transforms": [link | {"timestamp": content["timestamp"]}]}))
    info = {"frame_id": "cam", "width": 100, "height": 50, "distortion_model": "plumb_bob"}
    calibration = [(messages[0][0], info | {"K": [50.0, 0, 50, 0, 50.0, 25, 0, 0, 1]})]
    names = ("foxglove.FrameTransforms", "foxglove.CameraCalibration")
    if encoding == "json":
        topics = [json_topic("/tf", names[0], messages), json_topic("/cal", names[1], calibration)]
    else:
        file = foxglove_file()
        topics = [
            protobuf_topic("/tf", names[0], file, messages),
            protobuf_topic("/cal", names[1], file, calibration),
        ]
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, {"structure_id": "a320"}))
    assert_flown(actual, flown)
    assert actual.camera.hfov_deg == pytest.approx(90.0)
    assert actual.camera.vfov_deg == pytest.approx(2 * np.degrees(np.arctan(0.5)))


def test_ros1(tmp_path: Path) -> None:
    flown = flight()
    text = (
        "Header header\nPose pose\n" + "=" * 80 + "\nMSG: std_msgs/Header\n"
        + "uint32 seq\ntime stamp\nstring frame_id\n"
        + "=" * 80 + "\nMSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n"
        + "=" * 80 + "\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
        + "=" * 80 + "\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    )  # fmt: skip

    def encode(row: tuple) -> bytes:
        seq, t, p, q = row
        frame = b"map" if seq % 3 else b"/map"
        return (
            struct.pack("<IIII", seq, t // 10**9, t % 10**9, len(frame)) + frame + struct.pack("<7d", *p, *q)
        )

    rows = [
        (int(t), (seq, int(t), p, q))
        for seq, (t, p, q) in enumerate(zip(flown.t_ns, flown.positions, flown.quat_xyzw, strict=True))
    ]
    topic = Topic("/pose", "geometry_msgs/PoseStamped", rows, ("ros1", "ros1msg"), text.encode(), encode)
    assert_flown(read_demonstration(write_log(tmp_path / "a.mcap", [topic], FACTS)), flown)


@pytest.mark.parametrize("suffix", ["", "_v1"])
def test_px4_odometry(tmp_path: Path, suffix: str) -> None:
    flown = flight()
    topic = Topic(
        f"/fmu/out/vehicle_odometry{suffix}", "px4_msgs/msg/VehicleOdometry", px4(flown, pose_frame=1)
    )
    topic.messages[9][1]["position"] = [np.nan] * 3
    topic.messages[10][1]["q"] = [np.nan, 0, 0, 0]
    for _, content in topic.messages[100:]:
        content["reset_counter"] = 1
    actual = read_demonstration(write_log(tmp_path / "a.mcap", [topic], FACTS))
    keep = np.r_[0:9, 11:300]
    flown = Flight(flown.t_ns[keep] // 1000 * 1000, flown.positions[keep], flown.quat_xyzw[keep])
    assert_flown(actual, flown, 2e-6, 1e-3)
    assert actual.dropped == {"not a number": 2}
    assert actual.breaks.tolist() == [98]
    assert "1 estimator reset" in actual.notes


def px4_wind(t_ns: int, east: float, north: float) -> dict:
    return {"timestamp": t_ns // 1000, "windspeed_north": north, "windspeed_east": east}


def mavros_wind(t_ns: int, east: float, north: float) -> dict:
    linear = {"linear": xyz((east, north, 0.0)), "angular": xyz((0.0, 0.0, 0.0))}
    return {"header": header(t_ns), "twist": {"twist": linear, "covariance": [0.0] * 36}}


TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"


@pytest.mark.parametrize(
    ("topic", "schema", "message_of"),
    [
        ("/fmu/out/wind", "px4_msgs/msg/Wind", px4_wind),
        ("/mavros/wind_estimation", TWIST, mavros_wind),
    ],
)
def test_the_wind_is_read_where_it_is_logged(tmp_path: Path, topic: str, schema: str, message_of) -> None:
    flown = flight()
    times = [int(t) for t in flown.t_ns[::10]]
    blown = [message_of(t, 3.0 * (1 + (at == 4)), 4.0 * (1 + (at == 4))) for at, t in enumerate(times)]
    # before the flight, a diverged estimate, and none
    more = [
        (times[0] - 10**9, message_of(times[0] - 10**9, 50.0, 0.0)),
        (times[3] + 1, message_of(times[3], 1e4, 0.0)),
    ]
    more.append((times[5] + 1, message_of(times[5], np.nan, 0.0)))
    wind = Topic(topic, schema, sorted([*zip(times, blown, strict=True), *more], key=lambda each: each[0]))
    body = poses("/pose", "geometry_msgs/msg/PoseStamped", flown)
    estimate = read_demonstration(write_log(tmp_path / "a.mcap", [body, wind], FACTS | PLACE)).wind
    assert estimate is not None and estimate.topic == topic
    assert estimate.mean_mps == pytest.approx(5.0 * 31 / 30) and estimate.most_mps == pytest.approx(10.0)
    # towards 36.87 deg from north; +X of the structure is at 30: clockwise of it
    assert estimate.towards_deg == pytest.approx(360 + 30 - np.degrees(np.arctan2(3.0, 4.0)))
    unplaced = read_demonstration(write_log(tmp_path / "b.mcap", [body, wind], FACTS)).wind
    assert unplaced is not None and unplaced.towards_deg is None


def test_a_log_without_wind_says_so(tmp_path: Path) -> None:
    flown = flight()
    times = [int(t) for t in flown.t_ns[::10]]
    body = poses("/pose", "geometry_msgs/msg/PoseStamped", flown)
    # the vehicle's own velocity is no wind, nor is an estimate that never began
    own = Topic("/mavros/velocity", TWIST, [(t, mavros_wind(t, 3.0, 4.0)) for t in times])
    zero = Topic("/fmu/out/wind", "px4_msgs/msg/Wind", [(t, px4_wind(t, 0.0, 0.0)) for t in times])
    for topics in ([body], [body, own], [body, zero]):
        assert read_demonstration(write_log(tmp_path / "a.mcap", topics, FACTS)).wind is None


def test_px4_odometry_of_arbitrary_heading_is_turned_to_z_up(tmp_path: Path) -> None:
    flown = flight()
    turn = Rotation.from_euler("z", -90, degrees=True)  # x y of FRD are x, -y of a frame with z up
    messages = px4(flown, pose_frame=2)
    actual = read_demonstration(
        write_log(tmp_path / "a.mcap", [Topic("/o", "px4_msgs/msg/VehicleOdometry", messages)], FACTS)
    )
    assert np.allclose(actual.positions, turn.apply(flown.positions), atol=2e-6)
    assert (
        angle_between(actual.quat_xyzw, (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat()).max() < 1e-3
    )


def test_px4_position_joined_with_attitude(tmp_path: Path) -> None:
    flown = flight()
    position = Topic("/fmu/out/vehicle_local_position", "px4_msgs/msg/VehicleLocalPosition")
    position.messages = px4(flown, xy_valid=True, z_valid=True)[::3]
    position.messages[5][1]["xy_valid"] = False
    denser = flight(900, 90.0)
    attitude = Topic("/fmu/out/vehicle_attitude", "px4_msgs/msg/VehicleAttitude", px4(denser))
    actual = read_demonstration(write_log(tmp_path / "a.mcap", [position, attitude], FACTS))
    keep = np.delete(np.arange(0, 300, 3), 5)
    flown = Flight(flown.t_ns[keep] // 1000 * 1000, flown.positions[keep], flown.quat_xyzw[keep])
    assert_flown(actual, flown, 2e-6, 1e-3)
    assert actual.dropped == {"no valid position": 1}


def test_px4_position_without_attitude_is_refused(tmp_path: Path) -> None:
    topic = Topic("/lp", "px4_msgs/msg/VehicleLocalPosition", px4(flight(), xy_valid=True, z_valid=True))
    with pytest.raises(InputError, match="VehicleAttitude"):
        read_demonstration(write_log(tmp_path / "a.mcap", [topic], FACTS))


def geodetic(flown: Flight) -> tuple[np.ndarray, Rotation]:
    """Latitude, longitude, altitude of a flight around the structure at PLACE, and its frame in ENU."""
    turn = Rotation.from_euler("z", 60.0, degrees=True)  # heading 30 is 60 degrees from east
    enu = turn.apply(flown.positions)
    place = (
        float(PLACE["structure_lat_deg"]),
        float(PLACE["structure_lon_deg"]),
        float(PLACE["structure_alt_m"]),
    )
    return np.column_stack(pymap3d.enu2geodetic(*enu.T, *place)), turn


def test_satellite_fixes_with_an_imu(tmp_path: Path) -> None:
    flown = flight()
    places, turn = geodetic(flown)
    enu = (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat()
    fixes = [
        (
            int(t),
            {
                "header": header(int(t), "gps"),
                "status": {"status": 0},
                "latitude": a,
                "longitude": b,
                "altitude": c,
            },
        )
        for t, (a, b, c) in zip(flown.t_ns, places, strict=True)
    ]
    fixes[7][1]["status"]["status"] = -1
    turns = [
        (
            int(t),
            {"header": header(int(t), "imu"), "orientation": xyzw(q), "orientation_covariance": [0.0] * 9},
        )
        for t, q in zip(flown.t_ns, enu, strict=True)
    ]
    raw = [
        (t, content | {"orientation_covariance": [-1.0] + [0.0] * 8, "orientation": xyzw([0, 0, 0, 1])})
        for t, content in turns
    ]
    topics = [
        Topic("/fix", "sensor_msgs/msg/NavSatFix", fixes),
        Topic("/imu/data", "sensor_msgs/msg/Imu", turns),
        Topic("/imu/data_raw", "sensor_msgs/msg/Imu", raw),
    ]
    path = write_log(tmp_path / "a.mcap", topics, FACTS | PLACE)
    actual = read_demonstration(path)
    keep = np.delete(np.arange(300), 7)
    assert_flown(actual, Flight(flown.t_ns[keep], flown.positions[keep], flown.quat_xyzw[keep]), 1e-4, 1e-5)
    assert actual.dropped == {"no fix": 1}
    with pytest.raises(InputError, match="structure's place is unknown"):
        read_demonstration(write_log(tmp_path / "b.mcap", topics, FACTS))
    with pytest.raises(InputError, match="geoid_undulation_m"):
        read_demonstration(
            write_log(tmp_path / "c.mcap", topics, FACTS | PLACE | {"structure_datum": "amsl"})
        )
    stands = Placement(47.3, 8.5, 450.0, 30.0)
    other = read_demonstration(tmp_path / "b.mcap", placements={"a320": stands, "b747": stands})
    assert np.array_equal(other.positions, actual.positions)
    lifted = FACTS | PLACE | {"structure_datum": "amsl", "structure_alt_m": "402", "geoid_undulation_m": "48"}
    assert np.allclose(
        read_demonstration(write_log(tmp_path / "d.mcap", topics, lifted)).positions, actual.positions
    )
    with pytest.raises(InputError, match="km from the structure"):
        read_demonstration(
            write_log(tmp_path / "e.mcap", topics, FACTS | PLACE | {"structure_lat_deg": "-47.3"})
        )


def test_px4_global_position_is_used_where_the_structure_is_placed(tmp_path: Path) -> None:
    flown = flight()
    places, turn = geodetic(flown)
    enu = Flight(
        flown.t_ns, turn.apply(flown.positions), (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat()
    )
    messages = [
        (
            t,
            content
            | {
                "lat": a,
                "lon": b,
                "alt": c - 48,
                "alt_ellipsoid": c,
                "lat_lon_valid": True,
                "alt_valid": True,
            },
        )
        for (t, content), (a, b, c) in zip(px4(enu), places, strict=True)
    ]
    topics = [
        Topic("/fmu/out/vehicle_global_position", "px4_msgs/msg/VehicleGlobalPosition", messages),
        Topic("/fmu/out/vehicle_attitude", "px4_msgs/msg/VehicleAttitude", px4(enu)),
        Topic("/fmu/out/vehicle_odometry", "px4_msgs/msg/VehicleOdometry", px4(flight(), pose_frame=1)),
    ]
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, FACTS | PLACE))
    flown = Flight(flown.t_ns // 1000 * 1000, flown.positions, flown.quat_xyzw)
    assert_flown(actual, flown, 5e-3, 1e-3)  # PX4's altitudes are of single precision
    assert actual.topic == "/fmu/out/vehicle_global_position"


@pytest.mark.parametrize("maker", ["px4", "mavros"])
@pytest.mark.parametrize("flags", [16, 64, 32, 0])
def test_a_gimbal_turns_the_camera(tmp_path: Path, maker: str, flags: int) -> None:
    """A level body that looks anywhere, and a gimbal whose yaw counts from north or from the body."""
    flown = flight()
    t_s = (flown.t_ns - flown.t_ns[0]) * 1e-9
    yaw = 0.4 * t_s
    body = Flight(flown.t_ns, flown.positions, from_yaw_pitch(yaw, np.zeros(len(yaw))))
    from_north = flags in (16, 64)
    relative = Rotation.from_quat(flown.quat_xyzw)
    if not from_north:
        relative = Rotation.from_euler("z", -yaw[:, None]) * relative
    half = np.sqrt(0.5)
    left = Rotation.from_quat([half, half, 0, 0]) if from_north else Rotation.from_quat([1, 0, 0, 0])
    frd = (left * relative * Rotation.from_quat([1, 0, 0, 0])).as_quat()
    if maker == "px4":
        statuses = [
            (int(t), {"timestamp": int(t) // 1000, "device_flags": flags, "q": [q[3], *q[:3]]})
            for t, q in zip(flown.t_ns, frd, strict=True)
        ]
    else:
        statuses = [
            (int(t), {"header": header(int(t), "base_link_frd"), "flags": flags, "q": xyzw(q)})
            for t, q in zip(flown.t_ns, frd, strict=True)
        ]
    topics = [
        poses("/pose", "geometry_msgs/msg/PoseStamped", body),
        Topic("/gimbal", f"{maker}_msgs/msg/GimbalDeviceAttitudeStatus", statuses),
    ]
    offset = {"body_T_camera_position_m": "0 0 -0.2"}
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, BODY | offset))
    lowered = Flight(flown.t_ns, flown.positions - (0, 0, 0.2), flown.quat_xyzw)
    assert_flown(actual, lowered, 1e-9, 1e-3)
    assert "gimbal of /gimbal" in actual.notes


def test_a_gimbal_in_the_transforms_turns_the_camera(tmp_path: Path) -> None:
    flown = flight()
    t_s = (flown.t_ns - flown.t_ns[0]) * 1e-9
    body = Rotation.from_euler("z", 0.4 * t_s[:, None])
    optical = Rotation.from_quat(flown.quat_xyzw) * Rotation.from_euler("ZYX", [-90, 0, -90], degrees=True)
    joint = (body.inv() * optical).as_quat()
    links = [
        (int(t), {"transforms": [transform(int(t), "base_link", "camera_optical_frame", (0.1, 0, 0), q)]})
        for t, q in zip(flown.t_ns, joint, strict=True)
    ]
    base = Flight(flown.t_ns, flown.positions - body.apply([0.1, 0, 0]), body.as_quat())
    topics = [
        poses("/odom", "nav_msgs/msg/Odometry", base),
        Topic("/tf", "tf2_msgs/msg/TFMessage", links),
    ]
    facts = BODY | {"camera_frame_id": "camera_optical_frame"}
    assert_flown(read_demonstration(write_log(tmp_path / "a.mcap", topics, facts)), flown, 1e-9, 1e-6)


def test_the_mount_in_the_facts_is_applied(tmp_path: Path) -> None:
    flown = flight()
    mount, offset = Rotation.from_euler("zyx", [0.5, 0.3, 0]), np.array([0.3, 0.1, -0.1])
    body = Rotation.from_quat(flown.quat_xyzw) * mount.inv()
    base = Flight(flown.t_ns, flown.positions - body.apply(offset), body.as_quat())
    options = LogOptions(
        structure_id="a320",
        body_T_camera_position_m=tuple(offset),
        body_T_camera_quat_xyzw=tuple(mount.as_quat()),
    )
    path = write_log(tmp_path / "a.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", base)])
    assert_flown(read_demonstration(path, options), flown)


@pytest.mark.parametrize("kind", ["event", "options", "metadata"])
def test_the_inspection_is_cut_out(tmp_path: Path, kind: str) -> None:
    flown = flight()
    start, stop = int(flown.t_ns[60]), int(flown.t_ns[240])
    topics, facts, options = (
        [poses("/pose", "geometry_msgs/msg/PoseStamped", flown)],
        dict(FACTS),
        LogOptions(),
    )
    if kind == "event":
        events = []
        for a, b, word in ((0, 299, "flight"), (60, 240, "inspection")):
            times = [
                {"seconds": int(flown.t_ns[i] // 10**9), "nanos": int(flown.t_ns[i] % 10**9)} for i in (a, b)
            ]
            content = {
                "start_time": times[0],
                "end_time": times[1],
                "metadata": [{"key": "phase", "value": word}],
            }
            events.append((stop, content))
        topics.append(protobuf_topic("/events", "foxglove.Event", foxglove_file(), events))
    elif kind == "options":
        options = LogOptions(start_s=2.0, stop_s=8.0)
    else:
        facts |= {"start_ns": str(start), "end_ns": str(stop)}
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, facts), options)
    assert (actual.t_ns[0], actual.t_ns[-1]) == (start, stop)
    assert "181 of 300" in actual.notes


def test_a_log_of_one_pose_a_second_has_no_gaps_but_where_it_was_silent(tmp_path: Path) -> None:
    flown = flight()
    slowly = Flight(flown.t_ns[0] + np.arange(len(flown.t_ns)) * 10**9, flown.positions, flown.quat_xyzw)
    actual = read_demonstration(
        write_log(tmp_path / "slow.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", slowly)], FACTS)
    )
    assert not len(actual.breaks) and "gap" not in actual.notes
    silent = Flight(
        slowly.t_ns + np.where(np.arange(len(flown.t_ns)) >= 9, 4 * 10**9, 0),
        flown.positions,
        flown.quat_xyzw,
    )
    actual = read_demonstration(
        write_log(tmp_path / "gap.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", silent)], FACTS)
    )
    assert actual.breaks.tolist() == [9] and "1 gap" in actual.notes


def test_gaps_jumps_and_resets_break_the_flight(tmp_path: Path) -> None:
    flown = flight(400)
    flown.positions[100:] += (4.0, 0, 0)
    keep = np.r_[0:200, 230:400]
    flown = Flight(flown.t_ns[keep], flown.positions[keep], flown.quat_xyzw[keep])
    actual = read_demonstration(
        write_log(tmp_path / "a.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", flown)], FACTS)
    )
    assert actual.breaks.tolist() == [100, 200]
    assert "1 gap" in actual.notes and "1 jump" in actual.notes


def test_a_fast_flight_does_not_jump(tmp_path: Path) -> None:
    flown = flight()
    t_s = (flown.t_ns - flown.t_ns[0]) * 1e-9
    flown.positions[:, 0] = 25.0 * t_s
    actual = read_demonstration(
        write_log(tmp_path / "a.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", flown)], FACTS)
    )
    assert not len(actual.breaks)


def test_messages_that_the_recorder_compressed_are_unwrapped(tmp_path: Path) -> None:
    flown = flight()
    topic = poses("/pose", "geometry_msgs/msg/PoseStamped", flown)
    encode = serialize_dynamic(topic.schema, ROS2[topic.schema])[topic.schema]
    packer = zstandard.ZstdCompressor()
    topic.definition, topic.encode = (
        ROS2[topic.schema].encode(),
        lambda content: packer.compress(encode(content)),
    )
    assert_flown(read_demonstration(write_log(tmp_path / "a.mcap", [topic], FACTS)), flown)


def test_a_boot_clock_is_kept_and_a_dead_one_passed_over(tmp_path: Path) -> None:
    booted = flight(start_ns=5_000_000_000)
    actual = read_demonstration(
        write_log(tmp_path / "a.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", booted)], FACTS)
    )
    assert actual.clock == "header" and actual.t_ns[0] == 5_000_000_000
    topic = poses("/pose", "geometry_msgs/msg/PoseStamped", flight())
    for _, content in topic.messages:
        content["header"] = header(0)
    actual = read_demonstration(write_log(tmp_path / "b.mcap", [topic], FACTS))
    assert actual.clock == "publish" and np.array_equal(actual.t_ns, flight().t_ns)


def test_a_lone_sample_off_the_flight_is_dropped(tmp_path: Path) -> None:
    flown = flight()
    flown.positions[50] += (30.0, 0, 0)
    actual = read_demonstration(
        write_log(tmp_path / "a.mcap", [poses("/pose", "geometry_msgs/msg/PoseStamped", flown)], FACTS)
    )
    assert actual.dropped == {"far off its neighbours": 1} and not len(actual.breaks)


@pytest.mark.parametrize("drifts", [True, False])
def test_poses_come_into_the_frame_in_which_the_structure_is_placed(tmp_path: Path, drifts: bool) -> None:
    """A localisation corrects the drift of an odometry, ten times slower than that reports."""
    flown = flight()
    t_s = (flown.t_ns - flown.t_ns[0]) * 1e-9
    drift = Rotation.from_euler("z", (0.3 + (0.02 * t_s if drifts else 0 * t_s))[:, None])
    shift = np.array([1.0, 2.0, 0.0])
    odom = Flight(
        flown.t_ns,
        drift.inv().apply(flown.positions - shift),
        (drift.inv() * Rotation.from_quat(flown.quat_xyzw)).as_quat(),
    )
    corrections = [
        (int(t), {"transforms": [transform(int(t), "map", "odom", shift, q)]})
        for t, q in zip(flown.t_ns, drift.as_quat(), strict=True)
    ]
    topics = [
        poses("/odom", "nav_msgs/msg/Odometry", odom, "odom"),
        Topic("/tf", "tf2_msgs/msg/TFMessage", corrections[::10] + corrections[-1:]),
    ]
    facts = FACTS | {"frame_id": "map", "structure_position_m": "0 0 0"}
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, facts))
    assert_flown(actual, flown, 1e-3, 1e-6)
    with pytest.raises(InputError, match="frame 'odom', the structure is placed in 'map'"):
        read_demonstration(write_log(tmp_path / "b.mcap", topics[:1], facts))


def test_an_estimate_that_begins_late_is_no_fault_of_the_log(tmp_path: Path) -> None:
    flown = flight()
    topic = Topic("/lp", "px4_msgs/msg/VehicleLocalPosition", px4(flown, xy_valid=True, z_valid=True))
    for _, content in topic.messages[:100]:
        content["xy_valid"] = False
    attitude = Topic("/att", "px4_msgs/msg/VehicleAttitude", px4(flown)[:280])
    actual = read_demonstration(write_log(tmp_path / "a.mcap", [topic, attitude], FACTS))
    assert len(actual) == 183  # the last attitude is held for a tenth of a second
    assert actual.dropped == {
        "no valid position yet or any more": 100,
        "no attitude yet or any more": 17,
    }


def test_a_single_transform_a_message_is_read(tmp_path: Path) -> None:
    flown = flight()
    messages = [
        (t, {"timestamp": content["timestamp"], "parent_frame_id": "map", "child_frame_id": "drone"})
        for t, content in stamped(flown)
    ]
    for (_, content), p, q in zip(messages, flown.positions, flown.quat_xyzw, strict=True):
        content |= {"translation": xyz(p), "rotation": xyzw(q)}
    path = write_log(tmp_path / "a.mcap", [json_topic("/tf", "foxglove.FrameTransform", messages)], FACTS)
    assert_flown(read_demonstration(path), flown)
