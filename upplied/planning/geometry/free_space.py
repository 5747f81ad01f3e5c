"""Whether a leash lets two walkers along polylines arrive: the free-space diagram of Alt and Godau (1995).

It is decided row by row, in the band of columns that can be reached."""

from __future__ import annotations

import numpy as np
from numba import njit

from upplied.records import Floats


@njit(cache=True)
def distance(a: Floats, b: Floats) -> float:
    """Distance of two points (D,)."""
    total = 0.0
    for axis in range(len(a)):
        total += (a[axis] - b[axis]) ** 2
    return np.sqrt(total)


@njit(cache=True, inline="always")
def _free(point: Floats, start: Floats, end: Floats, leash: float) -> tuple[float, float]:
    """The part [low, high] of a segment within the leash of a point; (2, -1) where there is none."""
    length2, along = 0.0, 0.0
    for axis in range(len(point)):
        leg = end[axis] - start[axis]
        length2 += leg * leg
        along += leg * (point[axis] - start[axis])
    foot = along / length2 if length2 > 0 else 0.0
    gap2 = 0.0
    for axis in range(len(point)):
        gap2 += (point[axis] - start[axis] - foot * (end[axis] - start[axis])) ** 2
    if gap2 > leash * leash:
        return 2.0, -1.0
    if length2 == 0:
        return 0.0, 1.0
    half = np.sqrt((leash * leash - gap2) / length2)
    low, high = max(foot - half, 0.0), min(foot + half, 1.0)
    if low > high:
        return 2.0, -1.0
    return low, high


@njit(cache=True)
def suffices(first: Floats, second: Floats, leash: float, reach_up: Floats, reach_right: Floats) -> bool:
    """Whether a leash of this length lets both walkers arrive.

    Cell (i, j) of the diagram is leg i of the first curve by leg j of the second. `reach_up[j]` is the part
    of its lower edge (vertex i, leg j) that a walk can reach, `reach_right` that of its left edge (leg i,
    vertex j).
    """
    if distance(first[0], second[0]) > leash or distance(first[-1], second[-1]) > leash:
        return False
    rows, columns = len(first) - 1, len(second) - 1
    if rows == 0 or columns == 0:
        return _all_near(first, second, leash)
    begin, end = 0, 0  # columns whose lower edge is reachable: begin <= j < end
    while end < columns:
        low, high = _free(first[0], second[end], second[end + 1], leash)
        if low > 0 or high < 0:
            break
        reach_up[end, 0], reach_up[end, 1] = low, high
        end += 1
        if high < 1:
            break
    left_open = True  # the left edge of the diagram has been reachable so far
    for i in range(rows):
        left_low, left_high = 2.0, -1.0
        if left_open:
            left_low, left_high = _free(second[0], first[i], first[i + 1], leash)
            if left_low > 0:
                left_low, left_high = 2.0, -1.0
            left_open = left_high >= 1
        if left_high < 0 and begin >= end:
            return False
        j = 0 if left_high >= 0 else begin
        new_begin, new_end = columns, j
        while j < columns and (j < end or left_high >= 0):
            inside = begin <= j < end
            below_low = reach_up[j, 0] if inside else 2.0
            below_high = reach_up[j, 1] if inside else -1.0
            top_low, top_high = 2.0, -1.0
            right_low, right_high = 2.0, -1.0
            if below_high >= 0 or left_high >= 0:
                top_low, top_high = _free(first[i + 1], second[j], second[j + 1], leash)
                if left_high < 0:
                    top_low = max(top_low, below_low)
                right_low, right_high = _free(second[j + 1], first[i], first[i + 1], leash)
                if below_high < 0:
                    right_low = max(right_low, left_low)
            if top_low <= top_high:
                reach_up[j, 0], reach_up[j, 1] = top_low, top_high
                new_begin, new_end = min(new_begin, j), j + 1
            else:
                reach_up[j, 0], reach_up[j, 1] = 2.0, -1.0
            if right_low > right_high:
                right_low, right_high = 2.0, -1.0
            left_low, left_high = right_low, right_high
            j += 1
        begin, end = new_begin, new_end
        last_right = left_high if j == columns else -1.0
        if i == rows - 1:
            return (end == columns and reach_up[columns - 1, 1] >= 1) or last_right >= 1
    return False


@njit(cache=True)
def _all_near(first: Floats, second: Floats, leash: float) -> bool:
    """The case of a curve of one vertex: all of the other must be near it."""
    for a in first:
        for b in second:
            if distance(a, b) > leash:
                return False
    return True
