"""The measures of one plan, asked of the demonstration and the plan in the same manner."""

from __future__ import annotations

import numpy as np

from upplied.config import Settings
from upplied.planning.inspect import Inspection
from upplied.planning.measure import BY_FRUSTUM, TRULY, measure, sought, surface_states, views
from upplied.planning.pair import Memo, Pair, no_memo
from upplied.planning.transfer import box_map, registered_map
from upplied.records import Floats, Measures, SurfaceStates, Trajectory


def judge(
    trajectory: Trajectory, inspection: Inspection, pair: Pair, settings: Settings, memo: Memo = no_memo
) -> tuple[Measures, SurfaceStates | None]:
    """All measures of a planned trajectory, and what becomes of the target's surface."""
    camera = inspection.camera
    voxels, surface = pair.voxels, pair.surface
    paper = (
        sought(voxels.source, voxels.target, voxels.correspondences, inspection.by_frustum),
        views(trajectory, voxels.target, camera, BY_FRUSTUM),
    )
    carried = demonstrated_on_target(inspection, pair)
    carrier = registered_map(surface.registration)
    true = (
        sought(
            surface.source, surface.target, surface.correspondences, inspection.truly, carry=carrier.matrix
        ),
        views(trajectory, surface.target, camera, TRULY, pair.target_scene),
    )
    if not surface.registration.accepted:
        return measure(trajectory, carried, pair.target_scene, paper), None
    states = surface_states(true[0], true[1].total)
    return measure(trajectory, carried, pair.target_scene, paper, true), states


def demonstrated_on_target(inspection: Inspection, pair: Pair) -> Floats:
    """The demonstrated positions after the box transform, turned as the structures are to each other."""
    registration = pair.surface.registration
    heading = np.arctan2(registration.rotation[1, 0], registration.rotation[0, 0])
    if abs(heading) > np.radians(30):
        return registered_map(registration).points(inspection.flight.positions)
    return box_map(pair.voxels.source, pair.voxels.target).points(inspection.flight.positions)
