"""A plan as a person changed it: what was touched is as asked, the rest as it was, and all of it safe."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from upplied.config import CloudSettings, settings_for
from upplied.errors import RefusedError
from upplied.geometry.poses import interpolate
from upplied.geometry.scene import scene_of
from upplied.planning.airspace.roadmap import roadmap
from upplied.planning.airspace.rules import Airspace, path_clearance
from upplied.planning.surface.samples import surface_samples
from upplied.proof.edit import Edit, Viewpoint, edit_of, edited, viewpoints_of
from upplied.records import Surroundings
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE = member("cube-v1").structure
SCENE = scene_of(CUBE)
SURFACE = surface_samples(CUBE, SCENE, CloudSettings(surface_samples=400))
LIMITS = settings_for("recommended").retime
FLOWN = fly(CUBE, "sides", seed=1).trajectory
PLAN = interpolate(FLOWN, np.arange(0.0, 100.0, 0.5))
FLAGS = np.arange(len(PLAN)) % 10 == 0
BEFORE = viewpoints_of(PLAN, FLAGS)


def graph_of(boxes=()):
    around = Surroundings(keep_out_m=np.array(boxes, float).reshape(-1, 2, 3))
    return roadmap(Airspace(SCENE, 2.0, around), SURFACE, PLAN.positions[::4])


@pytest.fixture(scope="module")
def graph():
    return graph_of()


def stops(trajectory, flags):
    """The viewpoints, each place once: where the camera turns on the spot there are two poses."""
    viewpoints = viewpoints_of(trajectory, flags)
    gaps = [np.linalg.norm(np.subtract(a.position, b.position)) for a, b in pairwise(viewpoints)]
    return [v for v, gap in zip(viewpoints, [*gaps, 1.0], strict=True) if gap > 1e-6]


def places(trajectory, flags):
    return np.array([v.position for v in stops(trajectory, flags)])


def test_what_a_file_gives_back_unchanged_is_no_edit():
    same = {n: replace(v, yaw_deg=round(v.yaw_deg, 4) + 360) for n, v in enumerate(BEFORE)}
    assert edit_of(BEFORE, same) == Edit()
    del same[3]
    same[5] = replace(same[5], pitch_deg=-30.0)
    edit = edit_of(BEFORE, same)
    assert edit.deleted == (3,) and set(edit.changed) == {5}
    assert edit.words == "viewpoint 3 left out, viewpoint 5 changed"


def test_only_what_was_touched_moves(graph):
    x, y, z = BEFORE[6].position
    away = np.array([x, y]) / np.hypot(x, y)
    moved = Viewpoint((x + away[0], y + away[1], z + 0.5), BEFORE[6].yaw_deg + 10, -20.0)
    path, flags = edited(PLAN, FLAGS, Edit((2, 9), {6: moved}), graph, LIMITS)
    expected = [v for n, v in enumerate(BEFORE) if n not in (2, 9)]
    expected[expected.index(BEFORE[6])] = moved
    assert np.allclose(places(path, flags), [v.position for v in expected], atol=1e-6)
    turned = stops(path, flags)[5]
    assert turned.pitch_deg == pytest.approx(-20.0, abs=0.01)
    assert abs((turned.yaw_deg - moved.yaw_deg + 180) % 360 - 180) < 0.01
    assert path_clearance(SCENE, path.positions).distance_m >= 1.99 and (np.diff(path.t_s) > 0).all()


def test_a_forbidden_box_is_flown_round(graph):
    middle = PLAN.positions[105]  # between viewpoints 10 and 11
    box = np.array([middle - 0.3, middle + 0.3])
    path, flags = edited(PLAN, FLAGS, Edit(), graph_of([box]), LIMITS)
    inside = ((path.positions > box[0]) & (path.positions < box[1])).all(axis=1)
    assert not inside.any()
    assert np.allclose(places(path, flags), [v.position for v in BEFORE], atol=1e-6)


def test_a_viewpoint_where_nobody_may_be_is_refused_by_its_number(graph):
    here = np.array(BEFORE[4].position)
    wall = SCENE.closest(here[None])[0][0]
    near = replace(BEFORE[4], position=tuple(wall + (here - wall) / np.linalg.norm(here - wall)))
    with pytest.raises(RefusedError, match=r"viewpoint 4.* m from the structure, 2 m are required"):
        edited(PLAN, FLAGS, Edit((), {4: near}), graph, LIMITS)
    inside = np.array(BEFORE[7].position)
    with pytest.raises(RefusedError, match=r"viewpoint 7: in a keep-out box"):
        edited(PLAN, FLAGS, Edit(), graph_of([[inside - 0.2, inside + 0.2]]), LIMITS)
    everything = Edit(tuple(range(len(BEFORE) - 1)))
    with pytest.raises(RefusedError, match="has 1 viewpoints left"):
        edited(PLAN, FLAGS, everything, graph, LIMITS)
