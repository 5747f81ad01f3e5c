"""What corresponds to the inspected parts: found on a scan of one piece, never a wrong one in silence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_structures import one_piece
from remembered import study_pair

from upplied.config import settings_for
from upplied.errors import SettingsError
from upplied.geometry.scene import scene_of
from upplied.planning.carry.counterparts import counterparts_of
from upplied.planning.carry.forecast import doubts, undecided
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.parts import labels_of, mesh_pieces
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def a320():
    return member("a320-v1").structure


@pytest.fixture(scope="module")
def b747():
    return member("b747-v1").structure


@pytest.fixture(scope="module")
def engine(a320):
    return fly(a320, "engine_left", seed=2)


@pytest.fixture(scope="module")
def scan(b747):
    """A 747 whose mesh is one piece, with the landmarks of the model."""
    return one_piece(b747)


def asked_for(**choices):
    return settings_for("recommended", correspondence=choices)


def answers(flight, source, target, **choices):
    settings = asked_for(**choices)
    takes = takes_of(flight, study_pair(source, target, settings), settings)
    counterparts = counterparts_of(takes, settings)
    return takes, counterparts, undecided(counterparts, settings)


def true_names(structure_id, structure, points):
    """The names of the generator's parts on which samples of a scan lie."""
    of = member(structure_id)
    return np.array(of.part_names)[of.part_of_triangle[scene_of(of.structure, 1).closest(points)[1]]]


def test_the_scan_is_one_piece(scan):
    assert mesh_pieces(scan).max() == 0


@pytest.mark.ci
def test_every_engine_of_a_scan_is_found_and_flown(a320, engine, scan):
    takes, counterparts, refused = answers(engine, a320, scan, repeat="each", expect=4)
    assert not refused and not doubts(counterparts)
    assert [(one.found, len(one.flown), one.left_out) for one in counterparts] == [(4, 2, ())] * 2
    flown = []
    for take in takes:
        cloud = take.pair.surface.target
        name = true_names("b747-v1", scan, cloud.points[labels_of(cloud) == take.attended.choice])
        name = np.char.replace(name, "pylon", "engine")  # which a part of the source has as well
        names, count = np.unique(name, return_counts=True)
        assert count.max() > 0.9 * count.sum()
        flown.append(str(names[count.argmax()]))
    assert sorted(flown) == [
        "engine_left", "engine_left_outer", "engine_right", "engine_right_outer",
    ]  # fmt: skip


@pytest.mark.ci
@pytest.mark.parametrize(
    ("place", "engine_meant"), [("engine_left_outer", "engine_left_outer"), ("inner", "engine_left")]
)
def test_the_named_engine_of_a_scan_is_flown(a320, engine, scan, place, engine_meant):
    (take,), _, refused = answers(engine, a320, scan, counterparts=(("engine_left", place),))
    assert not refused
    fit = take.pair.surface
    inspected = (take.inspection.attention.weight > 0.5) & (fit.correspondences.target_index >= 0)
    there = true_names("b747-v1", scan, fit.correspondences.target_points[inspected])
    assert (there == engine_meant).mean() > 0.9


@pytest.mark.ci
def test_a_flight_round_a_scan_is_carried_to_a_model(scan, a320):
    """The other way round: the demonstrated structure is the one of a single piece."""
    flight = fly(one_piece(a320), "engine_left", seed=2)
    _, (one,), refused = answers(flight, one_piece(a320), member("b777-v1").structure)
    assert not refused and not one.doubt
    assert (one.twins, one.found) == (1, 2) and "left" in one.flown[0]


@pytest.mark.ci
@pytest.mark.parametrize(
    "choices", [{}, {"repeat": "each"}, {"counterparts": (("engine_left", "engine_left_outer"),)}]
)
def test_an_engine_among_others_that_nothing_tells_apart_is_refused_with_the_reason(a320, scan, choices):
    """Both structures are of one piece: what lies nearest to the engine may be another one."""
    source = one_piece(a320)
    flight = fly(source, "engine_left", seed=2)
    plan = plan_transfer(flight, source, scan, asked_for(**choices))
    assert plan.status == "refused" and plan.trajectory is None
    assert "engine_left=" in plan.reason or "cannot be distinguished" in plan.reason


@pytest.mark.ci
def test_wings_that_were_inspected_both_are_flown_between_structures_of_one_piece(a320, scan):
    source = one_piece(a320)
    (take,), counterparts, refused = answers(fly(source, "wings", seed=2), source, scan)
    assert not refused and any("its surface is one piece" in doubt for doubt in doubts(counterparts))
    fit = take.pair.surface
    inspected = (take.inspection.attention.weight > 0.5) & (fit.correspondences.target_index >= 0)
    there = true_names("b747-v1", scan, fit.correspondences.target_points[inspected])
    assert np.char.startswith(there, "wing").mean() > 0.9


@pytest.mark.ci
def test_an_engine_that_was_modelled_as_one_with_its_wing_is_not_flown_as_a_wing(a320, engine, b747):
    of = member("a320-v1")
    edges = []
    for side in ("left", "right"):
        wing, nacelle = (of.triangles_of(f"{part}_{side}")[0] for part in ("wing", "engine"))
        edges.append([a320.triangles[wing, 0], a320.triangles[nacelle, 0], a320.triangles[nacelle, 0]])
    source = replace(a320, triangles=np.vstack([a320.triangles, edges]), sha256="")
    _, (one,), refused = answers(engine, source, b747)
    assert one.twins > 0 and "part of its own" in refused


@pytest.mark.ci
def test_wings_that_were_modelled_as_one_with_the_fuselage_are_found_on_the_target(a320):
    """Engines are pieces of their own, so pieces tell parts there; the wings' boxes are the fuselage's."""
    of = member("b777-v1")
    body, *wings = (of.triangles_of(part)[0] for part in ("fuselage", "wing_left", "wing_right"))
    corner = of.structure.triangles[:, 0]
    edges = [[corner[body], corner[wing], corner[wing]] for wing in wings]
    target = replace(of.structure, triangles=np.vstack([of.structure.triangles, edges]), sha256="")
    _, counterparts, refused = answers(fly(a320, "wings", seed=2), a320, target)
    assert not refused and min(one.probability for one in counterparts[:2]) > 0.9
    assert len({part for one in counterparts[:2] for part in one.flown}) == 2


def test_what_has_no_like_is_told_by_its_name(a320, scan):
    source = one_piece(a320)
    _, counterparts, _ = answers(fly(source, "fuselage", seed=2), source, scan)
    doubted = [one.part for one in counterparts if one.doubt]
    assert doubted and all(any(part in text for text in doubts(counterparts)) for part in doubted)


@pytest.mark.slow
def test_what_has_no_like_is_flown_with_a_warning_that_names_it(a320, scan):
    source = one_piece(a320)
    plan = plan_transfer(fly(source, "fuselage", seed=2), source, scan, settings_for("recommended"))
    doubted = [one.part for one in plan.counterparts if one.doubt]
    assert doubted
    if plan.status == "ok":
        assert all(any(part in warning for warning in plan.warnings) for part in doubted)


def test_each_found_engine_is_told_and_counted(a320, engine, b747):
    _, (one,), refused = answers(engine, a320, b747, expect=4)
    assert not refused and not one.doubt
    assert (one.twins, one.found, len(one.flown), len(one.left_out)) == (1, 4, 1, 3)
    assert all("not requested" in why for why in one.left_out)
    assert "left" in one.flown[0]


@pytest.mark.slow
def test_another_number_than_expected_is_refused(a320, engine):
    refused = answers(engine, a320, member("b777-v1").structure, expect=4)[2]
    assert "2 parts like part_" in refused and "4 are expected" in refused
    assert not answers(engine, a320, member("b777-v1").structure, expect=2)[2]


def test_how_many_are_expected_is_a_number():
    with pytest.raises(SettingsError, match="whole number, or none"):
        asked_for(expect="four")
    with pytest.raises(SettingsError, match="1 to 1000"):
        asked_for(expect=0)


@pytest.mark.ci
def test_both_wings_are_flown_and_none_is_left_out(a320):
    _, counterparts, _ = answers(fly(a320, "wings", seed=2), a320, member("b777-v1").structure)
    assert [(one.found, len(one.flown), one.left_out) for one in counterparts] == [(2, 1, ())] * 2


@pytest.mark.ci
def test_no_abutment_is_taken_for_a_pier():
    bridge = member("bridge-1-v1").structure
    assert not answers(fly(bridge, "piers", seed=2), bridge, member("bridge-2-v1").structure, expect=2)[2]


@pytest.mark.ci
def test_engines_of_a_side_that_was_never_scanned_are_not_passed_over(a320, engine):
    b777 = member("b777-v1").structure
    left = b777.vertices[b777.triangles].mean(axis=1)[:, 1] > 6.0
    cut = replace(b777, triangles=b777.triangles[~left], sha256="")
    _, counterparts, refused = answers(engine, a320, cut, repeat="each")
    assert "no part like" in refused and "on its side of b777-v1" in refused
    assert any(one.found == 0 and one.doubt for one in counterparts)


@pytest.mark.ci
def test_a_flight_that_shows_every_pier_is_not_repeated_at_each():
    bridge = member("bridge-1-v1").structure
    flight = fly(bridge, "piers", seed=2)
    takes, counterparts, refused = answers(
        flight, bridge, member("bridge-2-v1").structure, repeat="each", expect=2
    )
    assert len(takes) == 1 and not refused
    assert [len(one.flown) for one in counterparts] == [1, 1]
