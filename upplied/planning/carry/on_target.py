"""The demonstrated path on the target, which the shape of a plan is compared with, and its plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.config import TransferSettings
from upplied.planning.carry.affine import registered_map
from upplied.planning.correspondence.pair import Pair
from upplied.planning.correspondence.registration import box_on_box
from upplied.planning.demonstration.repetition import Take
from upplied.records import Floats, Trajectory, Waypoints


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


def plane_height(flight: Trajectory, pair: Pair, carried: Floats, settings: TransferSettings) -> float:
    """Height of the plane at the target, m.

    With the stand-off kept, as high above the ground as demonstrated (a robot does not grow), where
    both grounds are known; else where the structure's map carries the flight.

    Parameters
    ----------
    flight : Trajectory
        In the source's frame.
    pair : Pair
    carried : array, shape (M, 3), m, target frame
        The carried flight.
    settings : TransferSettings
    """
    here, there = pair.source.surroundings.ground_z_m, pair.target.surroundings.ground_z_m
    if settings.standoff != "kept" or here is None or there is None:
        return float(carried[:, 2].mean())
    return there + float(flight.positions[:, 2].mean()) - here


def at_height(path: Waypoints, height_m: float) -> Waypoints:
    """The same waypoints, all at one height."""
    positions = np.array(path.positions)
    positions[:, 2] = height_m
    return replace(path, positions=positions)
