"""The measures of one plan, asked of the demonstration and the plan in the same manner."""

from __future__ import annotations

import numpy as np

from upplied.config import Settings
from upplied.planning.inspect import Inspection
from upplied.planning.measure import BY_FRUSTUM, TRULY, measure, sought, views
from upplied.planning.pair import Memo, Pair, no_memo
from upplied.planning.transfer import box_map, registered_map
from upplied.records import Floats, Measures, Trajectory


def judge(
    trajectory: Trajectory, inspection: Inspection, pair: Pair, settings: Settings, memo: Memo = no_memo
) -> Measures:
    """All measures of a planned trajectory (algorithm.md, section 8)."""
    camera = inspection.camera
    voxels, surface = pair.voxels, pair.surface
    paper = (
        sought(voxels.source, voxels.target, voxels.correspondences, inspection.by_frustum),
        views(trajectory, voxels.target, camera, BY_FRUSTUM),
    )
    carrier = registered_map(surface.registration)
    true = (
        sought(
            surface.source, surface.target, surface.correspondences, inspection.truly, carry=carrier.matrix
        ),
        views(trajectory, surface.target, camera, TRULY, pair.target_scene),
    )
    return measure(
        trajectory,
        demonstrated_on_target(inspection, pair),
        pair.target_scene,
        paper,
        true if surface.registration.accepted else None,
    )


def demonstrated_on_target(inspection: Inspection, pair: Pair) -> Floats:
    """The demonstrated positions after the box transform, turned as the structures are to each other."""
    registration = pair.surface.registration
    heading = np.arctan2(registration.rotation[1, 0], registration.rotation[0, 0])
    if abs(heading) > np.radians(30):
        return registered_map(registration).points(inspection.flight.positions)
    return box_map(pair.voxels.source, pair.voxels.target).points(inspection.flight.positions)
