"""The gate: a file that breaks a rule does not leave, by a ruler that shares no code with ours."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_missions import made_plan, placed_box, rounds, turning_on_the_spot

from upplied.errors import RefusedError, SettingsError
from upplied.geometry.poses import look_at
from upplied.outputs.missions import FORMATS, MissionOptions, export, missions_of
from upplied.outputs.missions.dji_wpml import DRONES
from upplied.outputs.missions.gate import RULES, Breach, Limits, breaches, coverage_breaches, planned
from upplied.outputs.missions.read_back import read_mission
from upplied.records import Trajectory

BOX = np.array([[-6.0, -4.0, 0.0], [6.0, 4.0, 10.0]])
FILES = sorted(set(FORMATS) - {"mcap"})


def from_box(points):
    """Distance of points (N, 3) from the box of the tests, in closed form."""
    return np.linalg.norm(np.maximum(np.maximum(BOX[0] - points, points - BOX[1]), 0), axis=1)


def dense(path, step_m=0.05):
    parts = [
        a + np.linspace(0, 1, 2 + int(np.linalg.norm(b - a) / step_m))[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    return np.concatenate(parts)


def passing_near(distance_m, height_m=5.0):
    """Along the side of the box, so near."""
    x = np.linspace(-15, 15, 40)
    positions = np.stack([x, 0 * x - 4.0 - distance_m, 0 * x + height_m], axis=1)
    return Trajectory(np.arange(40) * 0.8, positions, look_at(positions, positions + np.array([0, 10.0, 0])))


@pytest.mark.ci
@pytest.mark.parametrize("format", [*FILES, "mcap"])
def test_no_format_lets_a_path_out_that_comes_too_near(tmp_path, format):
    options = MissionOptions(drone="m30")
    near = made_plan(passing_near(1.2), surface=None)
    goal = tmp_path / f"near{FORMATS[format]}"
    with pytest.raises(RefusedError, match=r"clearance: 1\.2\d? m.*limit 2 m.*--force clearance"):
        export(near, placed_box(), format, goal, options)
    assert not list(tmp_path.iterdir())  # nothing is left behind
    result = export(near, placed_box(), format, goal, replace(options, force=("clearance",)))
    assert any(note.startswith("OVERRULED clearance: 1.2") for note in result.notes)
    assert goal.is_file()


@pytest.mark.parametrize("format", ["kml", "geojson"])
def test_what_was_overruled_stands_in_the_file_where_it_has_room(tmp_path, format):
    goal = tmp_path / "near"
    export(
        made_plan(passing_near(1.2), surface=None),
        placed_box(),
        format,
        goal,
        MissionOptions(force=("clearance",)),
    )
    assert "OVERRULED clearance" in goal.read_text()


def test_what_only_the_written_file_breaks_is_told_and_kept_when_it_is_overruled(tmp_path, monkeypatch):
    """A plan that keeps its rules, and a format that would not."""

    def lowered(format, content, mission):
        reading = read_mission(format, content, mission)
        return replace(reading, positions=reading.positions - [0, 0, 20.0])

    monkeypatch.setattr("upplied.outputs.missions.read_mission", lowered)
    place, goal, overruled = placed_box(ground_z_m=0.0), tmp_path / "a.kml", []
    with pytest.raises(RefusedError, match="ground: z"):
        export(made_plan(), place, "kml", goal, keep=overruled.extend)
    assert overruled == [] and not goal.exists()
    options = MissionOptions(force=("ground", "clearance"))
    result = export(made_plan(), place, "kml", goal, options, keep=overruled.extend)
    assert [breach.rule for breach in overruled] == [breach.rule for breach in result.overruled]
    assert "ground" in {breach.rule for breach in overruled} and "OVERRULED ground" in goal.read_text()


def test_a_rule_is_not_overruled_where_that_cannot_be_kept(tmp_path):
    def full(overruled):
        raise OSError("no space left") if overruled else None

    options, goal = MissionOptions(force=("preset",)), tmp_path / "a.csv"
    with pytest.raises(OSError, match="no space"):
        export(replace(made_plan(), preset="paper"), placed_box(), "csv", goal, options, keep=full)
    assert not goal.exists()


def test_a_plan_that_falls_short_is_not_flown(tmp_path):
    short = replace(made_plan(), not_flyable="shows 12.0 % of what was inspected")
    with pytest.raises(RefusedError, match=r"verdict: shows 12\.0 %"):
        export(short, placed_box(), "csv", tmp_path / "a.csv")


@pytest.mark.parametrize("preset", ["paper", "baseline"])
def test_plans_for_comparison_are_not_flown(tmp_path, preset):
    with pytest.raises(RefusedError, match=f"preset: the plan is of preset {preset}"):
        export(replace(made_plan(), preset=preset), placed_box(), "csv", tmp_path / "a.csv")


def test_an_unknown_rule_is_not_overruled(tmp_path):
    with pytest.raises(SettingsError, match=r"clearence.*clearance"):
        export(made_plan(), placed_box(), "csv", tmp_path / "a.csv", MissionOptions(force=("clearence",)))


@pytest.mark.parametrize(
    ("rule", "around", "path"),
    [
        ("keep-out", {"keep_out_m": np.array([[[-2.0, -12.0, 0], [2, -8, 9]]])}, passing_near(6.0)),
        (
            "geofence",
            {"geofence_m": np.array([[-10.0, -20], [60, -20], [60, 20], [-10, 20]])},
            passing_near(6.0),
        ),
        ("ceiling", {"ceiling_z_m": 4.0}, passing_near(6.0)),
        ("ground", {"ground_z_m": 6.0}, passing_near(6.0)),
    ],
)
def test_every_surrounding_has_its_rule(rule, around, path):
    (breach,) = breaches(planned(path.positions, path.t_s), placed_box(**around), Limits(), None)
    assert breach.rule == rule and breach.place_m


def test_speed_acceleration_height_time_and_coverage_have_their_rules():
    path, box = passing_near(6.0), placed_box()
    assert breaches(planned(path.positions, path.t_s), box, Limits(), None) == []
    fast = planned(path.positions, path.t_s / 40)
    assert [each.rule for each in breaches(fast, box, Limits(), None)] == ["speed"]
    jerky = path.positions + np.arange(40)[:, None] % 2 * [0, 0, 1.5]
    assert [each.rule for each in breaches(planned(jerky, path.t_s), box, Limits(), None)] == ["acceleration"]
    high = [
        each.rule for each in breaches(planned(path.positions, path.t_s), box, Limits(max_height_m=4.0), None)
    ]
    assert high == ["height"]
    assert [each.rule for each in breaches(planned(path.positions, 0 * path.t_s), box, Limits(), None)] == [
        "finite"
    ]
    assert [each.rule for each in coverage_breaches(0.9, Limits())] == ["coverage"]
    assert coverage_breaches(float("nan"), Limits()) == coverage_breaches(0.96, Limits()) == []
    cases = {"preset", "verdict", "superseded", "clearance", "keep-out", "geofence", "ceiling", "ground"}
    cases |= {"released", "rejected", "recalled"}  # test_decisions.py
    cases |= {"foreign", "altered"}  # test_custody.py
    cases |= {"zoom"}  # test_zoom.py
    assert cases | {"finite", "height", "speed", "acceleration", "coverage", "photos", "overlap"} == set(
        RULES
    )
    assert "at [1.0, 2.0, 3.0] m" in str(Breach("ground", "z", "low", (1.0, 2.0, 3.0)))


@pytest.mark.ci
def test_a_keep_out_box_between_waypoints_that_were_left_out_is_seen(tmp_path):
    """A coarse tolerance cuts the corner through a box that the plan goes round."""
    corner = np.array([[-20.0, -8, 5], [-10, -8, 5], [-10, -14, 5], [10, -14, 5], [10, -8, 5], [20, -8, 5]])
    positions = dense(corner, 0.5)
    keep = np.concatenate([[True], np.linalg.norm(np.diff(positions, axis=0), axis=1) > 1e-6])
    positions = positions[keep]
    path = Trajectory(np.arange(len(positions)) * 0.5, positions, look_at(positions, positions * [1, 0, 1]))
    box = np.array([[-9.0, -13.0, 0.0], [9.0, -6.5, 20.0]])
    structure = placed_box(keep_out_m=box[None])
    for tolerance in (0.1, 1.0, 3.0, 10.0):
        options = MissionOptions(
            tolerance_m=tolerance, tolerance_deg=180.0, home_m=(-30.0, -20.0, 0.0), clearance_m=1.0
        )
        (mission,) = missions_of(made_plan(path, surface=None, every=1000), structure, options)
        flown = dense(np.concatenate([mission.home_local[None], mission.local, mission.home_local[None]]))
        assert not ((flown > box[0] + 1e-6) & (flown < box[1] - 1e-6)).all(axis=1).any()


@pytest.mark.ci
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    format=st.sampled_from(FILES),
    drone=st.sampled_from(sorted(DRONES)),
    tolerance=st.floats(0.0, 8.0),
    degrees=st.floats(0.0, 180.0),
    corner=st.floats(0.05, 5.0),
    away=st.floats(1.0, 8.0),
    turns=st.integers(1, 4),
    endurance=st.sampled_from([None, 200.0, 400.0]),
    pillar=st.booleans(),
)
def test_no_mission_is_below_its_own_rules(
    tmp_path_factory, format, drone, tolerance, degrees, corner, away, turns, endurance, pillar
):
    around = {"ceiling_z_m": 14.0, "ground_z_m": 0.0}
    keep_out = np.array([[-11.0, 9.0, 0.0], [-10.0, 10.0, 30.0]])
    if pillar:
        around["keep_out_m"] = keep_out[None]
    plan = made_plan(rounds(turns, away=away), every=1000)
    options = MissionOptions(
        tolerance_m=tolerance,
        tolerance_deg=degrees,
        corner_m=corner,
        endurance_s=endurance,
        drone=drone,
        payload=43,
    )
    goal = tmp_path_factory.mktemp("fuzz") / f"m{FORMATS[format]}"
    try:
        files = export(plan, placed_box(**around), format, goal, options)
    except RefusedError:
        return
    sorties, fences = files.paths[: len(files.missions)], files.paths[len(files.missions) :]
    assert all(path.name.endswith(f".fence{path.suffix}") for path in fences)
    for path, mission in zip(sorties, files.missions, strict=True):
        reading = read_mission(format, path.read_bytes(), mission)
        flown = dense(reading.positions)
        assert from_box(flown).min() >= 2.0 - 0.06
        assert flown[:, 2].max() <= 14.0 + 0.02 and flown[:, 2].min() >= -0.02
        if pillar:
            assert not ((flown > keep_out[0] + 0.03) & (flown < keep_out[1] - 0.03)).all(axis=1).any()


@pytest.mark.ci
def test_what_is_read_back_is_what_was_written(tmp_path):
    for format in FILES:
        options = MissionOptions(drone="m4t")
        files = export(made_plan(), placed_box(), format, tmp_path / f"a{FORMATS[format]}", options)
        (mission,) = files.missions
        reading = read_mission(format, files.paths[0].read_bytes(), mission)
        inside = reading.positions[2:-2]
        stops = np.array([stop[0] for stop in mission.stops])
        local = mission.local[stops] if len(inside) != len(mission) else mission.local
        assert np.abs(inside - local).max() < 0.02, format
        assert np.allclose(reading.positions[[0, -1]], mission.home_local)


@pytest.mark.parametrize(
    ("format", "spoil"),
    [
        ("csv", lambda text: text.replace(b"lat_deg", b"lat")),
        ("mavlink", lambda text: text[20:]),
        ("geojson", lambda text: text[:-30]),
        ("dji-wpml", lambda text: text[:200]),
        ("kml", lambda text: text.replace(b"LineString", b"Line")),
    ],
)
def test_a_file_that_cannot_be_read_back_does_not_leave(tmp_path, format, spoil):
    files = export(made_plan(), placed_box(), format, tmp_path / "a", MissionOptions(drone="m30"))
    with pytest.raises(RefusedError, match="cannot be read back"):
        read_mission(format, spoil(files.paths[0].read_bytes()), files.missions[0])


def test_dji_passes_waypoints_within_a_distance_that_was_checked(tmp_path):
    options = MissionOptions(drone="m4t")
    files = export(made_plan(every=1000), placed_box(), "dji-wpml", tmp_path / "a.kmz", options)
    with zipfile.ZipFile(files.paths[0]) as archive:
        text = archive.read("wpmz/waylines.wpml").decode()
    (mission,) = files.missions
    passed = mission.passing_m > 0
    assert text.count("toPointAndPassWithContinuityCurvature") == passed.sum() > 0.8 * len(mission)
    assert "gimbalEvenlyRotate" in text and "betweenAdjacentPoints" in text
    plan = made_plan().trajectory
    assert mission.duration_s < 1.3 * (plan.t_s[-1] - plan.t_s[0]) + 90  # was a stop of 3 s at each
    legs = np.linalg.norm(np.diff(mission.local, axis=0), axis=1)
    for at in np.flatnonzero(passed):
        assert mission.passing_m[at] + mission.passing_m[at + 1] < legs[at]  # DJI's own rule
    reading = read_mission("dji-wpml", files.paths[0].read_bytes(), mission)
    assert from_box(reading.fan_end).min() >= 2.0 - 0.06


def test_a_turn_on_the_spot_is_a_stop(tmp_path):
    options = MissionOptions(drone="m30", home_m=(0.0, -30.0, 0.0), photos="none")
    files = export(
        made_plan(turning_on_the_spot(), every=1), placed_box(), "dji-wpml", tmp_path / "a.kmz", options
    )
    (mission,) = files.missions
    assert not mission.passing_m[mission.inspect].any()


def test_transits_are_low_and_short(tmp_path):
    """Up to 103 m of structure, yet the way to its foot does not climb over it."""
    (mission,) = missions_of(made_plan(), placed_box(), MissionOptions())
    ways = mission.local[~mission.inspect]
    assert ways[:, 2].max() <= mission.local[mission.inspect][:, 2].max()
    assert mission.return_height_m >= 10.0 + 2.0
    goal = export(made_plan(), placed_box(), "qgc-plan", tmp_path / "a.plan").paths[0]
    takeoff = json.loads(goal.read_text())["mission"]["items"][0]
    assert takeoff["command"] == 22 and takeoff["params"][6] <= 9.1
    rows = csv.DictReader(
        io.StringIO(export(made_plan(), placed_box(), "csv", tmp_path / "a.csv").paths[0].read_text())
    )
    assert max(float(row["height_m"]) for row in rows) <= 9.1
