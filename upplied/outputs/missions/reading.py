"""The path that a mission or a plan states, as the gate judges it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from upplied.geometry.polylines import leg_lengths
from upplied.records import Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Reading(Record):
    """The path of one file, m, structure frame."""

    positions: Floats  # (N, 3) in the order of flight, with take-off, transit and return where it has them
    speed_mps: Floats  # (N,) of the leg that ends at each; NaN where the file does not say
    t_s: Floats = field(default_factory=lambda: np.empty(0))  # (N,) where the file is timed, else (0,)
    fan_start: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (L, 3) lines over the corners that
    fan_end: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (L, 3) are passed without a stop
    photo_m: Floats = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) places of photos
    photo_s: Floats = field(default_factory=lambda: np.empty(0))  # (K,) their times, where speeds are stated
    every_s: float = np.inf  # least time between photos by distance


def planned(positions: Floats, t_s: Floats) -> Reading:
    """A path with time stamps, without take-off and return."""
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = leg_lengths(positions) / np.diff(t_s)
    return Reading(positions, np.concatenate([[0.0], speeds]), t_s)
