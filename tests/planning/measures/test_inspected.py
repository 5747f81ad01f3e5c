"""What a plan shows as well, and how like the demonstration it looks, against brute force in numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from remembered import study_pair
from scipy.spatial.transform import Rotation

from upplied.config import settings_for
from upplied.geometry.poses import interpolate, look_at
from upplied.planning.carry.inspected_surface import inspected_by
from upplied.planning.constants import FACING
from upplied.planning.demonstration.repetition import Take, look_limits, takes_of
from upplied.planning.measures.fidelity import (
    Compared,
    bent_rad,
    fidelity,
    inspected_measures,
    order_kept,
    shown_of,
    turned_rad,
)
from upplied.planning.visibility.observations import TRULY, moments, rates, stations, views
from upplied.records import Bools, Floats, Trajectory
from upplied.samples.pilot import fly
from upplied.samples.surfaces import box

SETTINGS = settings_for("recommended", clouds={"surface_samples": 400})


@pytest.fixture(scope="module")
def take() -> Take:
    """A flight along three sides of a cube, to a cuboid."""
    source, target = box((12.0, 12.0, 12.0), "cube").structure, box((20.0, 12.0, 9.0), "cuboid").structure
    flight = fly(source, "sides", seed=3)
    return takes_of(flight, study_pair(source, target, SETTINGS), SETTINGS)[0]


@pytest.fixture(scope="module")
def plan(take: Take) -> Trajectory:
    """Half a round of the target, too near in one part and turning quickly in another."""
    angle = np.linspace(0.0, 3.6, 90)
    radius = np.where(angle < 1.2, 26.0, 17.0)[:, None]
    at = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(90)]) * radius + np.array([0.0, 0, 4.5])
    look = np.tile([0.0, 0.0, 4.5], (90, 1))
    look[60:70:2, :2] += np.column_stack([-at[60:70:2, 1], at[60:70:2, 0]])  # to and fro: nothing is sharp
    return Trajectory(np.arange(90) * 0.5, at, look_at(at, look))


def sees(take: Take, poses: Trajectory, target: bool) -> Bools:
    """Visibility by rays against a box of twelve triangles and by angles, one pose at a time."""
    structure = take.pair.target if target else take.pair.source
    cloud = take.pair.surface.target if target else take.pair.surface.source
    camera = take.inspection.camera
    seen = np.zeros((len(poses), len(cloud)), bool)
    for row, (at, quat) in enumerate(zip(poses.positions, poses.quat_xyzw, strict=True)):
        ray = cloud.points - at
        length = np.linalg.norm(ray, axis=1)
        here = Rotation.from_quat(quat).inv().apply(ray)
        inside = np.abs(np.arctan2(here[:, 1], here[:, 0])) <= np.radians(camera.hfov_deg) / 2
        inside &= np.abs(np.arctan2(here[:, 2], here[:, 0])) <= np.radians(camera.vfov_deg) / 2
        inside &= (length >= camera.min_range_m) & (length <= camera.max_range_m)
        inside &= -(ray * cloud.normals).sum(axis=1) >= np.cos(np.radians(75)) * length
        seen[row] = inside & (first_hit(structure.vertices, at, ray) >= 0.998)
    return seen


def first_hit(vertices: Floats, at: Floats, ray: Floats) -> Floats:
    """Where rays meet the box round some vertices first, in units of each ray (Moeller and Trumbore)."""
    corner = box_triangles(vertices.min(axis=0), vertices.max(axis=0))
    nearest = np.full(len(ray), np.inf)
    for a, b, c in corner:
        one, two = b - a, c - a
        across = np.cross(ray, two)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / (across @ one)
            u = (across @ (at - a)) * inverse
            v = (ray @ np.cross(at - a, one)) * inverse
            t = np.cross(at - a, one) @ two * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9)
        nearest = np.where(hit, np.minimum(nearest, t), nearest)
    return nearest


def box_triangles(low: Floats, high: Floats) -> Floats:
    """Twelve triangles (12, 3, 3)."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corner[[t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]]


def motion_by_difference(
    poses: Trajectory, row: int, points: Floats, velocity: Floats, turn: Floats
) -> Floats:
    """How far the direction of points in the camera's own frame turns in a millisecond, rad/s."""
    step = 1e-4
    frame = Rotation.from_quat(poses.quat_xyzw[row])
    before = frame.inv().apply(points - poses.positions[row])
    moved = Rotation.from_rotvec(turn * step) * frame
    after = moved.inv().apply(points - poses.positions[row] - velocity * step)
    before /= np.linalg.norm(before, axis=1)[:, None]
    after /= np.linalg.norm(after, axis=1)[:, None]
    return np.linalg.norm(after - before, axis=1) / step


@pytest.mark.ci
def test_shown_as_well_is_what_brute_force_says(take: Take, plan: Trajectory) -> None:
    planned = views(plan, take.pair.surface.target, take.inspection.camera, TRULY, take.pair.target_scene)
    show = shown_of(planned, [take], SETTINGS)
    inspected, cloud = show.inspected, show.inspected.cloud
    poses = stations(plan)
    seen = sees(take, poses, target=True)
    velocity, turn = rates(poses)
    sharp, _ = look_limits([take], SETTINGS.inspection)
    as_well = np.zeros(len(cloud), bool)
    for row in range(len(poses)):
        length = np.linalg.norm(cloud.points - poses.positions[row], axis=1)
        slow = motion_by_difference(poses, row, cloud.points, velocity[row], turn[row]) <= sharp
        facing = ((poses.positions[row] - cloud.points) * cloud.normals).sum(
            axis=1
        )  # length times the cosine
        near = length**2 <= np.nan_to_num(inspected.standoff_m) / 0.8 * facing
        as_well |= seen[row] & slow & near
    needed = inspected.need > 0
    assert 0.05 < as_well[needed].mean() < 0.9  # the plan shows some of it, and misses some
    assert np.mean(as_well[needed] != show.as_well[needed]) < 0.01
    share = 100 * inspected.need[as_well].sum() / (inspected.need.sum() + inspected.without)
    measures = inspected_measures(show, planned, [take])
    assert measures["coverage_inspected_pct"] == pytest.approx(share, abs=1.0)
    assert measures["coverage_inspected_pct"] < 100


@pytest.mark.ci
def test_what_is_asked_for_is_the_best_sharp_look_of_the_demonstration(take: Take) -> None:
    unscaled = replace(SETTINGS, transfer=replace(SETTINGS.transfer, standoff="kept"))
    surface = inspected_by(take, unscaled)
    inspection, fit = take.inspection, take.pair.surface
    steps = moments(inspection.logged)
    seen = sees(take, steps.poses, target=False)
    sharp, _ = look_limits([take], SETTINGS.inspection)
    near = np.full(len(fit.source), np.inf)
    for row in range(len(steps)):
        moved = motion_by_difference(
            steps.poses, row, fit.source.points, steps.velocity[row], steps.turn[row]
        )
        length = np.linalg.norm(fit.source.points - steps.poses.positions[row], axis=1)
        facing = ((steps.poses.positions[row] - fit.source.points) * fit.source.normals).sum(axis=1)
        fine = length**2 / np.where(seen[row], facing, np.inf)
        near = np.where(seen[row] & (moved <= sharp), np.minimum(near, fine), near)
    match, cloud, weight = fit.correspondences, fit.target, inspection.attention.weight
    turned = FACING * np.linalg.norm(np.ptp(cloud.points, axis=0))
    mapped = np.flatnonzero(match.target_index >= 0)
    places, like = match.target_points[mapped], match.target_index[mapped]
    step = [np.sort(np.linalg.norm(places - place, axis=1))[4] for place in places]
    step_m = max(np.median(step), np.sqrt(cloud.areas.mean()))
    need, distance = np.zeros(len(cloud)), np.zeros(len(cloud))
    for sample, place in enumerate(cloud.points):
        away = np.linalg.norm(places - place, axis=1)
        off = np.hypot(away, turned * np.linalg.norm(cloud.normals[like] - cloud.normals[sample], axis=1))
        round_ = np.argsort(np.maximum(off, 1e-9), kind="stable")[:7]
        share = (1 / np.maximum(off[round_], 1e-9) - 1 / max(off[round_[-1]], 1e-9)) ** 2
        share *= cloud.part[like[round_]] == cloud.part[sample]
        if not share.sum() > 0:
            continue
        facing = cloud.normals[like[round_]] @ cloud.normals[sample]
        beside = np.clip(2 - away[round_].min() / step_m, 0, 1)  # two spacings from all it is nobody's
        share = share / share.sum() * np.clip(4 * facing - 2, 0, 1) * beside * weight[mapped[round_]]
        share = np.where(np.isfinite(near[mapped[round_]]), share, 0.0)
        need[sample] = cloud.areas[sample] * share.sum()
        distance[sample] = cloud.areas[sample] * (share * np.nan_to_num(near[mapped[round_]], posinf=0)).sum()
    known = need > 0
    assert surface.need.sum() == pytest.approx(need.sum(), rel=0.01)
    off = np.abs(surface.standoff_m[known] / (distance[known] / need[known]) - 1)
    assert np.quantile(off, 0.95) < 0.03  # what is seen from a pose and from its neighbour differs at edges


def test_without_counterpart_counts_as_not_shown(take: Take, plan: Trajectory) -> None:
    match = take.pair.surface.correspondences
    index = match.target_index.copy()
    index[take.pair.surface.source.points[:, 0] > 5.9] = -1  # the front face
    fit = replace(take.pair.surface, correspondences=replace(match, target_index=index))
    fewer = replace(take, pair=replace(take.pair, surface=fit))
    planned = views(plan, fit.target, take.inspection.camera, TRULY, take.pair.target_scene)
    show = shown_of(planned, [fewer], SETTINGS)
    measures = inspected_measures(show, planned, [fewer])
    weight = take.inspection.attention.weight * fit.source.area_m2
    lost = 100 * weight[index < 0].sum() / weight.sum()
    assert measures["inspected_without_counterpart_pct"] == pytest.approx(lost, abs=0.1) and lost > 10
    assert measures["coverage_inspected_pct"] <= 100 - lost + 1e-9


def same_place(take: Take) -> Take:
    """The cube as its own target."""
    pair = study_pair(take.pair.source, take.pair.source, SETTINGS)
    return takes_of(take.attended.flight, pair, SETTINGS)[0]


def compared(own: Take, path: Trajectory) -> dict[str, float]:
    """The fidelity of a path to the take."""
    planned = views(path, own.pair.surface.target, own.inspection.camera, TRULY, own.pair.target_scene)
    return fidelity(Compared.of(path, planned, inspected_by(own, SETTINGS), [own], SETTINGS))


@pytest.mark.ci
def test_flying_the_demonstration_itself_shows_all_of_it(take: Take) -> None:
    own = same_place(take)
    flown = own.inspection.logged
    planned = views(flown, own.pair.surface.target, own.inspection.camera, TRULY, own.pair.target_scene)
    show = shown_of(planned, [own], SETTINGS)
    measures = inspected_measures(show, planned, [own])
    measures |= compared(own, flown)
    assert measures["coverage_inspected_pct"] > 99
    assert measures["coverage_of_target_pct"] > 99 and measures["coverage_context_pct"] > 99
    assert measures["fidelity_resolution_p50"] == pytest.approx(1, abs=0.01)
    assert measures["fidelity_resolution_p05"] == pytest.approx(1, abs=0.05)
    assert abs(measures["fidelity_incidence_deg_p95"]) < 1
    assert measures["fidelity_looks_kept_pct"] > 99 and measures["fidelity_dwell_kept_pct"] > 99
    assert measures["fidelity_order"] > 0.99
    assert measures["camera_turn_ratio"] == pytest.approx(1, abs=1e-9)
    assert measures["path_turn_ratio"] == pytest.approx(1, abs=1e-9)
    assert measures["pan_fast_pct"] <= 5.5  # never stricter than the expert's own 95 %


def test_flown_backwards_the_order_is_reversed_and_the_looks_are_kept(take: Take) -> None:
    own = same_place(take)
    flown = own.inspection.logged
    back = Trajectory(flown.t_s[-1] - flown.t_s[::-1], flown.positions[::-1], flown.quat_xyzw[::-1])
    measures = compared(own, back)
    assert measures["fidelity_order"] < -0.95
    assert measures["fidelity_looks_kept_pct"] > 99


def test_from_the_other_side_no_look_is_kept(take: Take) -> None:
    own = same_place(take)
    flown = own.inspection.logged
    high = flown.positions + np.array([0.0, 0, 25.0])
    above = Trajectory(flown.t_s, high, look_at(high, np.zeros_like(high)))
    measures = compared(own, above)
    assert measures["fidelity_looks_kept_pct"] < 30
    assert measures["fidelity_incidence_deg_p95"] > 30 and measures["fidelity_resolution_p50"] < 0.6


def test_tau_is_that_of_all_pairs() -> None:
    rng = np.random.default_rng(0)
    before, after = rng.random(60), rng.random(60)
    pairs = [np.sign((before[i] - before[j]) * (after[i] - after[j])) for i in range(60) for j in range(i)]
    assert order_kept(before, after) == pytest.approx(np.mean(pairs))
    assert np.isnan(order_kept(before[:1], after[:1]))


def test_turning_is_counted_without_trembling() -> None:
    yaw = np.radians(np.concatenate([np.linspace(0, 90, 91), np.linspace(90, 30, 61)]))
    jitter = np.radians(np.random.default_rng(0).normal(0, 0.5, len(yaw)))
    quats = Rotation.from_euler("z", (yaw + jitter)[:, None]).as_quat()
    assert np.degrees(turned_rad(quats)) == pytest.approx(150, abs=8)
    still = Rotation.from_euler("z", jitter[:, None]).as_quat()
    assert turned_rad(still) == 0.0
    angle = np.linspace(0, np.pi, 200)
    arc = 20 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    assert np.degrees(bent_rad(arc, 1.0)) == pytest.approx(180, abs=10)
    assert bent_rad(np.column_stack([angle, 0 * angle, 0 * angle]) * 30, 1.0) == 0.0


def test_moments_do_not_depend_on_the_logs_rate(take: Take) -> None:
    flown = take.inspection.logged
    often = interpolate(flown, np.linspace(0, flown.t_s[-1], 5 * len(flown)))
    one, other = moments(flown), moments(often)
    assert len(one) == len(other) and one.step_s.sum() == pytest.approx(flown.t_s[-1])
    assert np.abs(one.poses.positions - other.poses.positions).max() < 0.02
    assert np.abs(one.velocity - other.velocity).max() < 0.1
    gap = moments(flown, np.array([40]))
    assert gap.step_s.sum() == pytest.approx(flown.t_s[-1] - (flown.t_s[40] - flown.t_s[39]))


def test_a_pose_between_two_gaps_lasts_no_time() -> None:
    at = np.zeros((5, 3))
    flight = Trajectory(np.arange(5.0), at, np.tile([0.0, 0, 0, 1], (5, 1)))
    steps = moments(flight, np.array([2, 3]))
    assert steps.step_s.sum() == pytest.approx(2.0) and 0.0 in steps.step_s


def test_a_log_of_one_pose_is_measured() -> None:
    one = Trajectory(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0, 0, 1]]))
    assert len(moments(one)) == 1
    assert turned_rad(one.quat_xyzw) == 0.0 and bent_rad(one.positions, 1.0) == 0.0
