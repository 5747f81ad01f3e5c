"""The demonstrated path on the target, which the shape of a plan is compared with."""

from __future__ import annotations

import numpy as np

from upplied.planning.carry.affine import box_map, registered_map
from upplied.planning.demonstration.repetition import Take
from upplied.records import Floats


def demonstrated_on_target(take: Take) -> Floats:
    """The demonstrated positions after the box transform, turned as the structures are to each other."""
    pair, flown = take.pair, take.inspection.by_frustum.stations.positions
    turned = pair.surface.registration.rotation @ pair.surface.registration.turn
    heading = np.arctan2(turned[1, 0], turned[0, 0])
    if abs(heading) > np.radians(30):
        return registered_map(pair.surface.registration).points(flown)
    return box_map(pair.voxels.source, pair.voxels.target).points(flown)
