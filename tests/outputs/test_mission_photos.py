"""Photos of missions: never sooner than the camera takes, in every format; overlap as asked; films."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from cases import slow_after
from made_missions import made_plan, placed_box, rounds

from upplied.cameras import known_camera
from upplied.errors import RefusedError
from upplied.geometry.poses import look_at, matrices
from upplied.geometry.scene import scene_of
from upplied.geometry.slowing import spaced
from upplied.outputs.missions import FORMATS, MissionOptions, export, missions_of
from upplied.outputs.missions.gate import Limits, breaches
from upplied.outputs.missions.photos import interval_of
from upplied.outputs.missions.read_back import read_mission
from upplied.overlap import Frames
from upplied.photographed import photographed
from upplied.records import Camera, Cloud, Measures, SurfaceStates, Trajectory
from upplied.samples.surfaces import box

FLOWN = [name for name in sorted(FORMATS) if name != "mcap"]
HOME = (30.0, 0.0, 0.0)


def read(tmp_path, name, options, plan=None, camera=None):
    """What the files of a mission state, each with its mission."""
    files = export(
        plan or made_plan(rounds(count=80)),
        placed_box(),
        name,
        tmp_path / f"m{FORMATS[name]}",
        options,
        camera,
    )
    return [
        (read_mission(name, path.read_bytes(), one), one)
        for path, one in zip(files.paths, files.missions, strict=True)
    ]


def creeping(pace_mps: float) -> Trajectory:
    """Past the box, slower than a file says, with a waypoint at every 6.5 cm."""
    x = 0.065 * np.arange(80) - 2.6
    positions = np.stack([x, 0 * x - 12.0, 4.0 + 0.3 * np.sin(x)], axis=1)
    legs = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    t_s = np.concatenate([[0.0], np.cumsum(legs / pace_mps)])
    return Trajectory(t_s, positions, look_at(positions, positions + np.array([0.0, 1.0, 0.0])))


@pytest.mark.parametrize("name", FLOWN)
@pytest.mark.parametrize(
    ("path", "trigger_s", "more"),
    [
        (rounds(count=80), 1.0, {"max_waypoints": 60}),
        (rounds(count=80), 4.0, {"max_waypoints": 60}),
        (creeping(0.178), 3.2, {"tolerance_m": 0.0, "overlap": "95/0"}),
    ],
)
def test_no_two_photos_of_any_format_are_nearer_in_time_than_the_camera_takes(
    tmp_path, name, path, trigger_s, more
):
    options = MissionOptions(trigger_s=trigger_s, drone="m30t", home_m=HOME, **more)
    for reading, mission in read(tmp_path, name, options, made_plan(path)):
        assert len(reading.photo_s) == mission.photo.sum() > 1
        assert np.diff(reading.photo_s).min() >= trigger_s - 1e-3
        assert np.abs(reading.photo_m - mission.local[mission.photo]).max() < 0.06  # the same places
        assert not breaches(reading, placed_box(), Limits(trigger_s=trigger_s), None)
        faults = breaches(reading, placed_box(), Limits(trigger_s=2.5 * trigger_s + 100), None)
        assert [one.rule for one in faults] == ["photos"] and "after the previous one" in faults[0].fault


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


@pytest.mark.ci
def test_a_camera_that_takes_longer_gets_fewer_photos_and_the_flight_waits_only_for_what_is_seen():
    plan = made_plan(rounds(speed=4.0))
    quick, slow = (
        missions_of(plan, placed_box(), MissionOptions(trigger_s=s, home_m=HOME))[0] for s in (0.5, 6.0)
    )
    assert slow.photo.sum() < quick.photo.sum()
    for mission in (quick, slow):
        assert any("% of the planned surface" in note for note in mission.notes)
    overlapping = MissionOptions(trigger_s=6.0, home_m=HOME, overlap="85/0")
    waiting = missions_of(plan, placed_box(), overlapping)[0]
    assert waiting.duration_s > slow.duration_s + 10
    assert any("longer than planned, because the camera needs" in note for note in waiting.notes)


def seen_of_box(poses, camera, points, normals):
    """Which points (N,) of the box some pose (P,) sees, in closed form: it is convex."""
    seen = np.zeros(len(points), bool)
    slopes = np.tan(np.radians([camera.hfov_deg, camera.vfov_deg]) / 2)
    for position, turn in zip(poses.positions, matrices(poses.quat_xyzw), strict=True):
        local = (points - position) @ turn
        inside = (np.abs(local[:, 1:]) <= local[:, :1] * slopes).all(axis=1) & (local[:, 0] > 0)
        seen |= inside & (((position - points) * normals).sum(axis=1) > 0)
    return seen


@pytest.mark.ci
@pytest.mark.parametrize("trigger_s", [2.0, 9.0])
def test_thinned_photos_show_all_that_the_plan_shows_and_say_so(trigger_s):
    rng = np.random.default_rng(2)
    side, sign = rng.integers(0, 2, 2500), rng.choice([-1.0, 1.0], 2500)
    normals = np.zeros((2500, 3))
    normals[np.arange(2500), side] = sign
    points = rng.uniform(-1, 1, (2500, 3)) * [6, 4, 4.5] + [0, 0, 5]
    points[np.arange(2500), side] = sign * np.array([6.0, 4.0])[side]
    camera, path = Camera(38.0, 24.0, 1.0, 40.0), rounds(count=400)
    surface = SurfaceStates(points, np.ones(2500, np.int64), normals)
    plan = made_plan(path, surface=surface, measures=Measures(coverage_inspected_pct=90.0))
    options = MissionOptions(trigger_s=trigger_s, home_m=HOME)
    (mission,) = missions_of(plan, placed_box(), options, camera=camera)
    taken = Trajectory(
        np.arange(mission.photo.sum(), dtype=float),
        mission.local[mission.photo],
        mission.quat_xyzw[mission.photo],
    )
    planned = seen_of_box(path, camera, points, normals)
    photographed_too = seen_of_box(taken, camera, points, normals)
    assert planned.sum() > 2000 and len(taken) < 0.5 * len(path)
    assert (planned & ~photographed_too).sum() <= 2  # on the rim of a picture
    assert mission.shown_pct == pytest.approx(90.0)
    by_distance = replace(options, photos="distance", photo_distance_m=40.0, least_seen_pct=0.0)
    (few,) = missions_of(plan, placed_box(), by_distance, camera=camera)
    assert few.shown_pct < 80 and any(
        f"which show {few.shown_pct / 0.9:.1f} % of the planned surface" in note for note in few.notes
    )
    with pytest.raises(RefusedError, match="coverage"):
        missions_of(plan, placed_box(), replace(by_distance, least_seen_pct=95.0), camera=camera)


@pytest.mark.ci
@pytest.mark.parametrize("along", slow_after(1, [60, 80, 90]))
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
    assert np.percentile(shares, 5) > along - 2  # never less, but for what rays leave open


@pytest.mark.parametrize("share", [0.6, 0.73, 0.81, 0.87])
@pytest.mark.parametrize("upright", [True, False])
def test_overlap_is_told_from_narrow_structures_too(share, upright):
    """A bar along the picture, past which the camera flies by less than a row of rays would tell."""
    size = np.array([1.0, 3.0, 80.0] if upright else [1.0, 80.0, 3.0])
    bar = box(size, "bar").structure
    slopes = np.tan(np.radians([60.0, 45.0]) / 2)
    height = 2 * 19.5 * slopes[int(upright)]  # of the picture, on the bar's near side
    before = np.array([20.0, 0.0, size[2] / 2])
    step = np.array([0.0, 0.0, 1.0] if upright else [0.0, 1.0, 0.0]) * (1 - share) * height
    at = np.array([before, before + step])
    poses = Trajectory(np.arange(2.0), at, look_at(at, at - np.array([1.0, 0, 0])))
    frames = Frames(poses, Camera(60.0, 45.0, 1.0, 25.0), scene_of(bar))
    assert frames.overlap(0, 1) == pytest.approx(share, abs=0.015)


def test_photos_that_coverage_adds_overlap_as_asked_too():
    """The last of the flight comes nearer, aside of what the photo before shows of what all of them show."""
    along = np.linspace(0, 1, 200)
    at = np.column_stack([np.zeros(200), -26.0 + 17.0 * np.sin(np.pi * along), np.full(200, 4.0)])
    path = Trajectory(30 * along, at, look_at(at, at + np.array([0.0, 1, 0])))
    camera, box = Camera(60.0, 45.0, 1.0, 60.0), placed_box()
    side = np.linspace(-5.5, 5.5, 30)
    wall = np.stack(np.meshgrid(side, [-4.0], np.linspace(1, 8, 20)), axis=-1).reshape(-1, 3)
    cloud = Cloud(wall, np.tile([0.0, -1.0, 0.0], (len(wall), 1)))
    photos = photographed(path, camera, scene_of(box), cloud, 0.7, 2.0, (0.8, 0.0), complete=True)
    assert len(photos.along) > 3 and photos.along.min() > 0.78


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8])
def test_overlap_is_as_exact_where_a_picture_shows_little(share: float) -> None:
    """A plate of which the second picture shows all, in its corner, and the first a share."""
    plate, camera = box((0.5, 0.001, 0.4), "plate").structure, Camera(60.0, 45.0, 1.0, 60.0)
    (left, front, low), (right, _, high) = plate.vertices.min(axis=0), plate.vertices.max(axis=0)
    half_m = 9.0 * np.tan(np.radians(30.0))
    x = np.array([left + share * (right - left) - half_m, right + 0.1 - half_m])
    at = np.column_stack([x, np.full(2, front - 9.0), np.full(2, (low + high) / 2 + 2.5)])
    frames = Frames(
        Trajectory(np.arange(2.0), at, look_at(at, at + np.array([0.0, 1, 0]))), camera, scene_of(plate)
    )
    assert frames.overlap(0, 1) == pytest.approx(share, abs=0.02)


@pytest.mark.ci
def test_overlap_across_is_measured_and_refused_where_passes_lie_too_far_apart():
    """Two passes along a wall, 4 m apart, seen from 6 m with a picture of 6.9 x 5 m."""
    x = np.linspace(-4, 4, 60)
    there = np.column_stack([x, 0 * x - 10, 0 * x + 3])
    back = np.column_stack([x[::-1], 0 * x - 10, 0 * x + 5.5])
    at = np.concatenate([there, back])
    path = Trajectory(np.arange(120) * 0.3, at, look_at(at, at + np.array([0.0, 1, 0])))
    camera, box = Camera(60.0, 45.0, 1.0, 60.0), placed_box()
    photos = photographed(path, camera, scene_of(box), Cloud(np.empty((0, 3))), 0.7, 2.0, (0.8, 0.4))
    height = 2 * 6 * np.tan(np.radians(22.5))
    assert photos.across == pytest.approx(1 - 2.5 / height, abs=0.02)  # the passes lie 2.5 m apart
    assert np.median(photos.along) == pytest.approx(0.8, abs=0.02)
    options = MissionOptions(
        overlap="80/70", trigger_s=0.7, home_m=(0.0, -40.0, 0.0), force=("acceleration",)
    )
    plan = made_plan(path, surface=None)
    with pytest.raises(RefusedError, match=r"overlap across is \d\d %.*limit 70 %"):
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
        RefusedError, match=r"a photo every 3 m needs 0\.15 m/s or less: the camera needs 20 s for a photo"
    ):
        missions_of(made_plan(), placed_box(), replace(options, trigger_s=20.0))
    mission = missions_of(made_plan(), placed_box(), replace(options, trigger_s=10.0))[0]
    assert mission.speed_mps[mission.inspect][2:].max() < 0.3


def test_the_interval_is_that_of_who_flies():
    demonstrated = Camera(trigger_s=1.3)
    intervals = {
        "as asked": interval_of(MissionOptions(trigger_s=9.0, camera="dji-mavic-3e"), demonstrated),
        "named": interval_of(MissionOptions(camera="dji-mavic-3e", file_format="raw"), demonstrated),
        "drone": interval_of(MissionOptions(drone="m3e"), demonstrated),
        "flight": interval_of(MissionOptions(drone="m350"), demonstrated),
        "nobody": interval_of(MissionOptions(), Camera()),
    }
    assert [interval for interval, _ in intervals.values()] == [9.0, 3.0, 0.7, 1.3, 2.0]
    assert "dji-mavic-3e" in intervals["drone"][1] and "is unknown" in intervals["nobody"][1]
    known = known_camera("dji-phantom-4-rtk")
    (mission,) = missions_of(made_plan(), placed_box(), MissionOptions(home_m=HOME), camera=known)
    assert any(
        "the camera needs 2.5 s for a photo (of the camera dji-phantom-4-rtk" in note
        for note in mission.notes
    )


def test_a_film_begins_with_the_inspection_and_ends_with_it(tmp_path):
    options = MissionOptions(photos="video", drone="m30t", home_m=HOME)
    for name in ("qgc-plan", "dji-wpml", "litchi"):
        files = export(made_plan(), placed_box(), name, tmp_path / f"f{FORMATS[name]}", options)
        (mission,), path = files.missions, files.paths[0]
        assert not mission.photo.any() and any("records a video" in note for note in mission.notes)
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


@pytest.mark.parametrize("apart_s", [0.5, 0.8, 1.9])
def test_a_flight_waits_for_its_camera_not_much_longer_than_it_must(apart_s: float) -> None:
    """Two photos soon after one another, every ten seconds: the flight is slow there, and not elsewhere."""
    first = np.arange(5, 290, 10.0)
    photo_s = np.sort(np.concatenate([first, first + apart_s]))
    times = np.union1d(np.arange(0, 300, 0.5), photo_s)
    late = spaced(times, photo_s, 2.0, 0.5)
    taken = np.interp(photo_s, times, late)
    missing_s = np.maximum(2.0 - np.diff(photo_s), 0).sum()
    assert np.diff(taken).min() >= 2.0 - 1e-6 and (np.diff(late) >= np.diff(times) - 1e-9).all()
    assert missing_s <= late[-1] - times[-1] <= 3 * missing_s + 1.0
    assert np.array_equal(spaced(times, first, 2.0, 0.5), times)
    alone = np.zeros(1)  # a plan of one pose, and its photo
    assert np.array_equal(spaced(alone, alone, 2.0, 0.5), alone)
