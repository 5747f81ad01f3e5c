"""A log becomes the demonstration that was flown, whatever family of schemas it is written in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_logs import Topic, flight, header, poses, transform, write_log
from scipy.spatial.transform import Rotation

from upplied.errors import InputError
from upplied.geometry.poses import angle_between
from upplied.inputs.logs import LogOptions, read_demonstration
from upplied.records import Lens

FACTS = {
    "schema_version": "1",
    "structure_id": "a320",
    "operator": "Ada",
    "site": "hall 3",
    "body_frame": "camera",
}
SCHEMAS = ["PoseStamped", "PoseWithCovarianceStamped", "TransformStamped"]
SCHEMAS = [f"geometry_msgs/msg/{name}" for name in SCHEMAS] + ["nav_msgs/msg/Odometry"]


def close(quats: np.ndarray, others: np.ndarray) -> bool:
    return bool((angle_between(quats, others) < 1e-6).all())


@pytest.mark.parametrize("schema", SCHEMAS)
def test_poses_come_back(tmp_path: Path, schema: str) -> None:
    flown = flight()
    path = write_log(tmp_path / "left wing.mcap", [poses("/camera/pose", schema, flown)], FACTS)
    actual = read_demonstration(path)
    assert np.array_equal(actual.t_ns, flown.t_ns)
    assert np.array_equal(actual.positions, flown.positions)
    assert close(actual.quat_xyzw, flown.quat_xyzw)
    assert (actual.demonstration_id, actual.structure_id) == ("left-wing", "a320")
    assert (actual.operator, actual.site, actual.topic, actual.clock) == (
        "Ada",
        "hall 3",
        "/camera/pose",
        "header",
    )
    assert not actual.dropped and not actual.degraded and not len(actual.breaks)


def test_a_moved_structure_gives_the_same_poses_in_its_frame(tmp_path: Path) -> None:
    flown, turn, shift = flight(), Rotation.from_euler("xyz", [0.1, -0.2, 2.0]), np.array([30.0, -20.0, 4.0])
    moved = type(flown)(
        flown.t_ns,
        turn.apply(flown.positions) + shift,
        (turn * Rotation.from_quat(flown.quat_xyzw)).as_quat(),
    )
    facts = FACTS | {
        "structure_position_m": " ".join(map(str, shift)),
        "structure_quat_xyzw": " ".join(map(str, turn.as_quat())),
    }
    path = write_log(tmp_path / "a.mcap", [poses("/pose", SCHEMAS[0], moved)], facts)
    actual = read_demonstration(path)
    assert np.allclose(actual.positions, flown.positions, atol=1e-9)
    assert close(actual.quat_xyzw, flown.quat_xyzw)


def test_a_chain_of_transforms_is_composed(tmp_path: Path) -> None:
    flown = flight()
    mount = Rotation.from_euler("zyx", [0.3, 0.2, 0.0])
    offset = np.array([0.2, 0.0, -0.1])
    optical = Rotation.from_euler("ZYX", [-90, 0, -90], degrees=True)
    camera = Rotation.from_quat(flown.quat_xyzw)
    body = camera * mount.inv()
    base = flown.positions - body.apply(offset)
    map_T_odom = (np.array([5.0, 1.0, 0.0]), Rotation.from_euler("z", 0.7))
    odom_p, odom_q = map_T_odom[1].inv().apply(base - map_T_odom[0]), map_T_odom[1].inv() * body
    moving = [
        (int(t), {"transforms": [transform(int(t), "odom", "base_link", p, q)]})
        for t, p, q in zip(flown.t_ns, odom_p, odom_q.as_quat(), strict=True)
    ]
    slow = [
        (int(t), {"transforms": [transform(int(t), "map", "odom", map_T_odom[0], map_T_odom[1].as_quat())]})
        for t in np.append(flown.t_ns[::10], flown.t_ns[-1])
    ]
    first = int(flown.t_ns[0])
    static = [
        transform(0, "base_link", "camera_link", offset, mount.as_quat()),
        transform(0, "camera_link", "camera_optical_frame", np.zeros(3), optical.as_quat()),
    ]
    tf = Topic("/tf", "tf2_msgs/msg/TFMessage", sorted(moving + slow, key=lambda item: item[0]))
    latched = Topic("/tf_static", "tf2_msgs/msg/TFMessage", [(first, {"transforms": static})])
    info = Topic("/camera_info", "sensor_msgs/msg/CameraInfo", [(first, camera_info(first))])
    path = write_log(tmp_path / "a.mcap", [tf, latched, info], {"structure_id": "a320"})
    actual = read_demonstration(path)
    assert np.allclose(actual.positions, flown.positions, atol=1e-9)
    assert close(actual.quat_xyzw, flown.quat_xyzw)
    assert actual.camera.hfov_deg == pytest.approx(90.0)
    assert (actual.camera.min_range_m, actual.camera.max_range_m) == (
        2.0,
        50.0,
    ) and actual.camera.lens is None


@pytest.mark.parametrize(
    ("values", "lens", "note"),
    [
        ({"d": [-0.1, 0.02, 1e-3, -2e-3, 0.004]}, Lens("brown", (-0.1, 0.02, 1e-3, -2e-3, 0.004)), ""),
        ({"d": [0.0] * 5, "k": [320.0, 0, 330, 0, 320.0, 235, 0, 0, 1]},
         Lens("brown", (), (330 / 640, 235 / 480)), ""),
        ({"d": [0.1, 0.0, 0.0, 0.0], "distortion_model": "equidistant"}, Lens("fisheye", (0.1,)), ""),
        ({"d": [0.1] * 14, "distortion_model": "thin_prism"}, None, "14 coefficients"),
        ({"d": [], "distortion_model": ""}, None, ""),
        ({"d": [float("nan")] * 5}, None, "is not used"),
    ],
)  # fmt: skip
def test_a_calibration_says_how_the_lens_distorts(
    tmp_path: Path, values: dict, lens: Lens, note: str
) -> None:
    flown = flight()
    info = [(int(t), camera_info(int(t)) | values) for t in flown.t_ns[::50]]
    topics = [poses("/pose", SCHEMAS[0], flown), Topic("/info", "sensor_msgs/msg/CameraInfo", info)]
    actual = read_demonstration(write_log(tmp_path / "a.mcap", topics, FACTS))
    assert actual.camera.lens == lens and note in actual.notes


def camera_info(t_ns: int) -> dict:
    return {
        "header": header(t_ns, "camera_optical_frame"),
        "width": 640,
        "height": 480,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": [320.0, 0, 320, 0, 320.0, 240, 0, 0, 1],
        "r": [0.0] * 9,
        "p": [0.0] * 12,
    }


def test_the_side_car_wins_over_the_metadata_and_that_over_the_options(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", [poses("/pose", SCHEMAS[0], flight())], FACTS | {"operator": "Ada"})
    path.with_suffix(".toml").write_text(
        '[inspection]\nstructure_id = "b747"\nstructure_position_m = [1, 2, 3]\ncamera_max_range_m = 20\n'
    )
    actual = read_demonstration(path, LogOptions(operator="Bob", site="field", structure_id="x"))
    assert (actual.structure_id, actual.operator, actual.site) == ("b747", "Ada", "hall 3")
    assert actual.camera.max_range_m == 20.0
    assert np.allclose(actual.positions, flight().positions - [1, 2, 3])
    assert "overruled" in actual.notes


def test_bad_samples_are_counted_and_too_many_refused(tmp_path: Path) -> None:
    flown = flight()
    flown.positions[5] = np.nan
    flown.quat_xyzw[7] *= 1.1
    topic = poses("/pose", SCHEMAS[0], flown)
    topic.messages += [topic.messages[20], topic.messages[40]]
    path = write_log(tmp_path / "a.mcap", [topic], FACTS)
    actual = read_demonstration(path)
    assert len(actual) == len(flown.t_ns) - 2
    assert actual.dropped == {"not a number": 1, "quaternion not of unit length": 1, "repeated": 2}
    flown.positions[::10] = np.nan
    path = write_log(tmp_path / "b.mcap", [poses("/pose", SCHEMAS[0], flown)], FACTS)
    with pytest.raises(InputError, match="at most 5%"):
        read_demonstration(path)


def test_several_sources_are_listed_and_one_can_be_named(tmp_path: Path) -> None:
    other = flight(100, 10)
    other.positions += (3.0, 0.0, 0.0)
    topics = [poses("/a/pose", SCHEMAS[0], flight()), poses("/b/odom", SCHEMAS[3], other)]
    path = write_log(tmp_path / "a.mcap", topics, FACTS)
    with pytest.raises(InputError, match=r"/a/pose .*30.0 Hz, 300.*/b/odom .*10.0 Hz, 100"):
        read_demonstration(path)
    assert len(read_demonstration(path, LogOptions(topic="/b/odom"))) == 100


def test_sources_that_tell_the_same_are_one_answer(tmp_path: Path) -> None:
    topics = [poses("/b/odom", SCHEMAS[3], flight(100, 10)), poses("/a/pose", SCHEMAS[0], flight())]
    path = write_log(tmp_path / "a.mcap", topics, FACTS)
    assert read_demonstration(path).topic == "/a/pose"


def test_the_hash_follows_the_log_and_the_facts(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", [poses("/pose", SCHEMAS[0], flight())], FACTS)
    first = read_demonstration(path).sha256
    assert first == read_demonstration(path).sha256
    assert first != read_demonstration(path, LogOptions(camera_max_range_m=20.0)).sha256
