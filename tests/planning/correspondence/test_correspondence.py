"""Laws of the correspondences."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from true_counterparts import true_counterparts

from upplied.config import CorrespondenceSettings, settings_for
from upplied.errors import SettingsError
from upplied.geometry.scene import scene_of
from upplied.planning.correspondence.correspondences import correspond
from upplied.planning.correspondence.registration import register
from upplied.planning.geometry.clouds import box_scale
from upplied.planning.surface.samples import surface_samples
from upplied.records import Cloud, Correspondences, Registration
from upplied.samples.fleet import member, shape_of
from upplied.samples.parametric import turbine

PAPER = settings_for("paper")


def cloud(seed: int) -> Cloud:
    points = np.random.default_rng(seed).normal(size=(300, 3)) * [9.0, 4.0, 2.0]
    return Cloud(points=points, leaf_m=1.0)


def test_nearest_of_itself_is_itself() -> None:
    one = cloud(0)
    correspondences = correspond(one, one, register(one, one, PAPER.registration), PAPER.correspondence)
    np.testing.assert_array_equal(correspondences.target_index, np.arange(len(one)))
    np.testing.assert_allclose(correspondences.distance_m, 0, atol=1e-9)


def test_nearest_is_the_one_of_brute_force() -> None:
    source, target = cloud(0), cloud(1)
    registration = register(source, target, PAPER.registration)
    correspondences = correspond(source, target, registration, PAPER.correspondence)
    aligned = registration.to_demo(target.points)
    distances = np.linalg.norm(source.points[:, None] - aligned[None], axis=2)
    np.testing.assert_array_equal(correspondences.target_index, distances.argmin(axis=1))
    np.testing.assert_allclose(correspondences.distance_m, distances.min(axis=1))
    np.testing.assert_array_equal(correspondences.target_points, target.points[correspondences.target_index])


RECOMMENDED = settings_for("recommended")
BY_PARTS = CorrespondenceSettings(method="parts")


@cache
def surface(structure_id: str) -> Cloud:
    structure = member(structure_id).structure
    return surface_samples(structure, scene_of(structure, 1), RECOMMENDED.clouds)


def box_on_box(source: Cloud, target: Cloud) -> Registration:
    scale = box_scale(source.points, target.points)
    offset = source.points.min(axis=0) - scale * target.points.min(axis=0)
    return Registration(scale, np.eye(3), offset, 0.0, True)


def named_parts(structure_id: str, points: np.ndarray) -> np.ndarray:
    structure = member(structure_id)
    triangle = scene_of(structure.structure, 1).closest(points)[1]
    return np.array(structure.part_names)[structure.part_of_triangle[triangle]]


def counterparts(source: str, target: str, **changes: object) -> Correspondences:
    one, other = surface(source), surface(target)
    settings = replace(BY_PARTS, **changes)
    return correspond(one, other, box_on_box(one, other), settings)


@pytest.mark.parametrize("structure_id", ["a320-v1", "cube-v1", "cruise-v1"])
def test_by_parts_itself_answers_to_itself(structure_id: str) -> None:
    actual = counterparts(structure_id, structure_id)
    np.testing.assert_array_equal(actual.target_index, np.arange(len(surface(structure_id))))
    np.testing.assert_allclose(actual.target_points, surface(structure_id).points, atol=1e-9)


@pytest.mark.parametrize(
    ("source", "target", "error", "right"),
    [
        ("a320-v1", "b777-v1", 0.7, 99),
        ("b777-v1", "b747-v1", 0.7, 98.9),
        ("turbine-1-v1", "turbine-3-v1", 0.4, 99),
        ("cube-v1", "cuboid-v1", 0.1, 99),
        ("bridge-1-v1", "bridge-2-v1", 0.3, 99),
        ("yacht-1-v1", "yacht-2-v1", 0.8, 99.5),  # one tier less: the top one has no counterpart
        ("cruise-v1", "yacht-1-v1", 1.2, 99),  # nor have funnel and lifeboats
        ("cruise-v1", "yacht-2-v1", 1.8, 99),  # nor have two of four tiers
    ],
)
def test_true_counterparts_are_found(source: str, target: str, error: float, right: float) -> None:
    one = surface(source)
    actual = counterparts(source, target)
    truth = true_counterparts(source, target, one.points)
    known = np.isfinite(truth[:, 0]) & (actual.target_index >= 0)
    off = np.linalg.norm(actual.target_points - truth, axis=1)[known]
    assert 100 * np.average(off, weights=one.area_m2[known]) < error * member(target).structure.diagonal_m
    there = named_parts(target, surface(target).points)[actual.target_index]
    same = np.where(
        np.isfinite(truth[:, 0]), there == named_parts(source, one.points), actual.target_index < 0
    )
    assert 100 * np.average(same, weights=one.area_m2) > right


def test_parts_without_a_partner_have_no_counterpart() -> None:
    actual = counterparts("b747-v1", "a320-v1")
    name = named_parts("b747-v1", surface("b747-v1").points)
    outer = np.char.endswith(name, "engine_left_outer") | np.char.endswith(name, "engine_right_outer")
    assert (actual.target_index[outer] < 0).mean() > 0.95
    assert np.isnan(actual.target_points[actual.target_index < 0]).all()
    assert np.isnan(actual.distance_m[actual.target_index < 0]).all()
    assert (actual.target_index[~outer] >= 0).mean() > 0.97
    assert "no counterpart on the target: part_" in actual.summary


@pytest.mark.parametrize(("place", "engine"), [("outer", "engine_left_outer"), ("inner", "engine_left")])
def test_the_user_says_which_engine(place: str, engine: str) -> None:
    points = surface("a320-v1").points
    name = named_parts("a320-v1", points)
    landmarks = {"left_engine": tuple(points[name == "engine_left"].mean(axis=0) - np.array([0, 0, 1]))}
    one, other = surface("a320-v1"), surface("b747-v1")
    settings = replace(BY_PARTS, counterparts=(("left_engine", place),))
    correspondences = correspond(one, other, box_on_box(one, other), settings, landmarks)
    there = named_parts("b747-v1", other.points)[correspondences.target_index[name == "engine_left"]]
    assert (there == engine).mean() > 0.9


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SettingsError, match=r"'nose'.*source.*part_0 to part_"):
        counterparts("a320-v1", "b747-v1", counterparts=(("nose", "outer"),))
    with pytest.raises(SettingsError, match=r"'third'.*target.*outer"):
        counterparts("a320-v1", "b747-v1", counterparts=(("part_1", "third"),))


def test_moving_the_target_moves_the_counterparts() -> None:
    one, other = surface("turbine-1-v1"), surface("turbine-2-v1")
    before = correspond(one, other, box_on_box(one, other), BY_PARTS)
    shift = np.array([50.0, -20, 7])
    moved = replace(other, points=other.points + shift)
    after = correspond(one, moved, box_on_box(one, moved), BY_PARTS)
    np.testing.assert_array_equal(before.target_index, after.target_index)
    np.testing.assert_allclose(after.target_points, before.target_points + shift, atol=1e-6)


def test_blades_follow_a_turned_rotor() -> None:
    shape = replace(shape_of("turbine-1-v1"), azimuth_deg=40.0)
    turned = turbine(shape, "turned-v1").structure
    one = surface("turbine-1-v1")
    other = surface_samples(turned, scene_of(turned, 1), RECOMMENDED.clouds)
    correspondences = correspond(one, other, box_on_box(one, other), BY_PARTS)
    name = named_parts("turbine-1-v1", one.points)
    truth = true_counterparts("turbine-1-v1", turbine(shape, "turned-v1"), one.points)
    blades = np.char.startswith(name, "blade")
    off = np.linalg.norm(correspondences.target_points - truth, axis=1)[blades]
    assert off.mean() < 0.01 * turned.diagonal_m


def test_a_strip_cut_off_with_the_wing_answers_to_the_fuselage_still() -> None:
    source, target = surface("a320-v1"), surface("b777-v1")
    names = named_parts("a320-v1", source.points)
    assert source.part is not None and source.normals is not None and target.normals is not None
    part = source.part.copy()
    wing = np.array([name.startswith("wing") for name in names])
    root = wing & (np.abs(source.points[:, 1]) < np.quantile(np.abs(source.points[wing, 1]), 0.15))
    low, high = source.points[root].min(axis=0), source.points[root].max(axis=0)
    inside = (source.points[:, [0, 2]] > low[[0, 2]]) & (source.points[:, [0, 2]] < high[[0, 2]] + [0, 0.6])
    strip = (names == "fuselage") & inside.all(axis=1) & (np.abs(source.normals[:, 1]) > 0.8)
    for side in (-1, 1):
        here = np.sign(source.points[:, 1]) == side
        part[strip & here] = np.bincount(part[wing & here]).argmax()
    assert strip.sum() > 10
    correspondences = correspond(replace(source, part=part), target, box_on_box(source, target), BY_PARTS)
    index = correspondences.target_index[strip]
    assert (index >= 0).all()
    cosine = np.einsum("ij,ij->i", source.normals[strip], target.normals[index])
    assert np.mean(cosine > 0.5) > 0.95
    assert np.mean(named_parts("b777-v1", target.points[index]) == "fuselage") > 0.9
