"""What a flight was about: the intended part of flights whose meaning is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import CloudSettings, InspectionSettings
from upplied.errors import SettingsError
from upplied.geometry.poses import look_at, matrices
from upplied.geometry.scene import scene_of
from upplied.planning.demonstration.attention import Attention, _subject, attention
from upplied.planning.demonstration.inspection import zone_of
from upplied.planning.surface.frames import structure_in
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.observations import TRULY, Moments, Views, moments, views
from upplied.records import Camera, Cloud, Demonstration, Floats, Frame, Ints, Structure, Trajectory
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

SUBJECTS = {
    ("a320-v1", "engine_left"): ("engine_left", "pylon_left"),
    ("a320-v1", "wings"): ("wing", "engine", "pylon", "fairing"),
    ("a320-v1", "fuselage"): ("fuselage", "fairing", "fin", "stabiliser"),
    ("turbine-1-v1", "tower"): ("tower",),
    ("bridge-1-v1", "piers"): ("pier", "cap"),
}


@cache
def sampled(structure: Structure, seed: int = 0) -> tuple[Cloud, Ints]:
    scene = scene_of(structure)
    cloud = surface_samples(structure, scene, CloudSettings(seed=seed))
    return cloud, skin_parts(structure, scene, cloud).label


def attended(flight: Demonstration, structure: Structure) -> Attention:
    cloud, part = sampled(structure)
    shown = views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))
    settings = InspectionSettings()
    return attention(flight.trajectory, flight.breaks, flight.camera, cloud, shown, part[None], settings)


@cache
def named(structure_id: str) -> Floats:
    """The name of the part that each sample lies on."""
    structure = member(structure_id)
    triangle = scene_of(structure.structure).closest(sampled(structure.structure)[0].points)[1]
    return np.array(structure.part_names)[structure.part_of_triangle[triangle]]


def on_meant(attention: Attention, structure_id: str, inspection: str) -> float:
    """Share of the weight on what the flight was meant for."""
    mine = np.array([name.startswith(SUBJECTS[structure_id, inspection]) for name in named(structure_id)])
    weight = attention.weight * sampled(member(structure_id).structure)[0].area_m2
    return float(weight[mine].sum() / weight.sum())


@pytest.mark.parametrize(("structure_id", "inspection"), SUBJECTS)
def test_the_weight_lies_on_what_was_meant(structure_id: str, inspection: str) -> None:
    structure = member(structure_id).structure
    actual = attended(fly(structure, inspection, seed=11), structure)
    assert on_meant(actual, structure_id, inspection) > 0.85
    assert actual.weight.min() >= 0 and actual.weight.max() <= 1


def test_a_longer_reach_changes_little() -> None:
    structure = member("a320-v1").structure
    flight = fly(structure, "engine_left", seed=11)
    far = replace(flight, camera=replace(flight.camera, max_range_m=100.0))
    weights = [attended(one, structure).weight for one in (flight, far)]
    assert np.abs(weights[0] - weights[1]).mean() < 0.03 * weights[0].mean()


def test_who_sees_nothing_was_about_nothing() -> None:
    structure = member("cube-v1").structure
    flight = fly(structure, "sides")
    away = replace(flight, positions=flight.positions + np.array([1000.0, 0, 0]))
    actual = attended(away, structure)
    assert not actual.weight.any() and np.isnan(actual.subject_m)


def test_the_user_says_what_it_was_about() -> None:
    structure = member("a320-v1").structure
    cloud, skin = sampled(structure)
    zone = zone_of("engine_left", structure, cloud, skin)
    assert zone is not None and np.char.startswith(named("a320-v1")[zone], "engine_left").mean() > 0.8
    box = zone_of("box 0 2 0 20 9 5, engine_right", structure, cloud, skin)
    inside = ((cloud.points >= [0, 2, 0]) & (cloud.points <= [20, 9, 5])).all(axis=1)
    assert box is not None and box[inside].all()
    assert np.char.startswith(named("a320-v1")[box & ~inside], "engine_right").mean() > 0.8
    assert zone_of(" ", structure, cloud, skin) is None
    flight = fly(structure, "fuselage", seed=11)
    shown = views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))
    facts = (flight.trajectory, flight.breaks, flight.camera, cloud, shown, skin, InspectionSettings())
    actual = attention(*facts, zone)
    assert actual.weight[zone].max() > 0.9 and not actual.weight[~zone].any()


@pytest.mark.parametrize(
    "bad", ["engine_middle", "box 1 2 3", "box a b c d e f", "part_999", "box 0 0 900 1 1 901"]
)
def test_what_names_nothing_is_refused_in_words(bad: str) -> None:
    structure = member("a320-v1").structure
    with pytest.raises(SettingsError, match="about"):
        zone_of(bad, structure, *sampled(structure))


def test_a_box_is_meant_in_the_declared_frame() -> None:
    structure = member("a320-v1").structure
    turned = structure_in(Frame(0.7, np.array([3.0, 1.0, 0.0])), structure)
    word = "box 0 2 0 20 9 5"
    declared, inside = (
        zone_of(word, one, Cloud(one.vertices, np.zeros_like(one.vertices)), np.zeros(len(one.vertices), int))
        for one in (structure, turned)
    )
    assert declared is not None and declared.any() and (declared == inside).all()


def drawn(seed: int) -> tuple[Trajectory, Cloud, Views, Ints]:
    """A few poses before random patches, some of them behind others' normals."""
    rng = np.random.default_rng(seed)
    at = np.array([-9.0, 0, 0]) + np.cumsum(rng.normal(0, 0.25, (41, 3)), axis=0)
    flight = Trajectory(np.linspace(0, 10, 41), at, look_at(at, rng.normal(0, 0.4, (41, 3))))
    points = rng.normal(0, 2.0, (60, 3)) + np.where(rng.random((60, 1)) < 0.3, [8.0, 0, 0], [0.0, 0, 0])
    normals = rng.normal(size=(60, 3)) - np.array([1.5, 0, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = Cloud(points, normals, rng.uniform(0.5, 2, 60))
    part = (points[:, 0] > 3).astype(np.int64) + (points[:, 1] > 0)
    return flight, cloud, Views(flight, rng.random((41, 60)) < 0.7), part


def quantile(values: Floats, weight: Floats, share: float) -> float:
    order = np.argsort(values, kind="stable")
    return float(values[order][np.searchsorted(np.cumsum(weight[order]), share * weight.sum())])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("named_by_user", [False, True])
def test_attention_is_what_its_five_steps_say(seed: int, named_by_user: bool) -> None:
    flight, cloud, shown, part = drawn(seed)
    assert cloud.normals is not None and cloud.area_m2 is not None
    zone = cloud.points[:, 2] > 0 if named_by_user else None
    settings = InspectionSettings(max_motion_px=3.0)
    camera = Camera(75, 75, 0.5, 60)
    actual = attention(flight, np.empty(0, np.int64), camera, cloud, shown, part[None], settings, zone)
    steps, area = moments(flight), cloud.area_m2
    seen = shown.seen[np.abs(shown.stations.t_s[:, None] - steps.poses.t_s).argmin(axis=0)]
    rays = cloud.points - steps.poses.positions[:, None]
    length = np.linalg.norm(rays, axis=2)
    x, y, z = np.moveaxis(np.einsum("kij,kni->knj", matrices(steps.poses.quat_xyzw), rays), 2, 0)
    cosine = -(rays * cloud.normals).sum(axis=2) / length
    middle = np.exp(-((y / x) ** 2 + (z / x) ** 2) / (2 * 0.2**2))
    fills = middle * np.maximum(cosine, 0) * area / length**2 * seen * (x > 0)
    depth = np.array([quantile(x[k], fills[k], 0.3) if fills[k].any() else np.inf for k in range(len(steps))])
    known = np.isfinite(depth)
    way = (np.linalg.norm(steps.velocity, axis=1) + 0.1) * steps.step_s
    subject = quantile(depth[known], (way / depth**2)[known], 0.5)
    assert actual.subject_m == pytest.approx(subject)
    limit = (
        np.where(depth <= 1.5 * subject, 1.3 * depth, 0.0) if zone is None else np.full(len(steps), np.inf)
    )
    across = (
        steps.velocity[:, None]
        - rays * (rays * steps.velocity[:, None]).sum(axis=2)[..., None] / length[..., None] ** 2
    )
    moved = np.linalg.norm(
        np.cross(steps.turn[:, None], rays / length[..., None]) + across / length[..., None], axis=2
    )
    weight_s = steps.step_s[:, None] * np.minimum(1, settings.sharp_radps(75) / moved)
    weight_s = weight_s * seen * (x > 0) * (x <= limit[:, None])
    gazed = 1 - np.exp(-(weight_s * middle).sum(axis=0) / 4.0)
    complete = np.array([np.average(gazed[part == one], weights=area[part == one]) for one in range(3)])
    complete /= np.average(complete[part], weights=area * gazed)
    share = np.clip((complete - 0.4) / 0.2, 0, 1)[part]
    subject_share = share**2 * (3 - 2 * share) if zone is None else zone
    weight = subject_share * (1 - np.exp(-weight_s.sum(axis=0) / 1.0))
    assert actual.weight == pytest.approx(weight)
    looks = seen * (weight * area) * steps.step_s[:, None]
    blur = quantile(moved.ravel(), looks.ravel(), 0.95)
    tilt = quantile(np.degrees(np.arccos(np.clip(cosine, 0, 1))).ravel(), looks.ravel(), 0.95)
    assert blur <= actual.motion_radps <= blur * np.exp(0.021)
    assert tilt <= actual.incidence_deg <= tilt + 0.51


def test_areas_of_one_are_understood() -> None:
    flight, cloud, shown, part = drawn(1)
    plain = Cloud(cloud.points, cloud.normals)
    ones = replace(cloud, area_m2=np.ones(60))
    settings, nowhere = InspectionSettings(), np.empty(0, np.int64)
    one, other = (
        attention(flight, nowhere, Camera(), of, shown, part[None], settings) for of in (plain, ones)
    )
    assert np.array_equal(one.weight, other.weight) and one.subject_m == other.subject_m


def test_what_was_seen_from_behind_alone_was_no_subject() -> None:
    at = np.tile([-5.0, 0, 0], (5, 1))
    flight = Trajectory(np.arange(5.0), at, np.tile([0.0, 0, 0, 1], (5, 1)))
    away = Cloud(np.zeros((2, 3)), np.tile([1.0, 0, 0], (2, 1)), np.ones(2))
    shown = Views(flight, np.ones((5, 2), bool))
    actual = attention(
        flight, np.empty(0, np.int64), Camera(), away, shown, np.zeros((1, 2), int), InspectionSettings()
    )
    assert np.isnan(actual.subject_m) and not actual.weight.any()
    assert actual.motion_radps == 0 and actual.incidence_deg == 0


@pytest.mark.parametrize("seed", range(10))
def test_the_subject_stands_where_half_of_the_way_flown_was_nearer(seed: int) -> None:
    """In pictures' widths: a metre flown at twice the depth is a quarter of the evidence."""
    rng = np.random.default_rng(seed)
    number = 9
    step, velocity = rng.uniform(0.2, 3, number), (seed % 2) * rng.normal(0, 2, (number, 3))  # or hovering
    depth, known = rng.uniform(2, 40, number), rng.random(number) < 0.8
    known[:2] = True
    flight = Trajectory(np.arange(float(number)), np.zeros((number, 3)), np.tile([0.0, 0, 0, 1], (number, 1)))
    distance = _subject(Moments(flight, step, velocity, np.zeros((number, 3))), depth, known)
    weight = {at: (np.linalg.norm(velocity[at]) + 0.1) * step[at] / depth[at] ** 2
              for at in range(number) if known[at]}  # fmt: skip
    whole, passed = sum(weight.values()), 0.0
    for at in sorted(weight, key=lambda each: depth[each]):
        passed += weight[at]
        if passed >= whole / 2:
            break
    assert distance == pytest.approx(depth[at])


def test_where_divisions_of_the_skin_disagree_a_sample_is_meant_by_their_share() -> None:
    flight, cloud, shown, part = drawn(1)
    settings, nowhere = InspectionSettings(), np.empty(0, np.int64)

    def weighed(stretch: Ints) -> Floats:
        return attention(flight, nowhere, Camera(), cloud, shown, stretch, settings).weight

    one = np.zeros_like(part)
    both = weighed(np.stack([part, part, one]))
    np.testing.assert_allclose(both, (2 * weighed(part[None]) + weighed(one[None])) / 3)
