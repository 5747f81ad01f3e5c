"""What the tests of planning share is what planning would find out, and of these very inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import remembered

from upplied.config import settings_for
from upplied.planning import plan as planning
from upplied.planning.correspondence.siblings import study
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import member
from upplied.samples.pilot import fly

CUBE, CUBOID = member("cube-v1").structure, member("cuboid-v1").structure
FLIGHT = fly(CUBE, "sides", seed=3)


@pytest.mark.slow
def test_what_is_shared_is_what_planning_finds_out(monkeypatch):
    """The hash that a record says does not count: a changed copy that keeps it is planned as what it is."""
    higher = replace(CUBOID, vertices=CUBOID.vertices * [1.0, 1.0, 1.1])
    assert higher.sha256 == CUBOID.sha256
    settings = settings_for("baseline")
    for target in (CUBOID, higher):
        anew = plan_transfer(FLIGHT, CUBE, target, settings)
        monkeypatch.setattr(planning, "_planned", remembered.planned)
        for _ in range(2):
            shared = plan_transfer(FLIGHT, CUBE, target, settings)
            assert shared.trajectory.positions.tobytes() == anew.trajectory.positions.tobytes()
            assert repr(shared.measures) == repr(anew.measures) and shared.warnings == anew.warnings
            assert np.array_equal(shared.surface.state, anew.surface.state)
        monkeypatch.setattr(planning, "_planned", remembered._plan)


@pytest.mark.anew
def test_a_test_may_plan_everything_itself():
    assert planning._planned is remembered._plan


def test_the_others_share():
    assert planning._planned is remembered.planned


def test_a_pair_that_is_shared_leaves_in_each_memo_what_its_study_leaves_there():
    stores: list[dict] = [{}, {}]
    for store in stores:

        def memo(stage, record_type, key, compute, store=store):
            if (stage, key) not in store:
                store[stage, key] = compute()
            return store[stage, key]

        pair = remembered._studied(study, CUBE, CUBOID, settings_for("baseline"), memo)
        assert pair.source.sha256 == CUBE.sha256
    assert stores[0].keys() == stores[1].keys() and len(stores[0]) >= 5
    assert all(stores[0][name] is stores[1][name] for name in stores[0])
