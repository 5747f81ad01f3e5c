"""Optical axis: how far beside the inspected surface the camera points, beyond how far the expert's did."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from upplied.planning.constants import FOVEA
from upplied.planning.trajectory.state import Flown
from upplied.records import Bools, Floats, Record

_SPREAD = FOVEA / 2  # rad, of a gaze: what is wider is as wide as that
_LEAST = _SPREAD / 2  # rad: what is narrower is as narrow as that


@dataclass(frozen=True, eq=False, repr=False)
class Aims(Record):
    """The inspected surface near each optical axis, as wide as it looks; NaN where none is in sight."""

    at: Floats  # (S, 3) m, its middle
    metric: Floats  # (S, 3, 3) of an angle there: 1 along a wide surface, more across a narrow one

    def angles(self, positions: Floats, axis: Floats) -> Floats:
        """Between each optical axis and its aim, (S,), about rad on a wide surface."""
        ray = self.at - positions
        return self.measured(axis - ray / np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9))[0]

    def measured(self, apart: Floats) -> tuple[Floats, Floats]:
        """Lengths (S,) of differences of directions (S, 3), and half the slopes of their squares (S, 3)."""
        pull = np.einsum("sij,sj->si", self.metric, apart)
        return np.sqrt(np.maximum((apart * pull).sum(axis=1), 0)), pull


@dataclass(frozen=True, eq=False, repr=False)
class Axis(Record):
    """Mean squared angle, rad^2, from the optical axis to the inspected surface, beyond the demonstrated one.

    The angle is the chord of the two directions, dearer across a surface that looks narrow (`Aims`), which
    holds until it is found again.
    """

    aims: Aims
    demonstrated: Floats  # (S,) rad, the expert's own angle there; NaN where none was in sight

    def value(self, flown: Flown) -> tuple[float, Flown]:
        """Mean squared excess, and its slope."""
        yaw, pitch, ray = flown.yaw, flown.pitch, self.aims.at - flown.positions
        away = np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9)
        towards, axis = ray / away, axes(yaw, pitch)
        angle, pull = self.aims.measured(axis - towards)
        excess = np.nan_to_num(np.maximum(angle - self.demonstrated, 0))
        pull = np.where(excess > 0, 2 * excess / np.maximum(angle, 1e-9), 0.0)[:, None] * pull / len(excess)
        pull = np.where(excess[:, None] > 0, pull, 0.0)
        towards = np.where(excess[:, None] > 0, towards, 0.0)
        across = np.column_stack([-axis[:, 1], axis[:, 0], np.zeros(len(yaw))])
        up = np.column_stack([-np.sin(pitch) * np.cos(yaw), -np.sin(pitch) * np.sin(yaw), np.cos(pitch)])
        along = (pull * towards).sum(axis=1, keepdims=True)
        slope = (pull - along * towards) / np.nan_to_num(away, nan=1.0)
        return float((excess**2).mean()), Flown(slope, (pull * across).sum(axis=1), (pull * up).sum(axis=1))


def axes(yaw: Floats, pitch: Floats) -> Floats:
    """Unit vectors (S, 3) of cameras that look there."""
    return np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])


def aims_of(positions: Floats, axis: Floats, points: Floats, weight: Floats, seen: Bools) -> Aims:
    """The surface near each optical axis (S, 3), of points (N, 3), m, each of some weight (N,).

    It is the mean of what is `seen` (S, N) and how it spreads, weighted towards the axis, half a gaze wide:
    no single sample decides.
    """
    given = (np.ascontiguousarray(of, float) for of in (positions, axis, points, weight))
    at, spread = _aims(*given, seen, _SPREAD**2)
    ray = at - positions
    towards = ray / np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-9)
    spread += _SPREAD**2 * towards[:, :, None] * towards[:, None, :]
    lacking = np.isnan(at).any(axis=1)
    spread[lacking] = _SPREAD**2 * np.eye(3)
    size, direction = np.linalg.eigh(spread)
    dearer = _SPREAD**2 / np.clip(size, _LEAST**2, _SPREAD**2)
    return Aims(at, np.einsum("sik,sk,sjk->sij", direction, dearer, direction))


@njit(cache=True)
def _aims(
    positions: Floats, axis: Floats, points: Floats, weight: Floats, seen: Bools, variance: float
) -> tuple[Floats, Floats]:
    aim, spread = np.full((len(positions), 3), np.nan), np.zeros((len(positions), 3, 3))
    for station in range(len(positions)):
        whole, middle, ray = 0.0, np.zeros(3), np.empty(3)
        way, first, second = np.empty(3), np.zeros(3), np.zeros((3, 3))
        for index in range(len(points)):
            if not seen[station, index]:
                continue
            square = 0.0
            for k in range(3):
                ray[k] = points[index, k] - positions[station, k]
                square += ray[k] * ray[k]
            length, chord2 = max(np.sqrt(square), 1e-9), 0.0
            for k in range(3):
                way[k] = ray[k] / length - axis[station, k]
                chord2 += way[k] * way[k]
            share = weight[index] * np.exp(-chord2 / (2 * variance))
            whole += share
            for k in range(3):
                middle[k] += share * points[index, k]
                first[k] += share * way[k]
                for m in range(3):
                    second[k, m] += share * way[k] * way[m]
        if whole > 0:
            aim[station] = middle / whole
            first /= whole
            for k in range(3):
                for m in range(3):
                    spread[station, k, m] = second[k, m] / whole - first[k] * first[m]
    return aim, spread
