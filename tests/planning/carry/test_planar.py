"""Flights in a plane stay in it, and flat paths break no measure."""

import numpy as np
import pytest
from cases import slow_after

from upplied.config import settings_for
from upplied.planning.plan import plan_transfer
from upplied.samples.fleet import sample_structures
from upplied.samples.pilot import fly


@pytest.mark.ci
@pytest.mark.parametrize("standoff", slow_after(1, ["scaled", "kept"]))
def test_a_demonstration_in_a_plane_stays_in_its_plane(standoff):
    fleet = {structure.structure_id: structure for structure in sample_structures()}
    cube, cuboid = fleet["cube-v1"], fleet["cuboid-v1"]
    flown = fly(cube, "sides", seed=1)
    flown.positions[:, 2] = 3.0
    plan = plan_transfer(
        flown, cube, cuboid, settings_for("recommended", transfer={"plane": True, "standoff": standoff})
    )
    assert plan.status == "ok", plan.reason
    heights = plan.trajectory.positions[:, 2]
    assert np.ptp(heights) <= 0.1
    if standoff == "kept":
        assert heights == pytest.approx(3.0, abs=0.06)
    assert np.isfinite(plan.measures.frechet_z) and plan.measures.min_clearance_m >= 2
