"""Missions of plans for scans that lack an end: every leg keeps clear of where that is supposed to be."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_missions import PLACE
from made_scans import END, body, cut

from upplied.config import settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import from_yaw_pitch
from upplied.geometry.scene import scene_of
from upplied.geometry.supposed_scene import extent, scene_for
from upplied.outputs.missions import MissionOptions, export, missions_of
from upplied.outputs.missions.gate import Limits, breaches, broken_by, planned
from upplied.outputs.missions.transits import default_home
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.planning.correspondence.fit import Fit
from upplied.planning.correspondence.never_scanned import never_scanned
from upplied.planning.surface.samples import surface_samples
from upplied.records import Plan, Registration, Structure, SupposedSurface, Surroundings, Trajectory

SAME = Registration(np.ones(3), np.eye(3), np.zeros(3), 0.0, True)
UPRIGHT = [1, 2, 0]  # its length becomes its height


def upright(structure: Structure) -> Structure:
    return replace(structure, vertices=structure.vertices[:, UPRIGHT] + [0, 0, 7])


@cache
def lost_end(standing: bool = False) -> tuple[Structure, Structure, SupposedSurface]:
    """A body, a scan of it without its end, and what is supposed there."""
    whole, scan = (upright(each) if standing else each for each in (body(), cut(body())))
    whole, scan = (replace(each, placement=PLACE) for each in (whole, scan))
    clouds = settings_for("recommended").clouds
    here, there = (surface_samples(each, scene_of(each), clouds) for each in (whole, scan))
    supposed = never_scanned(whole, scan, Fit(here, there, SAME)).supposed
    assert supposed is not None
    return whole, scan, supposed


def side(until: float) -> Trajectory:
    """Along one side at 5 m from it, so far along x, at 1 m/s, looking at it."""
    x = np.arange(-6.0, until, 0.5)
    at = np.column_stack([x, np.full(len(x), 7.0), np.full(len(x), 2.0)])
    return Trajectory(2 * (x - x[0]) / 2, at, from_yaw_pitch(np.full(len(x), -np.pi / 2), 0 * x))


MORE_HOMES = ((12.0, -6.0, 0.0), (5.5, -12.0, 0.0))


def plan_for(path: Trajectory, supposed: SupposedSurface | None) -> Plan:
    flags = np.arange(len(path)) % 4 == 0
    result = {"status": "ok", "trajectory": path, "is_viewpoint": flags, "flyable": True}
    return Plan("demo", "body", "body", "tank", "recommended", **result, supposed=supposed)


@pytest.mark.parametrize(
    "home", [(7.5, -9.0, 0.0), *(pytest.param(home, marks=pytest.mark.slow) for home in MORE_HOMES)]
)
def test_the_ways_keep_their_clearance_from_the_end_that_was_not_scanned(home) -> None:
    whole, scan, supposed = lost_end()
    options = MissionOptions(home_m=home)
    (blind,) = missions_of(plan_for(side(4.0), None), scan, options)
    (mission,) = missions_of(plan_for(side(4.0), supposed), scan, options)
    assert path_clearance(scene_of(whole), blind.local).distance_m < 1.0  # else nothing is tested
    assert path_clearance(scene_of(whole), mission.local).distance_m > 1.9
    assert path_clearance(scene_for(scan, supposed), mission.local).distance_m >= 1.95
    assert any("never scanned" in note for note in mission.notes)
    assert not any("never scanned" in note for note in blind.notes)
    assert np.array_equal(mission.local[mission.inspect], blind.local[blind.inspect])


@pytest.mark.ci
def test_a_plan_too_near_is_refused_and_what_was_never_scanned_is_named(tmp_path) -> None:
    _, scan, supposed = lost_end()
    x = np.arange(-6.0, 6.5, 0.5)
    past = np.column_stack([x, np.where(x < END + 2, 7.0, 3.0), np.full(len(x), 2.0)])
    path = replace(side(6.5), positions=past, t_s=10.0 * np.arange(len(x)))
    limits = Limits()
    assert breaches(planned(path.positions, path.t_s), scan, limits, None) == []
    (breach,) = breaches(planned(path.positions, path.t_s), scan, limits, supposed)
    assert breach.rule == "clearance" and "m from unscanned surface at [" in str(breach)
    assert broken_by(plan_for(path, supposed), scan, 2.0) == [breach]
    for format in ("mcap", "csv"):
        with pytest.raises(RefusedError, match="from unscanned surface"):
            export(plan_for(path, supposed), scan, format, tmp_path / "plan")
        assert not list(tmp_path.iterdir())
    near = path.positions[[0]] * [1, 0, 1] + [0, 3.0, 0]  # beside what was scanned
    (known,) = breaches(planned(near, np.zeros(1)), scan, limits, supposed)
    assert "never scanned" not in str(known)


def test_nobody_climbs_beside_what_was_never_scanned() -> None:
    _, scan, supposed = lost_end()
    home = (8.0, 0.0, 0.0)
    options = MissionOptions(home_m=home)
    assert missions_of(plan_for(side(4.0), None), scan, options)
    with pytest.raises(RefusedError, match="m from what was never scanned of the structure"):
        missions_of(plan_for(side(4.0), supposed), scan, options)
    air = Airspace(scene_for(scan, supposed), 2.0, Surroundings())
    assert "never scanned" in air.why(np.array(home)) and "scanned" not in air.why(np.array([-8.0, 0, 0]))


def test_take_off_lies_outside_and_a_return_passes_over_what_was_never_scanned() -> None:
    _, scan, supposed = lost_end()
    blind, _ = default_home(scan, None, np.array([5.0, 0, 1]), 2.0)
    home, _ = default_home(scan, supposed, np.array([5.0, 0, 1]), 2.0)
    end = extent(scan, supposed)[1][0]  # the body's own is at 7 m; the scan may go on a little farther
    assert end + 0.1 >= 7 and end < 8 and end == max(supposed.points[:, 0].max(), END)
    assert blind[0] == pytest.approx(END + 5, abs=0.5) and home[0] == pytest.approx(end + 5, abs=0.1)
    tower, cut_off, top = lost_end(standing=True)
    assert cut_off.vertices[:, 2].max() < 11.5 < 13.9 < tower.vertices[:, 2].max()
    x = np.arange(-6.0, 4.0, 0.5)
    beside = np.column_stack([np.full(len(x), 8.0), x, np.full(len(x), 4.0)])
    quats = from_yaw_pitch(np.full(len(x), np.pi), 0 * x)
    path = Trajectory(x - x[0], beside, quats)
    (low,) = missions_of(plan_for(path, None), cut_off, MissionOptions())
    (high,) = missions_of(plan_for(path, top), cut_off, MissionOptions())
    assert low.return_height_m < 14.5 < 16.5 < high.return_height_m
