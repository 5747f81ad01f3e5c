"""Demonstrations in a plane, by ground robots and boats, that stay in their plane (paper, Sec. IV-D)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from upplied.config import TransferSettings
from upplied.planning.correspondence.pair import Pair
from upplied.records import Floats, Trajectory, Waypoints


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
