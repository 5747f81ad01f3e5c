"""A log on its plan, what it truly saw, and the flight that shows what it left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import slow_after
from hypothesis import given, settings
from hypothesis import strategies as st

from upplied.config import CloudSettings, InspectionSettings, settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import from_yaw_pitch, interpolate, yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.planning.surface.samples import surface_samples
from upplied.planning.visibility.line_of_sight import visible
from upplied.planning.visibility.looks import sharp_looks
from upplied.planning.visibility.observations import TRULY, stations
from upplied.proof.align import align
from upplied.proof.as_flown import AsFlown, as_flown
from upplied.proof.bound import bound_m
from upplied.proof.frame import camera_offset
from upplied.proof.gap import gap_flight
from upplied.proof.inspected import looks_at, planned_looks, views_from
from upplied.proof.looks import looks_of
from upplied.proof.tour import safe_lengths, short_tour
from upplied.records import Camera, Floats, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.simulate import Wind, fly_trajectory

CUBE = member("cube-v1").structure
CAMERA = Camera(70.0, 55.0, 1.0, 25.0)
SCENE = scene_of(CUBE)
SURFACE = surface_samples(CUBE, SCENE, CloudSettings(surface_samples=600))


def at(path: Trajectory, first_s: float = 0.0, last_s: float = 1e9) -> Trajectory:
    between = (path.t_s >= first_s) & (path.t_s <= last_s)
    return Trajectory(
        path.t_s[between] - path.t_s[between][0], path.positions[between], path.quat_xyzw[between]
    )


@pytest.fixture(scope="module")
def plan() -> Trajectory:
    flown = fly(CUBE, "sides", seed=1).trajectory
    return interpolate(flown, np.arange(0.0, min(flown.t_s[-1], 150.0), 0.5))


@pytest.fixture(scope="module")
def flown(plan) -> Trajectory:
    return fly_trajectory(plan, wind=Wind(5.0), seed=3)


def judged(plan: Trajectory, log: Trajectory, photo_s: Floats | None = None) -> AsFlown:
    alignment = align(plan, log)
    return as_flown(plan, plan.t_s[::4], alignment, log, SURFACE, CAMERA, SCENE, photo_s)


def test_a_log_that_is_right_is_left_as_it_is(plan, flown):
    alignment = align(plan, flown)
    assert np.array_equal(alignment.flown.positions, flown.positions) and not alignment.jumps
    assert abs(alignment.clock_s) < 0.15 and alignment.camera_yaw_deg == 0 and alignment.residual_p95_m < 0.5
    report = judged(plan, flown)
    assert report.flown_pct > 98 and report.cross_track_p95_m < 0.5 and report.frechet_m < 1.0
    assert not [text for text in report.findings if "aborted" in text or "moved" in text]
    nearest = path_clearance(SCENE, flown.positions).distance_m
    stated = alignment.place_error_m  # the frame of a log that is right may be off by so much, too
    assert nearest - stated - 0.08 < report.clearance_m <= nearest - stated and stated < 0.7


@pytest.mark.ci
@settings(max_examples=8, deadline=None)
@given(
    st.floats(-40, 40),
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.floats(-3, 3),
    st.floats(-4, 4),
    st.integers(0, 3),
)
def test_clock_frame_and_camera_that_are_off_are_found_within_their_errors(clock, shift, turn, yaw_off, seed):
    path = fly(CUBE, "sides", seed=1).trajectory
    plan = interpolate(path, np.arange(0.0, 120.0, 0.5))
    rng = np.random.default_rng(seed)
    truth = interpolate(plan, np.arange(0.0, 120.0, 0.1))
    wobble = 0.03 * rng.standard_normal(truth.positions.shape)
    angle = np.radians(turn)
    rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    middle = truth.positions.mean(axis=0)
    moved = (truth.positions + wobble - middle) @ rotation.T + middle + np.array(shift)
    yaw, pitch = yaw_pitch(truth.quat_xyzw)
    log = Trajectory(truth.t_s + 41 + clock, moved, from_yaw_pitch(yaw + angle + np.radians(yaw_off), pitch))
    log = Trajectory(log.t_s - log.t_s[0] + 41 + clock, log.positions, log.quat_xyzw)
    alignment = align(plan, log)
    assert alignment.clock_s == pytest.approx(41 + clock, abs=0.05)
    assert np.abs(alignment.flown.positions - truth.positions).max() < 0.2
    assert np.sqrt(np.mean((alignment.flown.positions - truth.positions) ** 2)) < 0.09
    off = np.degrees(np.angle(np.exp(1j * (yaw_pitch(alignment.flown.quat_xyzw)[0] - yaw))))
    assert np.median(np.abs(off)) < 0.6


def test_a_jump_that_no_vehicle_flies_is_taken_out(plan, flown):
    late = flown.t_s > flown.t_s[-1] / 2
    off = late[:, None] * np.array([0.6, -0.8, 0.0])
    alignment = align(plan, Trajectory(flown.t_s, flown.positions + off, flown.quat_xyzw))
    ((when, size),) = alignment.jumps
    assert when == pytest.approx(flown.t_s[-1] / 2, abs=0.2) and size == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean((alignment.flown.positions - flown.positions) ** 2)) < 0.1


def test_what_was_not_flown_was_not_seen(plan, flown):
    whole, part = judged(plan, flown), judged(plan, at(flown, 0, 0.6 * flown.t_s[-1]))
    assert part.flown_pct == pytest.approx(60, abs=8)
    assert any(text.startswith("aborted, or the log is cut") for text in part.findings)
    assert (
        part.looks.seen <= whole.looks.seen
    ).all() and part.looks.seen.sum() < 0.9 * whole.looks.seen.sum()


def test_a_log_that_begins_late_is_laid_on_the_end_of_its_plan(plan, flown):
    report = judged(plan, at(flown, 0.5 * flown.t_s[-1]))
    assert 35 < report.flown_pct < 60 and any(text.startswith("started late") for text in report.findings)


def test_a_silent_stretch_shows_nothing_and_is_told(plan, flown):
    silent = (flown.t_s > 40) & (flown.t_s < 80)
    log = Trajectory(flown.t_s[~silent], flown.positions[~silent], flown.quat_xyzw[~silent])
    report = judged(plan, log)
    assert any("silent for 40 s" in text for text in report.findings)
    both = looks_of(at(flown, 0, 40), SURFACE, CAMERA, SCENE).seen
    both |= looks_of(at(flown, 80), SURFACE, CAMERA, SCENE).seen
    assert (report.looks.seen == both).mean() > 0.99


def test_a_log_of_one_pose_a_second_is_not_taken_for_silent(plan, flown):
    rng = np.random.default_rng(0)
    slow = interpolate(flown, np.cumsum(rng.uniform(0.8, 1.3, int(flown.t_s[-1] / 1.1))))
    report = judged(plan, slow)
    assert report.flown_pct > 95 and not any("silent" in text for text in report.findings)
    seen, known = report.looks.seen.sum(), judged(plan, flown).looks.seen.sum()
    assert seen > 0.97 * known


def test_a_flight_that_waits_is_matched_by_its_places(plan, flown):
    later = np.where(flown.t_s > 50, flown.t_s + 90, flown.t_s)
    pause = np.arange(50.1, 140, 0.1)
    hover = interpolate(flown, np.full(len(pause), 50.0))
    t = np.concatenate([flown.t_s[flown.t_s <= 50], pause, later[flown.t_s > 50]])
    order = np.argsort(t, kind="stable")
    positions = np.concatenate(
        [flown.positions[flown.t_s <= 50], hover.positions, flown.positions[flown.t_s > 50]]
    )
    quats = np.concatenate(
        [flown.quat_xyzw[flown.t_s <= 50], hover.quat_xyzw, flown.quat_xyzw[flown.t_s > 50]]
    )
    alignment = align(plan, Trajectory(t[order], positions[order], quats[order]))
    assert np.isnan(alignment.clock_s) and alignment.on_plan.mean() > 0.9
    assert np.nanmin(alignment.planned_s) < 3 and np.nanmax(alignment.planned_s) > plan.t_s[-1] - 3


def straying(path: Trajectory, seed: int = 0) -> Trajectory:
    """A log of a path at 10 Hz, with what a receiver adds."""
    fine = interpolate(path, np.arange(0.0, path.t_s[-1], 0.1))
    off = np.random.default_rng(seed).normal(0, 0.04, fine.positions.shape)
    return replace(fine, positions=fine.positions + off)


def paced(plan: Trajectory, *paces: float) -> Trajectory:
    """The plan in equal parts at paces of their own."""
    pace = np.array(paces)[np.minimum(len(paces) * plan.t_s // plan.t_s[-1], len(paces) - 1).astype(int)]
    times = np.concatenate([[0.0], np.cumsum(np.diff(plan.t_s) / pace[:-1])])
    return straying(replace(plan, t_s=times))


def reversed_(plan: Trajectory) -> Trajectory:
    last = plan.t_s[-1] - plan.t_s[::-1]
    return straying(Trajectory(last, plan.positions[::-1], plan.quat_xyzw[::-1]))


def silent(plan: Trajectory) -> Trajectory:
    log = straying(plan)
    return log.take((log.t_s < 0.4 * log.t_s[-1]) | (log.t_s > 0.52 * log.t_s[-1]))


@pytest.mark.parametrize(
    "fly_so",
    [
        lambda plan: paced(plan, 1 / 1.1),
        lambda plan: paced(plan, 0.8),
        lambda plan: paced(plan, 1.25),
        lambda plan: paced(plan, 0.8, 1.2, 0.9, 1.25),
        silent,
        reversed_,
    ],
    ids=["slower by 1.1", "slower by 1.25", "faster by 1.25", "changing", "silent", "reversed"],
)
def test_a_true_log_is_not_moved_whatever_its_pace_and_order(plan, fly_so):
    log = fly_so(plan)
    alignment = align(plan, log)
    assert not alignment.corrected and np.array_equal(alignment.flown.positions, log.positions)
    assert alignment.on_plan.mean() > 0.98 and alignment.residual_p95_m < 0.25
    there = interpolate(plan, np.sort(alignment.planned_s[alignment.on_plan]))
    assert np.ptp(there.t_s) > plan.t_s[-1] - 3
    assert (alignment.backwards > 0.9) == (fly_so is reversed_)


def test_a_larger_stand_off_all_round_is_no_error_of_the_frame(plan):
    middle = plan.positions.mean(axis=0)
    off = (plan.positions - middle) * [1, 1, 0]
    farther = plan.positions + 2.5 * off / np.linalg.norm(off, axis=1, keepdims=True)
    alignment = align(plan, straying(replace(plan, positions=farther)))
    assert not alignment.corrected and alignment.on_plan.mean() > 0.95


def test_half_a_flight_is_never_moved_as_a_jump_of_its_log(plan, flown):
    late = (flown.t_s > flown.t_s[-1] / 2)[:, None]
    away = replace(flown, positions=flown.positions + late * np.array([25.0, 0.0, 0.0]))
    assert not align(plan, away).jumps and np.array_equal(align(plan, away).flown.positions, away.positions)
    hole = np.abs(flown.t_s - flown.t_s[-1] / 2) > 0.6  # what jumps in a silence was flown in it
    beside = replace(flown, positions=flown.positions + late * np.array([4.0, 0.0, 0.0])).take(hole)
    assert not align(plan, beside).jumps


def test_the_way_through_a_silence_does_not_count_for_clearance(plan):
    """The chord cuts a corner of the structure, which nobody flew."""
    log = straying(plan)
    angle = np.unwrap(np.arctan2(*(log.positions - log.positions.mean(axis=0))[:, [1, 0]].T))
    away = np.flatnonzero(np.abs(angle - angle[0]) < np.radians(130))
    cut = log.take(np.setdiff1d(np.arange(len(log)), away[20:]))
    report = judged(plan, cut)
    stated = align(plan, cut).place_error_m  # comes off besides
    assert path_clearance(SCENE, cut.positions).distance_m < report.clearance_m + stated - 0.5
    pieces = np.split(cut.positions, np.flatnonzero(np.diff(cut.t_s) > 1) + 1)
    least = min(path_clearance(SCENE, piece).distance_m for piece in pieces)
    assert least - 0.15 < report.clearance_m + stated <= least
    assert report.silent_s == pytest.approx(np.diff(cut.t_s).max())
    assert any("clearance are unknown for that time" in text for text in report.findings)


def test_a_camera_that_stands_still_is_told(plan, flown):
    quats = flown.quat_xyzw.copy()
    stuck = (flown.t_s >= 30) & (flown.t_s < 50)
    quats[stuck] = quats[stuck.argmax()]
    report = judged(plan, Trajectory(flown.t_s, flown.positions, quats))
    assert any(text.startswith("the camera stood for") for text in report.findings)
    assert not any("camera stood" in text for text in judged(plan, flown).findings)


@pytest.mark.ci
def test_photos_decide_what_was_seen_and_missing_ones_are_counted(plan, flown):
    every = np.arange(0.0, flown.t_s[-1], 1.0)
    some = every[(every < 30) | (every > 60)]
    with_all, with_some = judged(plan, flown, every), judged(plan, flown, some)
    assert with_all.photos_missing == 0 and 8 <= with_some.photos_missing <= 20
    fewer = judged(plan, flown, every[::5])  # three of five viewpoints without one, as a mission thins them
    assert 0 < with_all.looks.seen.sum() - fewer.looks.seen.sum() < 20 and 0 < fewer.photos_missing < 10
    assert with_some.looks.seen.sum() < with_all.looks.seen.sum() <= judged(plan, flown).looks.seen.sum()
    none = judged(plan, flown, np.array([5.0]))
    assert none.looks.seen.sum() < 0.5 * with_all.looks.seen.sum()
    assert set(none.looks.t_s[none.looks.seen].tolist()) == {5.0}


def test_looks_say_from_where_each_patch_was_seen(flown):
    looks = looks_of(flown, SURFACE, CAMERA, SCENE)
    here = interpolate(flown, looks.t_s[looks.seen]).positions
    gap = np.linalg.norm(here - SURFACE.points[looks.seen], axis=1)
    assert np.allclose(gap, looks.distance_m[looks.seen], atol=1e-6) and gap.max() <= CAMERA.max_range_m
    assert (looks.incidence_deg[looks.seen] <= 75.001).all() and np.isnan(looks.distance_m[~looks.seen]).all()


def test_the_most_frontal_look_is_told_beside_the_nearest(flown):
    photos = np.arange(0.0, flown.t_s[-1], 2.0)
    looks = looks_of(flown, SURFACE, CAMERA, SCENE, photos, within_m=[6.0])
    poses = interpolate(flown, photos)
    seen = visible(poses.positions, poses.quat_xyzw, SURFACE, CAMERA, TRULY, SCENE).seen
    ray = poses.positions[:, None] - SURFACE.points
    gap = np.linalg.norm(ray, axis=2)
    off = np.degrees(np.arccos((ray * SURFACE.normals).sum(axis=2) / gap))
    for (_, incidence), far in zip(looks.frontal, (np.inf, 6.0), strict=True):
        least = np.where(seen & (gap <= far), off, np.inf).min(axis=0)
        assert np.allclose(np.where(np.isnan(incidence), np.inf, incidence), least, atol=1e-6)
    assert (looks.frontal[0][1] < looks.incidence_deg - 5)[looks.seen].any()
    assert np.isnan(looks.frontal[1][1]).sum() > np.isnan(looks.frontal[0][1]).sum()


# --- the camera --------------------------------------------------------------------------------


def round_a_tower(lag_s: float = 0.0, off_deg: float = 0.0) -> tuple[Trajectory, Trajectory]:
    """A camera that looks at a tower from all sides, now faster and now slower, and one that is late."""
    t = np.arange(0.0, 120.0, 0.1)

    def yaw(at):
        return 0.15 * at + 0.3 * np.sin(2 * np.pi * at / 17.0)

    place = np.column_stack([-5 * np.cos(yaw(t)), -5 * np.sin(yaw(t)), 2 + t / 30])
    straight = from_yaw_pitch(yaw(t), np.zeros(len(t)))
    late = from_yaw_pitch(yaw(t - lag_s) + np.radians(off_deg), np.zeros(len(t)))
    return Trajectory(t, place, straight), Trajectory(t, place, late)


@pytest.mark.parametrize("off_deg", [0.0, 2.0, -1.5])
@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.25])
def test_a_camera_that_is_late_is_not_taken_for_one_that_is_off(lag_s, off_deg):
    (yaw_off, error), (pitch, _) = camera_offset(*round_a_tower(lag_s, off_deg))
    assert np.degrees(yaw_off) == pytest.approx(-off_deg, abs=0.1)
    assert pitch == pytest.approx(0, abs=1e-6) and np.degrees(error) < 0.5


def test_a_vehicle_that_is_late_round_a_tower_is_not_taken_for_a_turned_frame():
    t = np.arange(0.0, 240.0, 0.1)
    yaw = 0.15 * t
    place = np.column_stack([-9 * np.cos(yaw), -9 * np.sin(yaw), 2 + 0.3 * t])
    plan = Trajectory(t, place, from_yaw_pitch(yaw, 0 * t))
    across = interpolate(plan, np.clip(t - 0.15, 0, None)).positions[:, :2]  # late, and not upwards
    late = np.column_stack([across, place[:, 2]])
    alignment = align(plan, Trajectory(t, late, plan.quat_xyzw))
    assert alignment.heading_deg == 0 and np.allclose(alignment.flown.positions, late)


def test_a_camera_that_turns_evenly_does_not_tell_which_it_is():
    t = np.arange(0.0, 120.0, 0.1)
    yaw = 0.15 * t
    even = [Trajectory(t, np.zeros((len(t), 3)), from_yaw_pitch(yaw + off, 0 * t)) for off in (0.0, -0.02)]
    (_, error), _ = camera_offset(*even)
    assert error > 0.02  # so nothing is corrected: it may be a lag of 0.13 s
    short = [each.take(each.t_s < 30) for each in even]
    assert camera_offset(*short)[0] == (0.0, np.inf)


def test_a_log_of_elsewhere_is_refused(plan, flown):
    away = Trajectory(flown.t_s, flown.positions + np.array([40.0, 0, 0]), flown.quat_xyzw)
    with pytest.raises(RefusedError, match="does not lie on the plan"):
        align(plan, away)


# --- gaps --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def graph(plan):
    airspace = Airspace(SCENE, 1.5, CUBE.surroundings)
    return roadmap(airspace, SURFACE, plan.positions[::4])


@pytest.mark.ci
@pytest.mark.parametrize("end", slow_after(1, [0.5, 0.65]))
def test_the_flight_that_closes_a_gap_shows_it_safely_and_is_short(plan, flown, graph, end):
    shown = looks_of(plan, SURFACE, CAMERA, SCENE).seen
    missing = shown & ~looks_of(at(flown, 0, end * flown.t_s[-1]), SURFACE, CAMERA, SCENE).seen
    assert missing.any()
    limits = settings_for("recommended").retime
    closing = gap_flight(plan, SURFACE, missing, CAMERA, graph, limits)
    again = looks_of(closing.trajectory, SURFACE, CAMERA, SCENE)
    assert again.seen[missing & ~closing.unattainable].mean() >= 0.995
    # as near and as frontally as the plan, by the looks of both
    look, part = looks_of(plan, SURFACE, CAMERA, SCENE), missing & closing.shows
    assert part.sum() > 0.97 * missing.sum()
    assert (again.distance_m[part] <= 1.1 * look.distance_m[part] + 0.2).mean() > 0.98
    assert (again.frontal[0][1][part] <= look.frontal[0][1][part] + 7).mean() > 0.98
    # and so that photos at its viewpoints inspect it as asked
    shots = looks_at(closing.trajectory, closing.trajectory.t_s[closing.is_viewpoint])
    looks = planned_looks(plan, SURFACE, CAMERA, SCENE, InspectionSettings())
    as_asked = looks.matched(views_from(shots.poses, SURFACE, CAMERA, SCENE), shots, SURFACE, CAMERA)
    assert as_asked[part].mean() > 0.97
    assert (closing.shows <= missing).all() and not (closing.shows & closing.unattainable).any()
    assert path_clearance(SCENE, closing.trajectory.positions).distance_m >= 1.49
    assert closing.bound_m <= closing.length_m < np.linalg.norm(np.diff(plan.positions, axis=0), axis=1).sum()
    assert closing.is_viewpoint.any() and (np.diff(closing.trajectory.t_s) > 0).all()


@pytest.mark.ci
def test_a_gap_is_flown_slowly_enough_for_sharp_pictures(plan, graph):
    """By an exposure of a fiftieth of a second the plan's own pace would blur them."""
    rule, limits = replace(InspectionSettings(), exposure_s=1 / 50), settings_for("recommended").retime
    missing = looks_of(plan, SURFACE, CAMERA, SCENE).seen & (SURFACE.points[:, 2] > 4)
    sharp = []
    for demand in (rule, InspectionSettings()):
        closing = gap_flight(plan, SURFACE, missing, CAMERA, graph, limits, rule=demand)
        shots = looks_at(closing.trajectory, closing.trajectory.t_s[closing.is_viewpoint])
        shown = views_from(shots.poses, SURFACE, CAMERA, SCENE)
        motion = rule.sharp_radps(CAMERA.hfov_deg), np.cos(np.radians(75))
        seen = sharp_looks(shots, shown, SURFACE, CAMERA, *motion).number > 0
        sharp.append(seen[missing & closing.shows].mean())
    assert sharp[0] > 0.99 > 0.9 > sharp[1]


def test_nothing_missing_and_nothing_to_see_it_from_are_refused(plan, graph):
    nothing = np.zeros(len(SURFACE), bool)
    with pytest.raises(RefusedError, match="is empty"):
        gap_flight(plan, SURFACE, nothing, CAMERA, graph, settings_for("recommended").retime)
    near_sighted = replace(CAMERA, max_range_m=1.5)
    with pytest.raises(RefusedError, match="is not visible from any safe pose"):
        gap_flight(plan, SURFACE, ~nothing, near_sighted, graph, settings_for("recommended").retime)


@pytest.mark.ci
def test_the_bound_is_never_above_the_best_way_by_brute_force():
    rng, shares = np.random.default_rng(0), []
    for _ in range(20):
        places = rng.random((6, 3)) * 10
        seen = rng.random((6, 5)) < 0.35
        seen[rng.integers(0, 6, 5), np.arange(5)] = True
        least = min(
            np.linalg.norm(np.diff(places[list(way)], axis=0), axis=1).sum()
            for way in _ways(6)
            if seen[list(way)].any(axis=0).all()
        )
        bound = bound_m(np.linalg.norm(places[:, None] - places[None], axis=2), seen)
        assert bound <= least + 1e-6
        shares.append(bound / least if least > 0 else 1.0)
    assert np.mean(shares) > 0.97 and min(shares) > 0.8


def test_the_tour_is_near_its_bound(plan, graph):
    """Every seventh pose flown: what is left stands all round the structure."""
    poses = stations(plan)
    poses = poses.take(graph.airspace.allowed(poses.positions))
    seen = visible(poses.positions, poses.quat_xyzw, SURFACE, CAMERA, TRULY, SCENE).seen
    parts = np.array_split(np.arange(len(poses)), 9)
    missing = ~seen[np.concatenate(parts[::2])].any(axis=0) & seen.any(axis=0)
    apart = safe_lengths(graph, poses.positions)
    straight = np.linalg.norm(poses.positions[:, None] - poses.positions[None], axis=2)
    assert (apart >= straight - 1e-6).all() and (apart > straight + 1).any()  # round the structure
    tour = short_tour(apart, seen[:, missing])
    length = apart[tour[:-1], tour[1:]].sum()
    assert seen[tour][:, missing].any(axis=0).all()
    assert bound_m(apart, seen[:, missing]) <= length + 1e-6 <= 1.15 * bound_m(apart, seen[:, missing]) + 1


def _ways(count: int):
    from itertools import combinations, permutations

    for size in range(1, count + 1):
        for chosen in combinations(range(count), size):
            yield from permutations(chosen)


def test_a_camera_that_looked_aside_all_the_time_is_not_turned_back_to_its_plan(plan, flown):
    """Corrected to its plan it would have seen everything."""
    yaw, pitch = yaw_pitch(flown.quat_xyzw)
    aside = replace(flown, quat_xyzw=from_yaw_pitch(yaw + np.radians(60.0), pitch))
    alignment = align(plan, aside)
    same = np.abs((alignment.flown.quat_xyzw * aside.quat_xyzw).sum(axis=1))
    assert alignment.camera_yaw_deg == 0 and same.min() > 1 - 1e-9
    assert any("looked" in text and "aside of its plan" in text for text in judged(plan, aside).findings)
    right, wrong = (judged(plan, log).looks.seen.mean() for log in (flown, aside))
    assert wrong < 0.7 * right
