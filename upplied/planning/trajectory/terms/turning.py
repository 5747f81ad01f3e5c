"""Turning: how much more the camera turns than it would as carried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from upplied.planning.trajectory.state import Flown
from upplied.records import Floats, Record

_LITTLE_RAD = np.radians(
    0.3
)  # between two stations, below which a turn costs little: so that there is a slope


@dataclass(frozen=True, eq=False, repr=False)
class Turning(Record):
    """Total variation of the change of the camera's direction, over all that the demonstration turns.

    A change that stays costs nothing, a look aside costs the way there and back.
    """

    yaw: Floats  # (M,) rad, as carried
    pitch: Floats  # (M,) rad
    demonstrated_rad: float

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Added over demonstrated turning, and its slope."""
        level = np.cos((self.pitch[1:] + self.pitch[:-1]) / 2) ** 2
        across, up = np.diff(flown.yaw - self.yaw), np.diff(flown.pitch - self.pitch)
        length = np.sqrt(level * across**2 + up**2 + _LITTLE_RAD**2)
        by_yaw = -np.diff(level * across / length, prepend=0.0, append=0.0)
        by_pitch = -np.diff(up / length, prepend=0.0, append=0.0)
        value = float((length - _LITTLE_RAD).sum()) / self.demonstrated_rad
        nothing = np.zeros_like(flown.positions)
        return value, Flown(nothing, by_yaw / self.demonstrated_rad, by_pitch / self.demonstrated_rad)
