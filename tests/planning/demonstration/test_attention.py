"""What a flight was about: the intended part of flights whose meaning is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import CloudSettings, InspectionSettings
from upplied.errors import SettingsError
from upplied.planning.demonstration.about import zone_of
from upplied.planning.demonstration.attention import Attention, attention
from upplied.planning.surface.frames import structure_in
from upplied.planning.surface.samples import surface_samples
from upplied.planning.surface.skin import skin_parts
from upplied.planning.visibility.path_views import TRULY, views
from upplied.records import Cloud, Demonstration, Floats, Frame, Ints, Structure
from upplied.samples.fleet import member
from upplied.samples.pilot import fly
from upplied.scene import scene_of

MEANT = {
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
    return cloud, skin_parts(structure, scene, cloud, seed).label


def attended(flight: Demonstration, structure: Structure) -> Attention:
    cloud, part = sampled(structure)
    shown = views(flight.trajectory, cloud, flight.camera, TRULY, scene_of(structure))
    settings = InspectionSettings()
    return attention(flight.trajectory, flight.breaks, flight.camera, cloud, shown, part, settings)


@cache
def named(structure_id: str) -> Floats:
    """The name of the part that each sample lies on."""
    made = member(structure_id)
    triangle = scene_of(made.structure).closest(sampled(made.structure)[0].points)[1]
    return np.array(made.part_names)[made.part_of_triangle[triangle]]


def on_meant(found: Attention, structure_id: str, inspection: str) -> float:
    """Share of the weight on what the flight was meant for."""
    mine = np.array([name.startswith(MEANT[structure_id, inspection]) for name in named(structure_id)])
    weight = found.weight * sampled(member(structure_id).structure)[0].area_m2
    return float(weight[mine].sum() / weight.sum())


@pytest.mark.parametrize(("structure_id", "inspection"), MEANT)
def test_the_weight_lies_on_what_was_meant(structure_id: str, inspection: str) -> None:
    structure = member(structure_id).structure
    found = attended(fly(structure, inspection, seed=11), structure)
    assert on_meant(found, structure_id, inspection) > 0.85
    assert found.weight.min() >= 0 and found.weight.max() <= 1


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
    found = attended(away, structure)
    assert not found.weight.any() and np.isnan(found.subject_m)


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
    found = attention(*facts, zone)
    assert found.weight[zone].max() > 0.9 and not found.weight[~zone].any()


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
