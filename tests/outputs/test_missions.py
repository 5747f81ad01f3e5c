"""Missions: where they lie on the Earth, that every leg is safe, and that splitting loses nothing."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_missions import PLACE, made_plan, placed_box, rounds, turning_on_the_spot

from upplied.errors import RefusedError, SettingsError
from upplied.geometry.poses import from_yaw_pitch, look_at, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.outputs.missions import MissionOptions, missions_of
from upplied.outputs.missions.flying import Flying, as_flown, still_seen, thinned
from upplied.outputs.missions.records import from_geodetic, heading_and_pitch, to_geodetic
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.records import Camera, Placement, Surroundings, Trajectory


@given(
    st.floats(-80, 80),
    st.floats(-179, 179),
    st.floats(-100, 4000),
    st.floats(0, 360),
    st.integers(0, 2**32 - 1),
)
def test_the_earth_and_back_is_where_it_was(lat, lon, alt, heading, seed):
    points = np.random.default_rng(seed).normal(0, 200, (5, 3))
    place = Placement(lat, lon, alt, heading)
    assert np.allclose(from_geodetic(to_geodetic(points, place), place), points, atol=1e-5)


def test_forward_left_and_up_lie_where_the_compass_says():
    facing_east = Placement(0.0, 0.0, 100.0, 90.0)
    ahead, left, up = to_geodetic(np.eye(3) * 100, facing_east)
    assert ahead[1] > 8e-4 and abs(ahead[0]) < 1e-6  # east
    assert left[0] > 8e-4 and abs(left[1]) < 1e-6  # north
    assert up[2] == pytest.approx(200.0)


@given(st.floats(0, 360), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_heading_is_the_bearing_of_what_the_camera_looks_at(placed, yaw, pitch):
    quat = from_yaw_pitch(np.array([yaw]), np.array([pitch]))
    heading, tilt = heading_and_pitch(quat, placed)
    ahead = np.array([[np.cos(yaw), np.sin(yaw), 0.0]]) * 1000
    place = Placement(10.0, 20.0, 0.0, placed)
    here, there = to_geodetic(np.concatenate([0 * ahead, ahead]), place)
    east = (there[1] - here[1]) * np.cos(np.radians(10.0))
    bearing = np.degrees(np.arctan2(east, there[0] - here[0])) % 360
    assert abs((heading[0] - bearing + 180) % 360 - 180) < 0.5
    assert tilt[0] == pytest.approx(np.degrees(pitch), abs=1e-6)


def min_distance(scene, points):
    """Least distance of a polyline, from places 2 cm apart: another ruler than the one under test."""
    legs = [(a, b, 2 + int(np.linalg.norm(b - a) / 0.02)) for a, b in pairwise(points)]
    dense = [a + np.linspace(0, 1, count)[:, None] * (b - a) for a, b, count in legs]
    return float(scene.distance(np.concatenate(dense)).min())


def test_every_leg_from_take_off_to_landing_keeps_its_clearance():
    structure = placed_box()
    scene = scene_of(structure)
    for mission in missions_of(made_plan(), structure, MissionOptions(endurance_s=120.0)):
        flown = np.concatenate([mission.home_local[None], mission.local, mission.home_local[None]])
        assert min_distance(scene, flown) >= 2.0 - 0.05
        assert mission.local[0, 2] < 10.0 and mission.local[-1, 2] < 10.0  # free: no higher than asked


def test_the_exact_clearance_of_a_path_is_that_of_its_closest_point():
    scene = scene_of(placed_box())
    line = np.array([[-30.0, 7.0, 5.0], [30.0, 5.5, 5.0], [30.0, 30.0, 5.0]])
    dense = np.concatenate([a + np.linspace(0, 1, 4000)[:, None] * (b - a) for a, b in pairwise(line)])
    assert path_clearance(scene, line).distance_m == pytest.approx(scene.distance(dense).min(), abs=0.03)


@pytest.mark.parametrize(
    "options", [{"endurance_s": 120.0}, {"max_waypoints": 20}, {"endurance_s": 90.0, "reserve_pct": 5.0}]
)
def test_splitting_keeps_every_photo_in_order_and_every_limit(options):
    plan, structure = made_plan(), placed_box()
    whole = missions_of(plan, structure, MissionOptions())
    parts = missions_of(plan, structure, MissionOptions(**options))
    assert len(whole) == 1 and len(parts) > 1
    assert [part.number for part in parts] == list(range(1, len(parts) + 1))
    inside = [part.local[part.inspect] for part in parts]
    for before, after in pairwise(inside):
        assert np.allclose(before[-1], after[0])  # the cut waypoint belongs to both
    joined = np.concatenate([inside[0], *(part[1:] for part in inside[1:])])
    assert np.allclose(joined, whole[0].local[whole[0].inspect])
    expected = {tuple(place) for place in whole[0].local[whole[0].photo].round(6)}
    taken = {tuple(place) for part in parts for place in part.local[part.photo].round(6)}
    assert taken == expected
    for part in parts:
        budget = options.get("endurance_s", np.inf) * (1 - options.get("reserve_pct", 20.0) / 100)
        assert part.duration_s <= budget and len(part) <= options.get("max_waypoints", 10**9)


def test_heights_are_above_take_off_and_altitudes_above_the_datum():
    structure = placed_box()
    (relative,) = missions_of(made_plan(), structure, MissionOptions(home_m=(30.0, 0.0, -2.0)))
    assert np.allclose(relative.written_alt_m, relative.local[:, 2] + 2.0)
    (absolute,) = missions_of(made_plan(), structure, MissionOptions(altitude="ellipsoid"))
    assert np.allclose(absolute.written_alt_m, 488.0 + absolute.local[:, 2], atol=1e-3)


def test_speed_is_that_of_the_plan():
    (mission,) = missions_of(made_plan(rounds(speed=1.5)), placed_box(), MissionOptions(tolerance_m=0.01))
    inside = np.flatnonzero(mission.inspect)[1:]
    assert np.allclose(mission.speed_mps[inside], 1.5, rtol=0.02)


@pytest.mark.parametrize("status", ["refused", "failed"])
def test_only_a_plan_that_is_ok_is_flown(status):
    plan = made_plan(status=status, reason="too different", trajectory=None, is_viewpoint=None)
    with pytest.raises(RefusedError, match="too different"):
        missions_of(plan, placed_box(), MissionOptions())


def test_what_cannot_be_placed_is_refused():
    with pytest.raises(RefusedError, match="its place on the Earth is unknown"):
        missions_of(made_plan(), placed_box(None), MissionOptions())
    with pytest.raises(RefusedError, match="ellipsoid"):
        missions_of(made_plan(), placed_box(), MissionOptions(altitude="amsl"))
    with pytest.raises(RefusedError, match="the plan is for box"):
        missions_of(made_plan(), replace(placed_box(), structure_id="other"), MissionOptions())


@pytest.mark.ci
def test_what_stands_in_the_way_is_gone_round_or_refused():
    lid = placed_box(ceiling_z_m=11.0)
    assert missions_of(made_plan(), lid, MissionOptions())[0].local[:, 2].max() <= 11.0
    with pytest.raises(RefusedError, match="ceiling"):
        missions_of(made_plan(), placed_box(ceiling_z_m=8.0), MissionOptions())
    with pytest.raises(RefusedError, match="not free"):
        missions_of(made_plan(), placed_box(), MissionOptions(home_m=(0.0, 0.0, 0.0)))
    with pytest.raises(RefusedError, match="one flight with its transit legs"):
        missions_of(made_plan(), placed_box(), MissionOptions(endurance_s=30.0))
    between = np.array([[[20.0, -5.0, -1.0], [26.0, 25.0, 20.0]]])
    (mission,) = missions_of(
        made_plan(), placed_box(keep_out_m=between), MissionOptions(home_m=(40.0, 20.0, 0.0))
    )
    flown = np.concatenate([mission.home_local[None], mission.local, mission.home_local[None]])
    dense = np.concatenate([a + np.linspace(0, 1, 500)[:, None] * (b - a) for a, b in pairwise(flown)])
    inside = ((dense > between[0, 0]) & (dense < between[0, 1])).all(axis=1)
    through = np.array([[[-15.0, 11.0, 0.0], [15.0, 15.0, 40.0]]])
    with pytest.raises(RefusedError, match="keep-out: a leg enters"):
        missions_of(made_plan(), placed_box(keep_out_m=through), MissionOptions())
    fence = np.array([[-12.0, -12.0], [30.0, -12.0], [30.0, 30.0], [-12.0, 30.0]])
    with pytest.raises(RefusedError, match="geofence"):
        missions_of(made_plan(), placed_box(geofence_m=fence), MissionOptions())
    way_in = flown[: 2 + mission.inspect.argmax()]
    direct = np.linalg.norm(way_in[-1] - way_in[0])
    assert not inside.any() and direct < np.linalg.norm(np.diff(way_in, axis=0), axis=1).sum() < 3 * direct


def test_thinning_stays_within_its_tolerance_and_keeps_viewpoints():
    path, scene = rounds(), scene_of(placed_box())
    fixed = np.arange(len(path)) % 40 == 0
    rules = Airspace(scene, 2.0, Surroundings())
    steps, reason, share = thinned(path, fixed, (0.2, 5.0), rules, (None, Camera()))
    assert np.isnan(share)
    assert set(np.flatnonzero(fixed)) <= set(steps) and len(steps) < len(path) / 2 and "clearance" in reason
    for first, last in pairwise(steps):
        leg = path.positions[last] - path.positions[first]
        between = path.positions[first : last + 1] - path.positions[first]
        share = np.clip(between @ leg / (leg @ leg), 0, 1)
        assert np.linalg.norm(between - share[:, None] * leg, axis=1).max() <= 0.2 + 1e-9


def test_thinning_never_takes_clearance_or_view():
    corner = np.array([[14.0, -3.0, 5.0], [14.0, 7.0, 5.0], [-2.0, 7.0, 5.0]])  # round an edge of the box
    positions = np.concatenate([a + np.linspace(0, 1, 30)[:, None] * (b - a) for a, b in pairwise(corner)])
    path = Trajectory(np.arange(60) * 0.5, positions, look_at(positions, np.tile([0.0, 0, 5.0], (60, 1))))
    scene = scene_of(placed_box())
    rules = Airspace(scene, 2.0, Surroundings())
    steps, _, _ = thinned(path, np.zeros(60, bool), (50.0, 180.0), rules, (None, Camera()))
    assert min_distance(scene, path.positions[steps]) >= 2.0 - 0.05
    plan = made_plan()
    ends = np.array([0, len(plan.trajectory) - 1])
    coarse = Trajectory(
        *(
            array[ends]
            for array in (plan.trajectory.t_s, plan.trajectory.positions, plan.trajectory.quat_xyzw)
        )
    )
    assert still_seen(plan.trajectory, plan.trajectory, scene, plan.surface, Camera()) == 1.0
    assert still_seen(plan.trajectory, coarse, scene, plan.surface, Camera()) < 0.7


def test_a_recording_whose_every_pose_is_a_viewpoint_is_thinned_and_photographed_where_needed():
    path = rounds(count=3000)
    (mission,) = missions_of(made_plan(path, every=1), placed_box(), MissionOptions())
    assert len(mission) < 300 and not mission.photo_distance_m and 10 < mission.photo.sum() < 80


def test_options_are_checked():
    for wrong in ({"max_waypoints": 3}, {"clearance_m": 0.0}, {"endurance_s": -1.0}, {"tolerance_m": -1.0},
                  {"overlap": "80"}, {"overlap": "80/x"}, {"overlap": "0/70"}, {"overlap": "80/100"},
                  {"trigger_s": 0.0}, {"camera": "kodak"}):  # fmt: skip
        with pytest.raises(SettingsError):
            MissionOptions(**wrong)
    assert PLACE.datum == "ellipsoid"


def test_the_camera_turns_as_the_vehicle_turns_it():
    quats = from_yaw_pitch(np.radians([0.0, 90.0, 90.0]), np.radians([0.0, -40.0, 20.0]))
    path = Trajectory(np.array([0.0, 10.0, 20.0]), np.zeros((3, 3)), quats)
    times = np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    angles = {
        turning: np.degrees(yaw_pitch(as_flown(path, times, turning).quat_xyzw)).round(6)
        for turning in ("evenly", "ahead", "on arrival")
    }
    assert angles["ahead"].tolist() == [[0, 90, 90, 90, 90], [0, -40, -40, 20, 20]]
    assert angles["on arrival"][1].tolist() == [0, 0, -40, -40, 20]
    assert np.allclose(angles["on arrival"][0], angles["evenly"][0])
    assert np.allclose(angles["evenly"][1, 3], -10)


def test_the_view_is_checked_as_the_vehicle_turns_the_camera():
    states, scene = made_plan().surface, scene_of(placed_box())
    positions = np.array([[-10.0, -12, 5], [10, -12, 5], [11, -12, 5]])
    quats = from_yaw_pitch(np.radians([90.0, 90.0, -90.0]), np.zeros(3))  # at the end it looks away
    past = Trajectory(np.array([0.0, 10.0, 10.5]), positions, quats)
    ends = Trajectory(past.t_s[[0, 2]], positions[[0, 2]], quats[[0, 2]])
    evenly, ahead = (
        still_seen(past, ends, scene, states, Camera(), turning) for turning in ("evenly", "ahead")
    )
    assert ahead < 0.7 * evenly < 1.0


def test_stops_count_against_the_battery_and_are_told():
    options = MissionOptions(endurance_s=300.0)
    straight = missions_of(made_plan(), placed_box(), options)
    stopping = missions_of(made_plan(), placed_box(), options, Flying(stop_s=5.0))
    assert len(stopping) > len(straight)
    assert all(mission.duration_s <= 240.0 for mission in stopping)
    assert "the flight time includes 5 s for the stop at each waypoint" in stopping[0].notes


def test_the_notes_say_what_heights_mean_and_how_high_the_way_home_is():
    (mission,) = missions_of(made_plan(), placed_box(), MissionOptions(home_m=(30.0, 0.0, -2.0)))
    notes = " ".join(mission.notes)
    assert "metres above the take-off point" in notes
    assert f"{mission.height_m[0]:.1f} m above take-off" in notes
    assert f"flight time about {mission.duration_s:.0f} s; battery not checked" in notes
    (mission,) = missions_of(made_plan(), placed_box(), MissionOptions(altitude="ellipsoid"))
    assert "WGS 84 ellipsoid" in " ".join(mission.notes)


def test_no_waypoint_of_the_ways_repeats_the_one_before():
    for home in (None, (30.0, 0.0, 0.0), (0.0, 25.0, 1.0)):
        for mission in missions_of(made_plan(), placed_box(), MissionOptions(home_m=home, endurance_s=200.0)):
            steps = np.linalg.norm(np.diff(mission.local, axis=0), axis=1)
            assert steps[~(mission.inspect[1:] & mission.inspect[:-1])].min() > 0.01


def test_a_turn_on_the_spot_takes_its_time_and_is_one_place():
    plan = made_plan(turning_on_the_spot(), every=1)
    (mission,) = missions_of(plan, placed_box(), MissionOptions(home_m=(0.0, -30.0, 0.0), photos="none"))
    at = np.flatnonzero(mission.inspect)
    assert np.allclose(mission.hold_s[at], [0, 0, 4, 0], atol=1e-6) and mission.hold_s.sum() < 4.001
    assert [len(stop) for stop in mission.stops].count(2) == 1
    assert sum(map(len, mission.stops)) == len(mission)
