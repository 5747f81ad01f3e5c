"""Optical axis: how far beside the inspected surface the camera points, beyond how far the expert's did."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.planning.constants import FOVEA
from upplied.planning.trajectory.state import Flown
from upplied.records import Bools, Floats, Record


@dataclass(frozen=True, eq=False, repr=False)
class Axis(Record):
    """Mean squared angle, rad^2, from the optical axis to the inspected surface, beyond the demonstrated one.

    Every so many stations count. The angle is the chord of the two directions, and the surface is a point
    (`aims`), which holds until it is found again.
    """

    aim: Floats  # (S, 3) m, the inspected surface nearest to each optical axis; NaN where none is in sight
    demonstrated: Floats  # (S,) rad, the expert's own angle there; NaN where none was in sight
    stride: int

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared excess, and its slope."""
        yaw, pitch = flown.yaw[:: self.stride], flown.pitch[:: self.stride]
        ray = self.aim - flown.positions[:: self.stride]
        away = np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9)
        towards, axis = ray / away, axes(yaw, pitch)
        chord = np.linalg.norm(axis - towards, axis=1)
        excess = np.nan_to_num(np.maximum(chord - self.demonstrated, 0))
        # The squared chord is 2 - 2 axis . towards: the slope of the chord is half of that over the chord.
        pull = np.where(excess > 0, 2 * excess / np.maximum(chord, 1e-9), 0.0)[:, None] / len(excess)
        towards = np.where(excess[:, None] > 0, towards, 0.0)
        across = np.column_stack([-axis[:, 1], axis[:, 0], np.zeros(len(yaw))])
        up = np.column_stack([-np.sin(pitch) * np.cos(yaw), -np.sin(pitch) * np.sin(yaw), np.cos(pitch)])
        slope = Flown(np.zeros_like(flown.positions), np.zeros(len(flown)), np.zeros(len(flown)))
        along = (axis * towards).sum(axis=1, keepdims=True)
        slope.positions[:: self.stride] = pull * (axis - along * towards) / np.nan_to_num(away, nan=1.0)
        slope.yaw[:: self.stride] = -(pull * across * towards).sum(axis=1)
        slope.pitch[:: self.stride] = -(pull * up * towards).sum(axis=1)
        return float((excess**2).mean()), slope


def axes(yaw: Floats, pitch: Floats) -> Floats:
    """Unit vectors (S, 3) of cameras that look there."""
    return np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])


def aims(positions: Floats, axis: Floats, points: Floats, weight: Floats, seen: Bools) -> Floats:
    """The surface near each optical axis, (S, 3) m; NaN where none is seen.

    Parameters
    ----------
    positions, axis : array, shape (S, 3), m and unit vectors
    points : array, shape (N, 3), m
    weight : array, shape (N,)
        How much each sample stands for.
    seen : array of bool, shape (S, N)

    Returns
    -------
    array, shape (S, 3), m
        The mean of what is seen, weighted towards the axis, half a gaze wide: no single sample decides.
    """
    given = (np.ascontiguousarray(of, float) for of in (positions, axis, points, weight))
    return np.asarray(_aims(*given, seen, (FOVEA / 2) ** 2))


def angles(positions: Floats, axis: Floats, aim: Floats) -> Floats:
    """Chord, about rad, between each optical axis and the direction to its aim, (S,)."""
    ray = aim - positions
    return np.linalg.norm(axis - ray / np.linalg.norm(ray, axis=1, keepdims=True), axis=1)


@njit(cache=True)
def _aims(
    positions: Floats, axis: Floats, points: Floats, weight: Floats, seen: Bools, variance: float
) -> Floats:
    aim = np.full((len(positions), 3), np.nan)
    for station in range(len(positions)):
        whole, middle, ray = 0.0, np.zeros(3), np.empty(3)
        for index in range(len(points)):
            if not seen[station, index]:
                continue
            along, square = 0.0, 0.0
            for k in range(3):
                ray[k] = points[index, k] - positions[station, k]
                along += ray[k] * axis[station, k]
                square += ray[k] * ray[k]
            chord2 = 2 - 2 * along / max(np.sqrt(square), 1e-9)
            share = weight[index] * np.exp(-chord2 / (2 * variance))
            middle += share * points[index]
            whole += share
        if whole > 0:
            aim[station] = middle / whole
    return aim
