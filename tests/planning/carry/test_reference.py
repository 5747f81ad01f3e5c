"""The demonstrated path on the target has one definition, through the registration, for any rotation."""

from dataclasses import replace

import numpy as np
import pytest
from moved_scenes import ANY, about_z, moved_structure
from remembered import study_pair
from scipy.spatial.transform import Rotation

import upplied.planning.trajectory.complete as completing
import upplied.planning.trajectory.flyable as flyable
from upplied.config import settings_for
from upplied.planning.carry.affine import demonstrated_on_target, standing
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.geometry.frechet import frechet, zscored
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@pytest.fixture(scope="module")
def fleet():
    return {structure.structure_id: structure for structure in sample_structures()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "part", "turn", "search"),
    [
        ("cruise-v1", "hull", about_z(29), "heading"),
        pytest.param("cruise-v1", "hull", about_z(-12), "heading", marks=pytest.mark.slow),
        ("turbine-1-v1", "tower", Rotation.from_euler("x", 180, degrees=True).as_matrix(), "orientation"),
    ],
)
def test_it_is_turned_as_the_target_is(fleet, kind, part, turn, search):
    """Below 30 degrees it once was not turned at all, and of a structure flipped over it was 114 m off."""
    structure = fleet[kind]
    registered = replace(moved_structure(structure, turn), surroundings=type(structure.surroundings)())
    settings = settings_for("recommended", verdict=ANY, registration={"search": search})
    flight = fly(structure, part, seed=1)
    pair = study_pair(structure, registered, settings)
    (take,) = takes_of(flight, pair, settings)
    assert frechet(demonstrated_on_target(take), flight.positions @ turn.T) < 0.02 * structure.diagonal_m
    np.testing.assert_allclose(standing(pair), turn.T, atol=0.02)


@pytest.mark.slow
def test_the_shape_that_bounds_the_planner_is_the_one_it_is_measured_by(fleet, monkeypatch):
    ship, bounds = fleet["cruise-v1"], []
    bounded = flyable._within
    monkeypatch.setattr(
        flyable,
        "_within",
        lambda bound, path, at, goal, safe: (
            bounds.append(zscored(goal.reference @ goal.standing.T)) or bounded(bound, path, at, goal, safe)
        ),
    )
    changes = {"registration": {"search": "heading"}, "refine": {"deviation": 0.5}}
    settings = settings_for("recommended", verdict=ANY, **changes)
    flight, turn = fly(ship, "hull", seed=1), about_z(29)
    plan = plan_transfer(flight, ship, moved_structure(ship, turn), settings)
    true = zscored(flight.positions @ turn.T @ plan.registration.turn.T)
    # In the axes of the source: whichever way its own frame is turned, by right angles.
    quarters = [np.abs(np.cos(np.radians(90 * k))) > 0.5 for k in (0, 1)]
    distances = [
        frechet(np.abs(bounds[0]), np.abs(true if same else true[:, [1, 0, 2]])) for same in quarters
    ]
    assert min(distances) < 0.05


@pytest.mark.ci
@pytest.mark.parametrize(
    ("standoff", "wanted_m"), [pytest.param("scaled", 4.31, marks=pytest.mark.slow), ("kept", 15.65)]
)
def test_what_the_stand_off_bounds_is_carried_with_it(fleet, monkeypatch, standoff, wanted_m):
    """From the cruise ship to a yacht a quarter as large: what weighs a path follows the stand-off."""
    wishes, optimise = [], completing.optimise
    monkeypatch.setattr(
        completing, "optimise", lambda problem, *rest: wishes.append(problem) or optimise(problem, *rest)
    )
    settings = settings_for("recommended", verdict=ANY, transfer={"standoff": standoff})
    plan = plan_transfer(
        fly(fleet["cruise-v1"], "hull", seed=1), fleet["cruise-v1"], fleet["yacht-1-v1"], settings
    )
    assert plan.status == "ok", plan.reason
    assert wishes[0].standoff.usual_m == pytest.approx(wanted_m, rel=0.1)
