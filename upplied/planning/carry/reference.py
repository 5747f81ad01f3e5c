"""The demonstrated path on the target, which the shape of a plan is compared with."""

from __future__ import annotations

from upplied.planning.carry.affine import registered_map
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.demonstration.repetition import Take
from upplied.records import Floats


def demonstrated_on_target(take: Take) -> Floats:
    """The demonstrated positions after the box transform, with the target turned as it was registered.

    However the target stands: at the declared heading, turned about the vertical, or tipped over.
    """
    voxels, flown = take.pair.voxels, take.inspection.by_frustum.stations.positions
    return registered_map(box_on_box(voxels.source, voxels.target, standing(take.pair))).points(flown)


def standing(pair: Pair) -> Floats:
    """The turn (3, 3) of the target that makes it stand as the source does.

    Paths are z-scored along the axes of the source, so that a turned target changes no figure.
    """
    registration = pair.surface.registration
    return registration.rotation @ registration.turn
