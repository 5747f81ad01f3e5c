"""Passes that are added where a path leaves what was inspected unseen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from upplied.config import Settings, settings_for
from upplied.planning.airspace.detours import airspace_of
from upplied.planning.carry.carried import Carried, carry
from upplied.planning.correspondence.pair import study_pair
from upplied.planning.demonstration.repetition import takes_of
from upplied.planning.measures.evaluate import added_to
from upplied.planning.trajectory import propose
from upplied.planning.trajectory.added_passes import with_added
from upplied.planning.trajectory.complete import completed, view_of
from upplied.planning.trajectory.view import View
from upplied.records import Structure, Waypoints
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

SETTINGS: Settings = settings_for("recommended")
CUBE = member("cube-v1").structure


def carried_to(target: Structure) -> tuple[Carried, View, Waypoints]:
    """The flight round a cube on a target, what it is to show there, and its completed path."""
    pair = study_pair(CUBE, target, SETTINGS)
    (one,) = carry(takes_of(fly(CUBE, "sides", seed=1), pair, SETTINGS), SETTINGS)
    assert one.goal is not None
    return one, view_of(one.take, one.goal, SETTINGS), completed(one, one.goal, SETTINGS)


@cache
def carried() -> tuple[Carried, View, Waypoints]:
    """That on a cuboid."""
    return carried_to(member("cuboid-v1").structure)


def shown(view: View, *paths: Waypoints) -> float:
    """Share of the need that these paths show."""
    asked, seen = np.flatnonzero(view.need > 0), np.zeros(len(view.need), bool)
    for path in paths:
        seen[asked] |= view.shown(path.positions, path.quat_xyzw, asked)
    return float(view.need[seen].sum())


def half_of(path: Waypoints) -> Waypoints:
    """Its first half: as though the rest could not be flown."""
    return path.rows(slice(len(path) // 2))


def test_nothing_is_added_to_a_path_that_shows_all() -> None:
    one, view, path = carried()
    assert shown(view, path) > 0.99
    assert with_added(one, path, SETTINGS) == []


def test_nothing_is_added_where_the_flight_was_demonstrated() -> None:
    one, view, path = carried_to(CUBE)
    assert shown(view, path) > 0.99
    assert with_added(one, path, SETTINGS) == []


def test_what_half_of_a_flight_leaves_is_shown_by_a_pass_in_the_style_of_the_other_half() -> None:
    one, view, path = carried()
    half = half_of(path)
    assert shown(view, half) < 0.8
    added = with_added(one, half, SETTINGS)
    assert 1 <= len(added) <= 3
    assert shown(view, half, *(flown for _, flown in added)) > shown(view, half) + 0.15
    scene = airspace_of(one.take.pair, SETTINGS).scene
    for each, flown in added:
        assert len(each.path) == len(each.take.inspection.flight)
        assert (np.diff(each.path.t_s) > 0).all() and each.path.t_s[0] == 0
        near = scene.distance(flown.positions)
        assert np.median(near) == pytest.approx(one.goal.standoff.usual_m if one.goal else 0.0, rel=0.3)


def test_a_pass_that_shows_less_in_a_second_than_is_asked_is_not_added() -> None:
    one, _, path = carried()
    dear = replace(SETTINGS, refine=replace(SETTINGS.refine, least_rate=10.0))
    assert with_added(one, half_of(path), dear) == []


def test_a_millimetre_of_noise_adds_the_same_passes() -> None:
    cuboid, rng = member("cuboid-v1").structure, np.random.default_rng(5)
    corners, which = np.unique(cuboid.vertices, axis=0, return_inverse=True)
    moved = (corners + rng.uniform(-1e-3, 1e-3, corners.shape))[which.ravel()]
    noisy = carried_to(replace(cuboid, vertices=moved, sha256=""))
    passes = [with_added(one, half_of(path), SETTINGS) for one, _, path in (carried(), noisy)]
    assert len(passes[0]) == len(passes[1])
    shares = [
        shown(view, half_of(path), *(flown for _, flown in added))
        for (_, view, path), added in zip((carried(), noisy), passes, strict=True)
    ]
    assert shares[0] == pytest.approx(shares[1], abs=0.01)


def test_added_poses_come_after_the_demonstrated_ones_and_are_told(monkeypatch) -> None:
    """Where the path that was completed is but half of the flight, the other half is an added pass."""
    one, _, path = carried()
    half = half_of(path)
    monkeypatch.setattr(propose, "completed", lambda *_: half)
    trajectory, _, demonstrated_s = propose.propose([one], SETTINGS)
    added = added_to([one.take], demonstrated_s)
    assert added is not None and 0 < added.sum() < len(added)
    first = int(added.argmax())
    assert added[first:].all()
    assert np.allclose(trajectory.positions[: first - 1].max(axis=0), half.positions.max(axis=0), atol=0.6)
    assert not airspace_of(one.take.pair, SETTINGS).broken(trajectory.positions).any()
