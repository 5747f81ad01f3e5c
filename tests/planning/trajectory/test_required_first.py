"""Zones that must be seen come first where the flight comes by, and change nothing where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from upplied.config import CloudSettings, settings_for
from upplied.errors import SettingsError
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import Scene, scene_of
from upplied.planning.airspace.rules import Airspace
from upplied.planning.plan import plan_transfer
from upplied.planning.surface.samples import surface_samples
from upplied.planning.trajectory.required import required_first
from upplied.planning.trajectory.state import Flown
from upplied.planning.trajectory.view import View
from upplied.proof.looks import looks_of
from upplied.records import Camera, Cloud, Surroundings
from upplied.records.plans import RequiredSurface
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

WALL = np.array([[-10.0, 0, 0], [10, 0, 0], [10, 0, 8], [-10, 0, 8]])


def wall(inspected_x: float = 0.0) -> View:
    """A wall in the plane y = 0, 20 x 8 m, of which the left of it was inspected from y < 0."""
    x, z = np.meshgrid(np.arange(-9.5, 10, 1.0), np.arange(0.5, 8, 1.0))
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    inspected = points[:, 0] < inspected_x
    return View(
        cloud=Cloud(points, np.tile([0.0, -1, 0], (len(points), 1)), np.ones(len(points))),
        need=inspected / inspected.sum(),
        farthest_m=np.full(len(points), 40.0),
        inspected=inspected,
        camera=Camera(hfov_deg=60, vfov_deg=50, min_range_m=0.5, max_range_m=40, width_px=1000),
        settings=settings_for("recommended").visibility,
        limits=settings_for("recommended").retime,
        scene=Scene(WALL, np.array([[0, 1, 2], [0, 2, 3]])),
    )


def required(view: View, zone: np.ndarray, gsd_m: float = np.inf, incidence_deg: float = 90.0):
    full = np.full(len(zone), 1.0)
    return RequiredSurface(view.cloud.points, view.cloud.normals, zone, gsd_m * full, incidence_deg * full)


def path(y: float = -4.0) -> Flown:
    x = np.linspace(-6, 6, 14)
    return Flown(np.column_stack([x, np.full(14, y), np.full(14, 4.0)]), np.full(14, np.pi / 2), np.zeros(14))


def first(view: View, chosen: RequiredSurface, flown: Flown, usual_m: float = 4.0) -> View:
    return required_first(view, chosen, flown, Airspace(view.scene, 1.0, Surroundings()), usual_m, 10.0)


def test_a_zone_counts_so_many_times_what_was_inspected():
    view = wall()
    zone = (view.cloud.points[:, 0] > 5) & (view.cloud.points[:, 2] > 5)
    actual = first(view, required(view, zone), path())
    assert actual.need.sum() == pytest.approx(1)
    assert actual.need[zone].min() == pytest.approx(10 * actual.need[view.inspected].max())
    assert actual.inspected[zone].all() and not actual.inspected[~zone & ~view.inspected].any()
    both = first(view, required(view, zone | view.inspected), path())
    assert both.need[view.inspected].min() == pytest.approx(1.1 * both.need[zone].min())


def test_a_pixel_and_an_incidence_are_asked_of_each_sample():
    view = wall()
    zone = view.cloud.points[:, 0] > 5
    near = first(view, required(view, zone, gsd_m=0.006), path())
    focal = 1000 / (2 * np.tan(np.radians(30)))
    assert near.farthest_m[zone] == pytest.approx(0.006 * focal)
    assert (near.farthest_m[~zone] == 40).all()
    # too far for pixels as small as that: no place beside the path would do, so nothing is asked
    assert first(view, required(view, zone, gsd_m=1e-4), path()) is view
    frontal = first(view, required(view, zone, incidence_deg=30.0), path())
    at, every = np.array([[5.0, -4.0, 4.0]]), np.arange(len(zone))
    ahead = from_yaw_pitch(np.array([np.pi / 2]), np.zeros(1))
    seen = frontal.shown(at, ahead, every)
    off = np.degrees(np.arctan2(np.hypot(view.cloud.points[:, 0] - 5, view.cloud.points[:, 2] - 4), 4.0))
    assert seen[zone].tolist() == (view.shown(at, ahead, every) & (off <= 30))[zone].tolist()
    assert seen[zone].any() and not seen[zone].all()
    assert (seen[~zone] == view.shown(at, ahead, every)[~zone]).all()


def test_what_the_flight_does_not_come_by_is_left_to_another():
    view = wall()
    zone = view.cloud.points[:, 0] > 5
    behind = path(y=4.0)  # on the other side of the wall
    assert first(view, required(view, zone), behind) is view
    assert first(view, required(view, np.zeros(len(zone), bool)), path()) is view
    assert first(view, required(view, zone), path(), usual_m=1.0) is view  # four stand-offs off


@pytest.fixture(scope="module")
def engines():
    """What was shown of the left engine, to be carried to an airliner of another size."""
    source, target = member("a320-v1").structure, member("b747-v1").structure
    flight, scene = fly(source, "engine_left", seed=1), scene_of(target)
    return flight, source, target, surface_samples(target, scene, CloudSettings()), scene


def planned(engines, zone: np.ndarray | None):
    flight, source, target, surface, _ = engines
    if zone is None:
        return plan_transfer(flight, source, target, settings_for("recommended"))
    full = np.full(len(zone), 1.0)
    chosen = RequiredSurface(surface.points, surface.normals, zone, np.inf * full, 90 * full)
    assert zone.sum() > 20
    settings = settings_for("recommended", required={"zones": "asked"})
    return plan_transfer(flight, source, target, settings, required=chosen)


@pytest.mark.slow
def test_a_plan_shows_more_of_a_zone_that_it_is_asked_for_and_no_less_of_what_was_inspected(engines):
    flight, _, _, surface, scene = engines
    low, size = surface.points.min(axis=0), np.ptp(surface.points, axis=0)
    share = (surface.points - low) / size
    wing = (share[:, 0] > 0.3) & (share[:, 0] < 0.7) & (share[:, 1] > 0.5) & (share[:, 2] < 0.5)
    usual, wing_first = planned(engines, None), planned(engines, wing)
    shown = [
        looks_of(each.trajectory, surface, flight.camera, scene).seen[wing].mean()
        for each in (usual, wing_first)
    ]
    assert shown[1] > shown[0] + 0.2
    assert wing_first.measures.coverage_inspected_pct > usual.measures.coverage_inspected_pct - 3
    assert wing_first.measures.min_clearance_m >= 2.0 and wing_first.flyable
    # what faces the other side is beyond this flight: the plan is as if nobody had asked
    beyond = (surface.normals[:, 1] < -0.8) & (share[:, 1] < 0.45)
    tail = (share[:, 0] < 0.2) & (share[:, 2] > 0.55)  # in sight, but far
    for away in (beyond, tail):
        assert np.array_equal(planned(engines, away).trajectory.positions, usual.trajectory.positions)


def test_zones_that_are_named_and_not_given_are_no_plan(engines):
    flight, source, target, surface, _ = engines
    named = settings_for("recommended", required={"zones": "asked"})
    with pytest.raises(SettingsError, match="no surface is given"):
        plan_transfer(flight, source, target, named)
    chosen = required(replace(wall(), cloud=surface), np.ones(len(surface), bool))
    with pytest.raises(SettingsError, match="a surface is given"):
        plan_transfer(flight, source, target, settings_for("recommended"), required=chosen)
