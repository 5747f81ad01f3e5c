"""What answers to the inspected parts: never a wrong one without a word."""

from __future__ import annotations

import pytest
from made_structures import one_piece

from upplied.config import settings_for
from upplied.errors import SettingsError
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.parts import mesh_pieces
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def a320():
    return member("a320-v1").structure


@pytest.fixture(scope="module")
def engine(a320):
    return fly(a320, "engine_left", seed=2)


@pytest.fixture(scope="module")
def scan():
    """A 747 whose mesh is one piece, with the landmarks of the model."""
    return one_piece(member("b747-v1").structure)


def planned(flight, source, target, **asked):
    return plan_transfer(flight, source, target, settings_for("recommended", correspondence=asked))


def test_the_scan_is_one_piece(scan):
    assert mesh_pieces(scan).max() == 0


def test_each_found_engine_is_told_and_counted(a320, engine):
    plan = planned(engine, a320, member("b747-v1").structure, expect=4)
    (one,) = plan.counterparts
    assert plan.status == "ok" and not one.doubt
    assert (one.twins, one.found, len(one.flown), len(one.left_out)) == (1, 4, 1, 3)
    assert all("not asked for" in why for why in one.left_out)
    assert "left" in one.flown[0]


def test_another_number_than_expected_is_refused(a320, engine):
    plan = planned(engine, a320, member("b777-v1").structure, expect=4)
    assert plan.status == "refused"
    assert "2 parts like part_" in plan.reason and "4 are expected" in plan.reason
    assert planned(engine, a320, member("b777-v1").structure, expect=2).status == "ok"


def test_how_many_are_expected_is_a_number():
    with pytest.raises(SettingsError, match="whole number, or none"):
        settings_for("recommended", correspondence={"expect": "four"})
    with pytest.raises(SettingsError, match="1 to 1000"):
        settings_for("recommended", correspondence={"expect": 0})


def test_both_wings_are_flown_and_none_is_left_out(a320):
    plan = planned(fly(a320, "wings", seed=2), a320, member("b777-v1").structure)
    assert [(one.found, len(one.flown), one.left_out) for one in plan.counterparts] == [(2, 1, ())] * 2


def test_no_abutment_is_taken_for_a_pier():
    bridge = member("bridge-1-v1").structure
    plan = planned(fly(bridge, "piers", seed=2), bridge, member("bridge-2-v1").structure, expect=2)
    assert plan.status == "ok", plan.reason


@pytest.mark.parametrize(
    "asked", [{}, {"repeat": "each"}, {"counterparts": (("engine_left", "engine_left_outer"),)}]
)
def test_an_engine_that_is_found_nowhere_is_refused_with_the_reason(engine, a320, asked):
    """A target on which no part is told: the engine has a twin, so what lies nearest is no answer."""
    nothing = one_piece(member("b747-v1").structure)
    plan = planned(engine, a320, nothing, **asked)
    assert plan.status == "refused" and plan.trajectory is None
    assert "engine_left=" in plan.reason or "is not told apart" in plan.reason


def test_a_fuselage_without_a_twin_is_flown_with_a_warning_that_names_it(a320, scan):
    plan = planned(fly(a320, "fuselage", seed=2), a320, scan)
    assert plan.status == "ok"
    assert any(plan.counterparts[0].part in said for said in plan.warnings)
