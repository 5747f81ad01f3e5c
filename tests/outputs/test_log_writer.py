"""Logs of the sample fleet: what is written is what is read, by our reader and by one that others wrote."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from PIL import Image
from scipy.spatial.transform import Rotation

from upplied.errors import SettingsError
from upplied.geometry.poses import angle_between
from upplied.inputs.logs import read_demonstration
from upplied.inputs.manifests import read_manifest
from upplied.inputs.meshes import read_structure
from upplied.outputs.logs import CAMERA_FRAME, LogFrame, write_log
from upplied.outputs.sample_fleet import FILES, write_sample_fleet
from upplied.records import Camera, Demonstration
from upplied.samples.fleet import member, sample_structures
from upplied.samples.pilot import fly

ENCODINGS = ("pose_stamped", "odometry", "tf")


@pytest.fixture(scope="module")
def flight() -> Demonstration:
    return fly(member("cube-v1").structure, "sides", seed=2, camera=Camera(82.0, 60.0, 1.5, 40.0, 1280, 720))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    names: list[str] = []
    write_sample_fleet(folder, names.append)
    assert len(names) == FILES
    return folder


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("frame", [LogFrame(), LogFrame("world", (-500.0, 3000.0, 12.0), -145.0)])
def test_a_log_gives_the_flight_back(
    tmp_path: Path, flight: Demonstration, encoding: str, frame: LogFrame
) -> None:
    path = write_log(tmp_path / "log.mcap", flight, heavy_topic=False, frame=frame, encoding=encoding)
    read = read_demonstration(path)
    assert np.array_equal(read.t_ns, flight.t_ns)
    assert np.abs(read.positions - flight.positions).max() < 1e-6
    assert angle_between(read.quat_xyzw, flight.quat_xyzw).max() < 1e-6
    for name in ("demonstration_id", "structure_id", "operator", "site", "clock"):
        assert getattr(read, name) == getattr(flight, name), name
    for name in ("hfov_deg", "vfov_deg", "min_range_m", "max_range_m", "width_px", "height_px"):
        assert getattr(read.camera, name) == pytest.approx(getattr(flight.camera, name)), name
    assert not read.degraded
    assert not read.dropped


def test_a_camera_that_sees_all_around_survives(tmp_path: Path, flight: Demonstration) -> None:
    wide = replace(flight, camera=Camera(hfov_deg=360.0, vfov_deg=180.0))
    read = read_demonstration(write_log(tmp_path / "wide.mcap", wide, heavy_topic=False))
    assert read.camera.hfov_deg == pytest.approx(360)
    assert read.camera.vfov_deg == pytest.approx(180)


def test_the_poses_in_the_log_are_not_those_of_the_structure(tmp_path: Path, flight: Demonstration) -> None:
    """The log's frame is really another one: read by rosbags, the camera stands where the frame says."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    frame = LogFrame("map", (5.0, -3.0, 2.0), 90.0)
    path = write_log(tmp_path / "turned.mcap", flight, heavy_topic=False, frame=frame)
    positions = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, _, raw in reader.messages():
            if connection.msgtype == "geometry_msgs/msg/PoseStamped":
                message = reader.deserialize(raw, connection.msgtype)
                positions.append([message.pose.position.x, message.pose.position.y, message.pose.position.z])
                assert message.header.frame_id == "map"
    x, y, z = flight.positions.T
    assert np.allclose(positions, np.column_stack([-y + 5.0, x - 3.0, z + 2.0]))


def test_the_static_transform_is_that_of_an_optical_frame(tmp_path: Path, flight: Demonstration) -> None:
    from mcap_ros2.decoder import DecoderFactory

    path = write_log(tmp_path / "log.mcap", flight, heavy_topic=False)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        (static,) = _decoded(reader, "/tf_static")
    turn = static.transforms[0].transform.rotation
    matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    assert static.transforms[0].child_frame_id == CAMERA_FRAME
    # Columns: the optical frame's right, down and forward, in x forward, y left, z up.
    assert np.allclose(matrix, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def _decoded(reader: object, topic: str) -> list:
    return [row[3] for row in reader.iter_decoded_messages(topics=[topic])]  # type: ignore[attr-defined]


def test_the_heavy_topic_shows_what_the_camera_sees(tmp_path: Path, flight: Demonstration) -> None:
    from mcap_ros2.decoder import DecoderFactory

    structure = member("cube-v1").structure
    path = write_log(tmp_path / "seen.mcap", flight, structure)
    blind = write_log(tmp_path / "blind.mcap", flight)
    assert read_demonstration(path).positions.shape == read_demonstration(blind).positions.shape
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = _decoded(reader, "/camera/image/compressed")
    assert len(messages) > 20
    picture = np.asarray(Image.open(io.BytesIO(bytes(messages[0].data))), float)
    top, middle = picture[:8].mean(axis=(0, 1)), picture[90:100, 90:100].mean(axis=(0, 1))
    assert np.ptp(middle) < 20, "the grey wall fills the middle"
    assert top[2] > top[0] + 15 or np.ptp(top) < 20


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_bytes_depend_on_the_flight_alone(tmp_path: Path, flight: Demonstration, encoding: str) -> None:
    structure = member("cube-v1").structure
    one = write_log(tmp_path / "one.mcap", flight, structure, encoding=encoding).read_bytes()
    two = write_log(tmp_path / "two.mcap", flight, structure, encoding=encoding).read_bytes()
    assert one == two


def test_an_unknown_encoding_is_named(tmp_path: Path, flight: Demonstration) -> None:
    with pytest.raises(SettingsError, match="encoding 'ros1'"):
        write_log(tmp_path / "x.mcap", flight, heavy_topic=False, encoding="ros1")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_sample_fleet_reads_back(fleet: Path) -> None:
    entries = read_manifest(fleet / "structures.toml")
    samples = {structure.structure_id: structure for structure in sample_structures()}
    assert [entry.structure_id for entry in entries] == list(samples)
    assert {entry.path.suffix for entry in entries} == {".ply", ".glb", ".stl", ".obj"}
    for entry in entries:
        read, sample = read_structure(entry), samples[entry.structure_id]
        assert len(read.triangles) == len(sample.triangles)
        assert np.abs(read.vertices.min(axis=0) - sample.vertices.min(axis=0)).max() < 1e-4
        assert np.abs(read.vertices.max(axis=0) - sample.vertices.max(axis=0)).max() < 1e-4
        corners = [one.vertices[one.triangles].mean(axis=(0, 1)) for one in (read, sample)]
        assert np.allclose(*corners, atol=1e-3)
        assert read.kind == sample.kind
        assert read.site == sample.site
        assert read.placement is not None
        assert sample.placement is not None
        assert read.placement.heading_deg == sample.placement.heading_deg
        assert read.surroundings.ground_z_m == 0.0
        assert list(read.landmarks) == list(sample.landmarks)
        for name, place in sample.landmarks.items():
            assert read.landmarks[name] == pytest.approx(place, abs=1e-3)


@pytest.mark.ci
def test_the_sample_logs_read_back_and_are_small(fleet: Path) -> None:
    logs = sorted((fleet / "logs").glob("*.mcap"))
    assert len(logs) == 7
    for log in logs:
        flight = read_demonstration(log)
        assert flight.demonstration_id == log.stem
        assert flight.structure_id in {structure.structure_id for structure in sample_structures()}
    assert sum(file.stat().st_size for file in fleet.rglob("*") if file.is_file()) < 30e6
