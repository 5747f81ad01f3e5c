"""Passes that are added where a path leaves what was inspected unseen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import Settings, settings_for
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.airspace.rules import Airspace
from upplied.planning.carry.carried import Carried, carry
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.measures.evaluate import added_to
from upplied.planning.trajectory import added_passes, propose
from upplied.planning.trajectory.added_passes import with_added
from upplied.planning.trajectory.complete import completed, view_of
from upplied.planning.trajectory.view import View
from upplied.records import Waypoints
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

SETTINGS: Settings = settings_for("recommended")


@cache
def carried() -> tuple[Carried, View, Airspace, Waypoints]:
    """The flight round a cube on a cuboid, what it is to show there, and its completed path."""
    cube = member("cube-v1").structure
    pair = study_pair(cube, member("cuboid-v1").structure, SETTINGS)
    (one,) = carry(takes_of(fly(cube, "sides", seed=1), pair, SETTINGS), SETTINGS)
    assert one.goal is not None
    view = view_of(one.take, one.goal, SETTINGS)
    return one, view, airspace_of(pair, SETTINGS), completed(one, one.goal, SETTINGS)


def shown(view: View, *paths: Waypoints) -> float:
    """Share of the need that these paths show."""
    asked, seen = np.flatnonzero(view.need > 0), np.zeros(len(view.need), bool)
    for path in paths:
        seen[asked] |= view.shown(path.positions, path.quat_xyzw, asked)
    return float(view.need[seen].sum())


def test_nothing_is_added_to_a_path_that_shows_all() -> None:
    one, view, airspace, path = carried()
    assert shown(view, path) > 0.99
    assert with_added(one, path, view, airspace) == []


def test_what_half_of_a_flight_leaves_is_shown_by_a_pass_in_the_style_of_the_other_half() -> None:
    one, view, airspace, path = carried()
    half = path.rows(slice(len(path) // 2))
    assert shown(view, half) < 0.8
    added = with_added(one, half, view, airspace)
    assert 1 <= len(added) <= 3
    assert shown(view, half, *(each.path for each in added)) > shown(view, half) + 0.15
    for each in added:
        assert each.goal is not None and len(each.path) == len(each.take.inspection.flight)
        assert (np.diff(each.path.t_s) > 0).all() and each.path.t_s[0] == 0
        near = airspace.scene.distance(each.path.positions)
        assert np.median(near) == pytest.approx(one.goal.standoff.usual_m if one.goal else 0.0, rel=0.3)


def test_no_pass_is_added_beyond_the_time_that_the_demonstration_takes_at_this_size(monkeypatch) -> None:
    one, view, airspace, path = carried()
    half = path.rows(slice(len(path) // 2))
    monkeypatch.setattr(added_passes, "_TIME", 1.0)
    slow = replace(one, take=replace(one.take, inspection=hurried(one)))
    assert with_added(slow, half, view, airspace) == []


def hurried(one: Carried):
    """The inspection as if the demonstration had taken no time."""
    flight = one.take.inspection.flight
    return replace(one.take.inspection, flight=replace(flight, t_s=flight.t_s * 1e-3))


def test_added_poses_come_after_the_demonstrated_ones_and_are_told(monkeypatch) -> None:
    """Where the path that was completed is but half of the flight, the other half is an added pass."""
    one, _, airspace, path = carried()
    half = path.rows(slice(len(path) // 2))

    def first_half(each: Carried, goal, settings: Settings) -> Waypoints:
        return half if each is one else completed(each, goal, settings)

    monkeypatch.setattr(propose, "completed", first_half)
    trajectory, _, demonstrated_s = propose.propose([one], SETTINGS)
    added = added_to([one.take], demonstrated_s)
    assert added is not None and 0 < added.sum() < len(added)
    first = int(added.argmax())
    assert added[first:].all()
    assert np.allclose(trajectory.positions[: first - 1].max(axis=0), half.positions.max(axis=0), atol=0.6)
    assert not airspace.broken(trajectory.positions).any()
