"""Positions that come a little too near, pushed out smoothly along the path."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from upplied.geometry.polylines import arc_length, leg_lengths
from upplied.planning.airspace.rules import Airspace, inside_fence
from upplied.records import Floats

_PUSHES = 24
_INSIDE_M = 0.05  # of the fence


def pushed_out(positions: Floats, airspace: Airspace) -> Floats:
    """Each position moved to where it is allowed, its neighbours along the path with it.

    It ends with what it can reach: places between two near surfaces, or inside the structure, may
    stay too near.

    Parameters
    ----------
    positions : array, shape (M, 3), m
    airspace : Airspace

    Returns
    -------
    array, shape (M, 3), m
    """
    moved = np.array(positions, float)
    weights = _kernel(positions, reach=2 * airspace.clearance_m)
    for turn in range(_PUSHES):
        between = (moved[1:] + moved[:-1]) / 2  # so that corners are rounded, too
        out, middle = np.split(push(np.concatenate([moved, between]), airspace), [len(moved)])
        middle[leg_lengths(moved) > airspace.clearance_m] = 0.0
        for ends in (out[1:], out[:-1]):
            more = np.linalg.norm(middle, axis=1) > np.linalg.norm(ends, axis=1)
            ends[more] = middle[more]
        if not out.any():
            break
        moved += weights @ out if turn < _PUSHES // 2 else out
    return moved


def push(positions: Floats, airspace: Airspace) -> Floats:
    """The shortest way (M, 3) out of what each position breaks."""
    closest, _ = airspace.scene.closest(positions)
    away = positions - closest
    distance = np.linalg.norm(away, axis=1)
    lack = np.maximum(airspace.clearance_m + 0.02 - distance, 0)
    out = np.where(lack > 0, lack / np.maximum(distance, 1e-6), 0)[:, None] * away
    out[:, 2] += np.maximum(airspace.floor_m - positions[:, 2], 0)
    out[:, 2] -= np.maximum(positions[:, 2] - airspace.ceiling_m, 0)
    declared, limits = airspace.frame.to_declared(positions), np.zeros_like(out)
    for low, high in airspace.surroundings.keep_out_m:
        inside = ((declared > low) & (declared < high)).all(axis=1)
        gaps = np.concatenate([low - declared, high - declared], axis=1)[inside]
        nearest = np.abs(gaps).argmin(axis=1)
        step = gaps[np.arange(len(gaps)), nearest]
        limits[np.flatnonzero(inside), nearest % 3] += step + np.sign(step) * 0.02
    fence = airspace.surroundings.geofence_m
    outside = ~inside_fence(fence, declared)
    if outside.any():
        limits[outside, :2] += _to_fence(fence, declared[outside, :2])
    return out + limits @ airspace.frame.turn


def _to_fence(polygon: Floats, xy: Floats) -> Floats:
    """From each place outside, or on the fence, to a little inside of the nearest edge, (N, 2)."""
    start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    share = ((xy[:, None] - start) * edge).sum(axis=2) / np.maximum((edge**2).sum(axis=1), 1e-12)
    foot = start + np.clip(share, 0, 1)[..., None] * edge
    gap = foot - xy[:, None]
    nearest = np.linalg.norm(gap, axis=2).argmin(axis=1)
    step, way = gap[np.arange(len(xy)), nearest], edge[nearest]
    across = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(np.hypot(*way.T), 1e-12)[:, None]
    beyond = step + _INSIDE_M * across
    inwards = np.where(inside_fence(polygon, xy + beyond)[:, None], across, -across)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return step + _INSIDE_M * np.where(length > _INSIDE_M, step / np.maximum(length, 1e-12), inwards)


def _kernel(positions: Floats, reach: float) -> csr_matrix:
    """(M, M) weights of a running mean of the pushes along the path: a raised cosine, each row sums to 1.

    What is farther along the path than `reach` has no weight, and takes no place.
    """
    along = arc_length(positions)
    first = np.searchsorted(along, along - reach, side="left")
    count = np.searchsorted(along, along + reach, side="right") - first
    start = np.concatenate([[0], np.cumsum(count)])
    row = np.repeat(np.arange(len(along)), count)
    column = np.arange(start[-1]) + np.repeat(first - start[:-1], count)
    weight = 0.5 + 0.5 * np.cos(np.pi * np.minimum(np.abs(along[row] - along[column]) / reach, 1))
    whole = np.bincount(row, weights=weight)
    return csr_matrix((weight / whole[row], column, start), shape=(len(along), len(along)))
