"""Takes on the target: whole flights with what they are to show, or viewpoints as published."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from remembered import study_pair

from upplied.config import settings_for
from upplied.errors import RefusedError, SettingsError
from upplied.planning.carry.affine import registered_map
from upplied.planning.carry.carried import Carried, _about_inspected, _refuse_without_counterpart, carry
from upplied.planning.carry.inspected_surface import InspectedSurface
from upplied.planning.demonstration.repetition import Take, takes_of
from upplied.records import Cloud
from upplied.samples.fleet import member
from upplied.samples.pilot import fly


@cache
def take(preset: str) -> Take:
    cube, settings = member("cube-v1").structure, settings_for(preset)
    pair = study_pair(cube, member("cuboid-v1").structure, settings)
    return takes_of(fly(cube, "sides", seed=1), pair, settings)[0]


def carried(preset: str) -> Carried:
    (result,) = carry([take(preset)], settings_for(preset))
    return result


@pytest.mark.ci
def test_a_whole_flight_is_carried_with_what_it_is_to_show() -> None:
    result, flight = carried("recommended"), take("recommended").inspection.flight
    assert result.goal is not None and len(result.path) == len(flight) == len(result.goal.flown)
    fit = take("recommended").pair.surface
    assert result.goal.flown == pytest.approx(registered_map(fit.registration).points(flight.positions))
    assert result.goal.inspected.need.shape == (len(fit.target),)
    assert np.array_equal(result.path.t_s, flight.t_s) and result.path.is_viewpoint.any()


def test_the_simple_ways_are_carried_beside_it() -> None:
    """As the boxes' ratio maps the flight, and of its own size about what it is to inspect."""
    result, fit = carried("recommended"), take("recommended").pair.surface
    flight = take("recommended").inspection.flight
    boxed, rigid = result.others
    ratio = np.ptp(fit.target.points, axis=0) / np.ptp(fit.source.points, axis=0)
    low = fit.target.points.min(axis=0), fit.source.points.min(axis=0)
    np.testing.assert_allclose(boxed.positions, low[0] + ratio * (flight.positions - low[1]), atol=1e-6)
    weight = fit.source.areas * take("recommended").inspection.attention.weight
    there, here = (
        weight @ points / weight.sum() for points in (fit.correspondences.target_points, fit.source.points)
    )
    np.testing.assert_allclose(
        rigid.positions - flight.positions, np.tile(there - here, (len(flight), 1)), atol=0.05
    )


def test_a_part_that_lies_elsewhere_is_followed() -> None:
    """By a map that brings the middle of what was inspected onto that of its counterparts."""
    here = take("recommended")
    fit, shift = here.pair.surface, np.array([3.0, -2.0, 1.0])
    match = fit.correspondences
    moved = replace(match, target_points=match.target_points + shift)
    there = replace(here, pair=replace(here.pair, surface=replace(fit, correspondences=moved)))
    (before,), (after,) = (_about_inspected(one, np.diag([2.0, 1, 1])) for one in (here, there))
    points = np.array([[0.0, 0, 0], [1, 2, 3]])
    assert after.points(points) == pytest.approx(before.points(points) + shift)
    nothing = replace(here.inspection.attention, weight=np.zeros(len(fit.source)))
    idle = replace(here, inspection=replace(here.inspection, attention=nothing))
    assert _about_inspected(idle, np.eye(3)) == []


@pytest.mark.parametrize("preset", ["paper", "baseline"])
def test_published_viewpoints_are_carried_without_a_goal(preset: str) -> None:
    result, viewpoints = carried(preset), take(preset).inspection.viewpoints
    assert result.goal is None and len(result.path) == len(viewpoints) and result.path.is_viewpoint.all()


def test_what_is_seen_cannot_be_shown_where_nothing_occludes() -> None:
    settings = settings_for("recommended")
    blind = replace(settings, visibility=replace(settings.visibility, occlusion=False))
    with pytest.raises(SettingsError, match="occlusion"):
        carry([take("recommended")], blind)


@pytest.mark.parametrize(
    ("without", "least", "refused"),
    [(49.9, 0.5, False), (50.0, 0.5, False), (50.2, 0.5, True), (100.0, 0.0, False)],
)
def test_a_flight_is_refused_where_too_much_of_it_has_no_counterpart(
    without: float, least: float, refused: bool
):
    cloud = Cloud(np.zeros((1, 3)))
    surface = InspectedSurface(cloud, np.array([100 - without]), np.ones(1), without)
    settings = settings_for("recommended", refine={"least_counterpart": least})
    if refused:
        with pytest.raises(RefusedError, match=r"50 % of it has no counterpart.*at least 50 %"):
            _refuse_without_counterpart(surface, settings)
    else:
        _refuse_without_counterpart(surface, settings)
    _refuse_without_counterpart(
        InspectedSurface(cloud, np.zeros(1), np.ones(1), 0.0), settings
    )  # about nothing
