"""Photos of missions: never sooner than the camera takes, in every format; overlap as asked; films."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from made_missions import made_plan, placed_box, rounds

from upplied.cameras import known_camera
from upplied.errors import RefusedError
from upplied.outputs.missions import FORMATS, MissionOptions, export, missions_of
from upplied.outputs.missions.gate import Limits, breaches
from upplied.outputs.missions.photos import interval_of
from upplied.outputs.missions.read_back import read_mission
from upplied.overlap import Frames
from upplied.photographed import photographed
from upplied.poses import look_at
from upplied.records import Camera, Cloud, Trajectory
from upplied.scene import scene_of

FLOWN = [name for name in sorted(FORMATS) if name != "mcap"]
HOME = (30.0, 0.0, 0.0)


def read(tmp_path, name, options, plan=None, camera=None):
    """What the files of a mission state, each with its mission."""
    done = export(
        plan or made_plan(rounds(count=80)),
        placed_box(),
        name,
        tmp_path / f"m{FORMATS[name]}",
        options,
        camera,
    )
    return [
        (read_mission(name, path.read_bytes(), one), one)
        for path, one in zip(done.paths, done.missions, strict=True)
    ]


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize("trigger_s", [1.0, 4.0])
def test_no_two_photos_of_any_format_are_nearer_in_time_than_the_camera_takes(tmp_path, name, trigger_s):
    options = MissionOptions(trigger_s=trigger_s, drone="m30t", home_m=HOME, max_waypoints=60)
    for reading, mission in read(tmp_path, name, options):
        assert len(reading.photo_s) == mission.photo.sum() > 3
        assert np.diff(reading.photo_s).min() >= trigger_s - 1e-3
        assert np.abs(reading.photo_m - mission.local[mission.photo]).max() < 0.02  # the same places
        assert not breaches(reading, placed_box(), Limits(trigger_s=trigger_s), None)
        found = breaches(reading, placed_box(), Limits(trigger_s=2.5 * trigger_s + 8), None)
        assert [one.rule for one in found] == ["photos"] and "after the one before" in found[0].found


def test_turns_on_the_spot_give_the_camera_its_time_too(tmp_path):
    """Three photos at one place, as the camera turns there: hovering is written where legs take no time."""
    at = np.array([[12.0, -0.5, 4], [12.0, 0, 4], [12.0, 0, 4], [12.0, 0, 4], [12.0, 0.5, 4]])
    aim = np.array([[0.0, 0, 4], [0.0, 8, 4], [0.0, 0, 4], [0.0, -8, 4], [0.0, 0, 4]])
    path = Trajectory(np.array([0.0, 0.5, 1.0, 1.5, 2.0]), at, look_at(at, aim))
    narrow = Camera(20.0, 15.0, 1.0, 40.0)
    for name in ("mavlink", "qgc-plan", "dji-wpml", "litchi", "csv", "geojson"):
        options = MissionOptions(trigger_s=3.0, drone="m30t", home_m=HOME, overlap="50/0")
        ((reading, mission),) = read(tmp_path, name, options, made_plan(path, every=1), narrow)
        assert mission.photo.sum() >= 4 and np.diff(reading.photo_s).min() >= 3.0 - 1e-3, name


def test_a_camera_that_takes_longer_gets_fewer_photos_and_the_flight_waits_only_for_what_is_seen():
    plan = made_plan(rounds(speed=4.0))
    quick, slow = (
        missions_of(plan, placed_box(), MissionOptions(trigger_s=s, home_m=HOME))[0] for s in (0.5, 6.0)
    )
    assert slow.photo.sum() < quick.photo.sum()
    for mission in (quick, slow):
        assert any("% of what the plan shows" in note for note in mission.notes)
    asked = MissionOptions(trigger_s=6.0, home_m=HOME, overlap="85/0")
    waiting = missions_of(plan, placed_box(), asked)[0]
    assert waiting.duration_s > slow.duration_s + 10
    assert any("longer than planned, so that the camera is ready" in note for note in waiting.notes)


@pytest.mark.parametrize("along", [60, 80, 90])
def test_overlap_asked_is_overlap_measured(along):
    """By other rays than those that chose the places."""
    plan, structure = made_plan(rounds(count=600)), placed_box()
    camera = Camera(60.0, 45.0, 1.0, 60.0)
    options = MissionOptions(overlap=f"{along}/0", trigger_s=0.7, home_m=HOME)
    (mission,) = missions_of(plan, structure, options, camera=camera)
    photos = Trajectory(
        np.arange(mission.photo.sum(), dtype=float),
        mission.local[mission.photo],
        mission.quat_xyzw[mission.photo],
    )
    frames = Frames(photos, camera, scene_of(structure))
    rng = np.random.default_rng(0)
    frames.__dict__["_grid"] = rng.uniform(-1, 1, (6000, 2))
    shares = [100 * frames.overlap(at - 1, at) for at in range(1, len(photos))]
    assert np.median(shares[:-1]) == pytest.approx(along, abs=2)
    assert np.percentile(shares, 5) > along - 3  # never less, but for what rays leave open


def test_overlap_across_is_measured_and_refused_where_passes_lie_too_far_apart():
    """Two passes along a wall, 4 m apart, seen from 6 m with a picture of 6.9 x 5 m."""
    x = np.linspace(-4, 4, 60)
    there = np.column_stack([x, 0 * x - 10, 0 * x + 3])
    back = np.column_stack([x[::-1], 0 * x - 10, 0 * x + 5.5])
    at = np.concatenate([there, back])
    path = Trajectory(np.arange(120) * 0.3, at, look_at(at, at + np.array([0.0, 1, 0])))
    camera, box = Camera(60.0, 45.0, 1.0, 60.0), placed_box()
    found = photographed(path, camera, scene_of(box), Cloud(np.empty((0, 3))), 0.7, (0.8, 0.4))
    height = 2 * 6 * np.tan(np.radians(22.5))
    assert found.across == pytest.approx(1 - 2.5 / height, abs=0.02)  # the passes lie 2.5 m apart
    assert np.median(found.along) == pytest.approx(0.8, abs=0.02)
    options = MissionOptions(
        overlap="80/70", trigger_s=0.7, home_m=(0.0, -40.0, 0.0), force=("acceleration",)
    )
    plan = made_plan(path, surface=None)
    with pytest.raises(RefusedError, match=r"overlap by \d\d % across.*70 % are asked"):
        missions_of(plan, box, options, camera=camera)
    assert missions_of(plan, box, replace(options, force=("overlap", "acceleration")), camera=camera)


def test_photos_by_distance_slow_the_legs_or_are_refused_with_the_figure(tmp_path):
    options = MissionOptions(
        photos="distance", photo_distance_m=3.0, trigger_s=2.0, drone="m30t", home_m=HOME, max_waypoints=90
    )
    for name in ("mavlink", "qgc-plan", "dji-wpml", "litchi"):
        for reading, _ in read(tmp_path, name, options, made_plan(rounds(speed=4.0))):
            assert 2.0 <= reading.every_s < 2.2, name
    with pytest.raises(
        RefusedError, match=r"a photo every 3 m asks for 0\.15 m/s: the camera takes 20 s, as asked"
    ):
        missions_of(made_plan(), placed_box(), replace(options, trigger_s=20.0))
    mission = missions_of(made_plan(), placed_box(), replace(options, trigger_s=10.0))[0]
    assert mission.speed_mps[mission.inspect][2:].max() < 0.3


def test_the_interval_is_that_of_who_flies():
    demonstrated = Camera(trigger_s=1.3)
    said = {
        "as asked": interval_of(MissionOptions(trigger_s=9.0, camera="dji-mavic-3e"), demonstrated),
        "named": interval_of(MissionOptions(camera="dji-mavic-3e", file_format="raw"), demonstrated),
        "drone": interval_of(MissionOptions(drone="m3e"), demonstrated),
        "flight": interval_of(MissionOptions(drone="m350"), demonstrated),
        "nobody": interval_of(MissionOptions(), Camera()),
    }
    assert [interval for interval, _ in said.values()] == [9.0, 3.0, 0.7, 1.3, 2.0]
    assert "dji-mavic-3e" in said["drone"][1] and "nobody says" in said["nobody"][1]
    known = known_camera("dji-phantom-4-rtk")
    (mission,) = missions_of(made_plan(), placed_box(), MissionOptions(home_m=HOME), camera=known)
    assert any(
        "the camera takes 2.5 s for one, of the camera dji-phantom-4-rtk" in note for note in mission.notes
    )


def test_a_film_begins_with_the_inspection_and_ends_with_it(tmp_path):
    options = MissionOptions(photos="video", drone="m30t", home_m=HOME)
    for name in ("qgc-plan", "dji-wpml", "litchi"):
        done = export(made_plan(), placed_box(), name, tmp_path / f"f{FORMATS[name]}", options)
        (mission,), path = done.missions, done.paths[0]
        assert not mission.photo.any() and any("filmed" in note for note in mission.notes)
        if name == "qgc-plan":
            commands = [item["command"] for item in json.loads(path.read_text())["mission"]["items"]]
            first, last = commands.index(2500), commands.index(2501)
            assert commands[:first].count(16) == mission.starts_at + 1
            assert commands[:last].count(16) == mission.stops_at + 1
        elif name == "dji-wpml":
            text = zipfile.ZipFile(path).read("wpmz/waylines.wpml").decode()
            assert text.count(">startRecord<") == text.count(">stopRecord<") == 1
        else:
            rows = [line.split(",") for line in path.read_text().splitlines()[1:]]
            actions = [{row[8], row[10], row[12]} for row in rows]
            assert sum("2" in each for each in actions) == sum("3" in each for each in actions) == 1
