"""Every mission format, read back by software of others; where there is none, against published tables."""

from __future__ import annotations

import csv
import io
import itertools
import json
import shutil
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_missions import made_plan, placed_box, turning_on_the_spot

from upplied.errors import RefusedError, SettingsError
from upplied.outputs.missions import FORMATS, MissionOptions, export, missions_of
from upplied.outputs.missions.flying import Flying
from upplied.outputs.missions.records import from_geodetic
from upplied.records import Camera

WPML = "{http://www.dji.com/wpmz/1.0.2}"
KML = "{http://www.opengis.net/kml/2.2}"


def written(tmp_path, name, options=None, **changes):
    goal = tmp_path / f"mission{FORMATS[name]}"
    files = export(made_plan(**changes), placed_box(), name, goal, options)
    return files, files.paths[0]


@pytest.fixture
def mission():
    return missions_of(made_plan(), placed_box(), MissionOptions())[0]


@pytest.fixture(scope="module")
def mavsdk_importer():
    """MAVSDK's importer, without a drone: one heartbeat makes it believe in one."""
    mavsdk = pytest.importorskip("mavsdk", reason="mavsdk is not installed")
    mavutil = pytest.importorskip("pymavlink.mavutil", reason="pymavlink is not installed")
    from mavsdk.plugins.mission_raw import MissionRaw

    sender = mavutil.mavlink.MAVLink(io.BytesIO(), srcSystem=1, srcComponent=1)
    beat = sender.heartbeat_encode(2, 12, 0, 0, 4).pack(sender)
    with mavsdk.Mavsdk(
        mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    ) as link:
        link.add_any_connection("raw://")
        for _ in range(20):
            link.pass_received_raw_bytes(beat)
            system = link.first_autopilot(0.2)
            if system is not None:
                break
        assert system is not None
        yield MissionRaw(system).import_qgroundcontrol_mission_from_string


FENCE = np.array([[-60.0, -60.0], [60.0, -60.0], [60.0, 60.0], [-60.0, 60.0]])
BOX = np.array([[40.0, 40.0, 0.0], [45.0, 50.0, 9.0]])


def test_the_autopilot_gets_the_fence_of_the_manifest(tmp_path, mavsdk_importer, mission):
    """The polygon and the box as items of the fence; a box that is flown over is no fence, and said."""
    x, y = mission.local[len(mission) // 2, :2]
    below = np.array([[x - 0.3, y - 0.3, 0.0], [x + 0.3, y + 0.3, 0.1]])
    structure = placed_box(geofence_m=FENCE, keep_out_m=np.stack([BOX, below]))
    files = export(made_plan(), structure, "qgc-plan", tmp_path / "a.plan")
    items = mavsdk_importer(files.paths[0].read_text()).geofence_items
    assert [(item.command, item.param1) for item in items] == [(5001, 4.0)] * 4 + [(5002, 4.0)] * 4
    places = np.array([[item.x, item.y] for item in items]) * 1e-7
    altitude = np.full(len(places), structure.placement.alt_m)
    local = from_geodetic(np.column_stack([places, altitude]), structure.placement)[:, :2]
    assert np.allclose(local[:4], FENCE, atol=0.02)
    assert np.allclose([local[4:].min(axis=0), local[4:].max(axis=0)], BOX[:, :2], atol=0.02)
    assert any("1 keep-out boxes are not in the fence" in note for note in files.notes)
    files = export(made_plan(), structure, "mavlink", tmp_path / "a.waypoints")
    rows = [line.split("\t") for line in files.paths[1].read_text().splitlines()[1:]]
    assert files.paths[1].name == "a.fence.waypoints"
    assert [int(row[3]) for row in rows] == [item.command for item in items]
    assert np.allclose([[float(value) for value in row[8:10]] for row in rows], places, atol=2e-7)


def test_the_autopilot_gets_the_rally_points_of_the_manifest(tmp_path, mavsdk_importer, mission):
    """In the plan, and in a file beside a MAVLink mission: places, and heights over home."""
    rally = np.array([[-30.0, 20.0, 9.0], [25.0, -18.0, 11.5]])
    structure = placed_box(rally_m=rally)
    files = export(made_plan(), structure, "qgc-plan", tmp_path / "a.plan")
    items = mavsdk_importer(files.paths[0].read_text()).rally_items
    assert [(item.command, item.frame) for item in items] == [(5100, 3)] * 2
    places = np.array([[item.x, item.y] for item in items]) * 1e-7
    altitude = np.full(len(places), structure.placement.alt_m)
    local = from_geodetic(np.column_stack([places, altitude]), structure.placement)[:, :2]
    assert np.allclose(local, rally[:, :2], atol=0.02)
    assert np.allclose([item.z for item in items], rally[:, 2] - files.missions[0].home_local[2], atol=1e-3)
    files = export(made_plan(), structure, "mavlink", tmp_path / "a.waypoints")
    assert [path.name for path in files.paths] == ["a.waypoints", "a.rally.waypoints"]
    rows = [line.split("\t") for line in files.paths[1].read_text().splitlines()[1:]]
    assert [row[2:4] for row in rows] == [["3", "5100"]] * 2
    assert np.allclose(
        [[float(value) for value in row[8:11]] for row in rows], files.missions[0].rally, atol=1e-7
    )


@pytest.mark.parametrize(
    ("around", "why"),
    [
        ({"rally_m": np.array([[6.5, 0.0, 2.0]])}, "0.50 m from the structure"),
        ({"rally_m": np.array([[0.0, 0.0, 5.0]])}, "the structure is above it"),
        ({"rally_m": np.array([[80.0, 0.0, 9.0]]), "geofence_m": FENCE}, "outside the geofence"),
        ({"rally_m": np.array([[42.0, 42.0, 5.0]]), "keep_out_m": BOX[None]}, "in a keep-out box"),
    ],
)
def test_a_rally_point_that_is_no_place_to_fly_to_is_refused(tmp_path, around, why):
    with pytest.raises(RefusedError, match=f"rally point 1 .*{why}"):
        export(made_plan(), placed_box(**around), "qgc-plan", tmp_path / "a.plan")


@pytest.mark.parametrize("options", [MissionOptions(), MissionOptions(firmware="ardupilot", gimbal="mount")])
def test_mavsdk_imports_the_plan_file(tmp_path, mavsdk_importer, mission, options):
    _, path = written(tmp_path, "qgc-plan", options)
    items = mavsdk_importer(path.read_text()).mission_items
    places = [item for item in items if item.command == 16]
    assert len(places) == len(mission)
    assert np.allclose([item.x for item in places], mission.geodetic[:, 0] * 1e7, atol=1)
    assert np.allclose([item.y for item in places], mission.geodetic[:, 1] * 1e7, atol=1)
    assert np.allclose([item.z for item in places], mission.height_m, atol=1e-3)
    assert np.allclose([item.param4 for item in places], mission.heading_deg, atol=1e-3)
    assert items[0].command == 22 and items[-1].command == 20 and {item.frame for item in places} == {3}
    turns = [at for at, item in enumerate(items) if item.command == 115]  # ArduPilot's heading of each leg
    assert len(turns) == (len(mission) if options.firmware == "ardupilot" else 0)
    assert all(items[at + 1].command == 16 and items[at].param1 == items[at + 1].param4 for at in turns)
    photo = 203 if options.firmware == "ardupilot" else 2000
    assert sum(item.command == photo for item in items) == mission.photo.sum()
    tilts = [item.param1 for item in items if item.command in (1000, 205)]
    assert (
        tilts and min(tilts) >= mission.pitch_deg.min() - 0.5 and max(tilts) <= mission.pitch_deg.max() + 0.5
    )


def test_pymavlink_loads_the_waypoint_file(tmp_path, mission):
    mavwp = pytest.importorskip("pymavlink.mavwp", reason="pymavlink is not installed")
    _, path = written(tmp_path, "mavlink")
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(path))
    items = [loader.wp(at) for at in range(count)]
    places = [item for item in items[1:] if item.command == 16]
    assert np.allclose([(item.x, item.y) for item in places], mission.geodetic[:, :2], atol=1e-7)
    assert np.allclose([item.z for item in places], mission.height_m, atol=1e-4)
    assert (items[0].x, items[0].y, items[0].z) == pytest.approx(tuple(mission.home), abs=1e-6)
    assert items[1].command == 22 and items[1].z == pytest.approx(mission.height_m[0])


def ogr(path, *arguments) -> str:
    if shutil.which("ogrinfo") is None:
        pytest.skip("GDAL is not installed; apt-get install gdal-bin")
    process = subprocess.run(["ogrinfo", *arguments, str(path)], capture_output=True, text=True, check=True)
    return process.stdout


@pytest.mark.parametrize("name", ["kml", "geojson"])
def test_gdal_reads_the_maps(tmp_path, mission, name):
    _, path = written(tmp_path, name)
    listing = ogr(path, "-ro", "-al")
    line = next(row for row in listing.splitlines() if "LINESTRING Z" in row)
    numbers = [tuple(map(float, each.split())) for each in line.split("(")[1].rstrip(")").split(",")]
    assert np.allclose(
        numbers, np.c_[mission.geodetic[:, 1], mission.geodetic[:, 0], mission.height_m], atol=1e-3
    )
    points = mission.photo.sum() if name == "kml" else len(mission)
    assert listing.count("POINT Z") == points


def test_gdal_finds_djis_waypoints(tmp_path, mission):
    files, path = written(tmp_path, "dji-wpml", MissionOptions(drone="m30t"))
    template = tmp_path / "template.kml"
    template.write_bytes(zipfile.ZipFile(path).read("wpmz/template.kml"))
    assert ogr(template, "-ro", "-al").count("POINT") == len(files.missions[0]) == len(mission)


def test_dji_files_have_every_element_the_tables_require(tmp_path):
    files, path = written(tmp_path, "dji-wpml", MissionOptions(drone="m3e", photos="distance"))
    archive = zipfile.ZipFile(path)
    assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
    required = {
        "missionConfig": "flyToWaylineMode finishAction exitOnRCLost executeRCLostAction "
        "takeOffSecurityHeight globalTransitionalSpeed droneInfo payloadInfo",
        "droneInfo": "droneEnumValue droneSubEnumValue",
        "payloadInfo": "payloadEnumValue payloadPositionIndex",
        "waypointHeadingParam": "waypointHeadingMode waypointHeadingAngle waypointHeadingPathMode",
        "waypointTurnParam": "waypointTurnMode",
        "actionGroup": "actionGroupId actionGroupStartIndex actionGroupEndIndex actionGroupMode "
        "actionTrigger action",
        "action": "actionId actionActuatorFunc actionActuatorFuncParam",
    }
    for name, places in (
        ("wpmz/template.kml", "index height gimbalPitchAngle waypointHeadingParam waypointTurnParam"),
        ("wpmz/waylines.wpml", "index executeHeight waypointSpeed waypointHeadingParam waypointTurnParam"),
    ):
        root = ET.fromstring(archive.read(name))
        for parent, children in required.items():
            elements = list(root.iter(f"{WPML}{parent}"))
            assert elements
            for element in elements:
                assert set(children.split()) <= {child.tag.removeprefix(WPML) for child in element}
        marks = list(root.iter(f"{KML}Placemark"))
        assert [int(mark.find(f"{WPML}index").text) for mark in marks] == list(range(len(files.missions[0])))
        assert all(mark.find(f"{WPML}{child}") is not None for mark in marks for child in places.split())
        angles = [float(each.text) for each in root.iter(f"{WPML}waypointHeadingAngle")]
        assert all(-180 <= angle <= 180 for angle in angles)
        groups = [int(each.text) for each in root.iter(f"{WPML}actionGroupId")]
        assert len(set(groups)) == len(groups)
    folder = ET.fromstring(archive.read("wpmz/waylines.wpml")).find(f".//{KML}Folder")
    assert folder.find(f"{WPML}executeHeightMode").text == "relativeToStartPoint"


@pytest.mark.ci
def test_dji_asks_which_drone_flies(tmp_path):
    for options in (MissionOptions(), MissionOptions(drone="m350"), MissionOptions(drone="paper plane")):
        with pytest.raises(SettingsError, match=r"option (drone|payload)"):
            written(tmp_path, "dji-wpml", options)
    assert written(tmp_path, "dji-wpml", MissionOptions(drone="m350", payload=42))[1].exists()


def test_litchi_has_its_46_columns_and_codes(tmp_path):
    files, _ = written(tmp_path, "litchi", MissionOptions(max_waypoints=25))
    assert len(files.paths) > 1
    for path, mission in zip(files.paths, files.missions, strict=True):
        rows = list(csv.reader(path.open()))
        assert len(rows[0]) == 46 and len(rows) - 1 == len(mission) <= (
            Flying.of("litchi").max_waypoints or 0
        )
        assert all(len(row) == 46 for row in rows)
        table = pd.read_csv(path)
        assert np.allclose(table["latitude"], mission.geodetic[:, 0]) and (table["altitudemode"] == 0).all()
        assert ((table["actiontype1"] == 1) == mission.photo).all() and (table["gimbalmode"] == 2).all()
        assert np.allclose(table["gimbalpitchangle"], mission.pitch_deg, atol=0.06)


def test_the_table_reads_with_pandas(tmp_path, mission):
    _, path = written(tmp_path, "csv")
    table = pd.read_csv(path)
    assert np.allclose(table[["x_m", "y_m", "z_m"]], mission.local, atol=1e-4)
    assert np.allclose(table["alt_m"], mission.geodetic[:, 2], atol=1e-3) and set(table["datum"]) == {
        "ellipsoid"
    }
    assert np.allclose(np.linalg.norm(table[["qx", "qy", "qz", "qw"]], axis=1), 1)


def test_rosbags_reads_the_mcap(tmp_path):
    rosbags = pytest.importorskip("rosbags.rosbag2.storage_mcap", reason="rosbags is not installed")
    from rosbags.typesys import Stores, get_typestore

    plan = made_plan()
    path = export(plan, placed_box(None), "mcap", tmp_path / "plan.mcap", camera=Camera()).paths[0]
    store = get_typestore(Stores.ROS2_HUMBLE)
    reader = rosbags.McapReader(path)
    reader.open()
    messages: dict[str, list] = {}
    for connection, _, raw in reader.messages(reader.connections):
        messages.setdefault(connection.topic, []).append(store.deserialize_cdr(raw, connection.msgtype))
    reader.close()
    poses = messages["/plan/path"][0].poses
    assert np.allclose(
        [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in poses], plan.trajectory.positions
    )
    assert len(messages["/plan/camera"]) == len(messages["/tf"]) == len(plan.trajectory)
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in messages["/plan/camera"]]
    assert np.allclose(stamps, plan.trajectory.t_s, atol=1e-6)
    surface = messages["/structure"][0].markers[0]
    assert surface.type == 11 and len(surface.points) % 3 == 0 and len(surface.colors) == len(surface.points)
    assert messages["/plan/frusta"][0].markers[0].type == 5


def test_geojson_says_what_its_altitudes_mean(tmp_path):
    _, path = written(tmp_path, "geojson", MissionOptions(altitude="ellipsoid"))
    line = json.loads(path.read_text())["features"][0]
    assert line["properties"]["altitude_reference"] == line["properties"]["datum"] == "ellipsoid"
    assert min(place[2] for place in line["geometry"]["coordinates"]) > 488


@pytest.mark.parametrize("name", ["mavlink", "qgc-plan", "litchi", "kml", "dji-wpml"])
def test_formats_refuse_altitudes_they_cannot_say(tmp_path, name):
    with pytest.raises(RefusedError, match="ellipsoid"):
        written(tmp_path, name, MissionOptions(altitude="ellipsoid", drone="m30"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_equal_plans_give_equal_bytes_and_refused_ones_none(tmp_path, name):
    options = MissionOptions(drone="m30")
    first, second = (written(tmp_path / str(at), name, options)[1].read_bytes() for at in range(2))
    assert first == second
    with pytest.raises(RefusedError, match="refused"):
        export(made_plan(status="refused", trajectory=None), placed_box(), name, tmp_path / "no", options)
    assert not (tmp_path / "no").exists()


def test_sorties_are_numbered_files(tmp_path):
    files, _ = written(tmp_path, "qgc-plan", MissionOptions(endurance_s=120.0))
    names = [path.name for path in files.paths]
    assert names == [f"mission-{at + 1}of{len(names)}.plan" for at in range(len(names))] and len(names) > 1
    ends = [json.loads(path.read_text())["mission"]["items"][-1]["command"] for path in files.paths]
    assert set(ends) == {20}
    for before, after in itertools.pairwise(files.missions):
        assert np.allclose(before.local[before.inspect][-1], after.local[after.inspect][0])


def test_an_unknown_format_is_named_with_those_that_exist(tmp_path):
    with pytest.raises(SettingsError, match="qgc-plan"):
        export(made_plan(), placed_box(), "paper-map", tmp_path / "x")


def test_turns_on_the_spot_are_holds_or_actions_and_no_waypoints_of_their_own(tmp_path):
    plan = made_plan(turning_on_the_spot(), every=1)
    options = MissionOptions(home_m=(0.0, -30.0, 0.0), drone="m30t", firmware="ardupilot")
    paths = {}
    options = replace(options, photos="none")
    for name in ("mavlink", "litchi", "dji-wpml"):
        written = export(plan, placed_box(), name, tmp_path / f"m{FORMATS[name]}", options)
        paths[name], (mission,) = written.paths[0], written.missions
    rows = [line.split("\t") for line in paths["mavlink"].read_text().splitlines()[1:]]
    assert [float(row[4]) for row in rows if row[3] == "16"][1:].count(4.0) == 1
    table = list(csv.reader(paths["litchi"].read_text().splitlines()))[1:]
    assert len(table) == len(mission.stops) == len(mission) - 1
    (turned,) = [row for row in table if row[8] == "4"]
    assert turned[8:16] == ["4", turned[9], "5", "0", "0", "4000", "-1", "0"]
    assert int(turned[9]) == round((30.0 - 150.0) % 360)
    with zipfile.ZipFile(paths["dji-wpml"]) as archive:
        text = archive.read("wpmz/waylines.wpml").decode()
    assert text.count("<Placemark>") == len(mission.stops)
    assert text.count(">rotateYaw<") == 1 and ">counterClockwise<" in text
    assert text.count(">takePhoto<") == 0 and "<wpml:hoverTime>4.0<" in text
