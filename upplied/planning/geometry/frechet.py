"""Continuous Frechet distance of polylines, after Alt and Godau (1995), in any dimension.

Two people walk along the two curves, each at any speed but never backwards; the distance is the
shortest leash that lets them both arrive. Whether a leash suffices is decided on the free-space diagram, row
by row, in the band of columns that can be reached; the shortest one is bisected.
"""

import numpy as np
from numba import njit

from upplied.checks import check_finite
from upplied.geometry.polylines import arc_length, interpolated
from upplied.records import Floats

_RELATIVE = 1e-10  # of the distance: where the bisection ends
_FINE = 1e-6  # an asked share, below which no vertex of a curve is left out
_ROUGH = 0.02  # of the distance, to which it is known at first
_SMALLEST_SHARE = 0.1  # see `spread`
_FLAT = 1e-6  # of the largest deviation: rounding, not a height that varies


def frechet(first: Floats, second: Floats, relative: float = _RELATIVE) -> float:
    """Continuous Frechet distance of two polylines, in O(N M) time at worst for each of its decisions.

    Parameters
    ----------
    first, second : array, shape (N, D) and (M, D), one unit
    relative : float
        How far above the true distance the result may be, as a share of it.

    Returns
    -------
    float
        In the unit of the coordinates; never below the true distance and at most `relative` of it above
        (where the distance vanishes: a thousandth of that share of the curves' extent).

    Raises
    ------
    InputError
        If a curve is empty or not finite, or their dimensions differ.

    Examples
    --------
    >>> round(frechet(np.array([[0.0, 0], [10, 0]]), np.array([[0.0, 3], [10, 3]])), 6)
    3.0
    """
    first = np.ascontiguousarray(check_finite(first, (None, None), "first curve"))
    second = np.ascontiguousarray(check_finite(second, (None, first.shape[1]), "second curve"))
    check_finite(first[:1], (1, None), "first curve")
    check_finite(second[:1], (1, None), "second curve")
    # Two who are at every moment as far along as each other need no shorter leash.
    along = []
    for curve in (first, second):
        far = arc_length(curve)
        along.append(far / far[-1] if far[-1] > 0 else np.linspace(0.0, 1.0, len(curve)))
    at = np.union1d(*along)
    apart = interpolated(at, along[0], first) - interpolated(at, along[1], second)
    high = float(np.linalg.norm(apart, axis=1).max())
    if relative < _FINE or high <= 0:
        return float(_bisect(first, second, 0.0, high, relative))
    # First on curves of few vertices, which bound the distance, then on ones as fine as it asks for.
    low, off = 0.0, _ROUGH * high
    while low < high / 2 and off > relative * high:
        few = _simplified(first, off / 4), _simplified(second, off / 4)
        rough = float(_bisect(*few, low, high + off / 2, _ROUGH))
        low, high = max(low, rough * (1 - _ROUGH) - off / 2), min(high, rough + off / 2)
        off = _ROUGH * high
    off = relative * low / 2
    few = _simplified(first, off / 4), _simplified(second, off / 4)
    return float(_bisect(*few, max(low - off / 2, 0.0), high + off / 2, relative / 2)) + off / 2


def frechet_z(demonstrated: Floats, planned: Floats, relative: float = _RELATIVE) -> float:
    """Frechet distance of two paths, each z-scored by its own mean and deviation (paper, Table II).

    Each axis is divided by its own deviation, however small: on a level flight that is centimetres, and
    they decide the distance. `frechet_floored` is the one that tells whether two paths have one shape.
    """
    scored = []
    for path in (demonstrated, planned):
        mean, deviation = curve_spread(path)
        largest = float(deviation.max())
        flat = deviation <= _FLAT * largest  # no deviation to divide by
        scored.append(np.asarray((path - mean) / np.where(flat, max(largest, 1e-9), deviation)))
    return frechet(scored[0], scored[1], relative)


def frechet_floored(demonstrated: Floats, planned: Floats, relative: float = _RELATIVE) -> float:
    """The same with no axis divided by less than a tenth of the path's largest deviation, see `spread`."""
    return frechet(zscored(demonstrated), zscored(planned), relative)


def zscored(path: Floats) -> Floats:
    """A path (N, D) with mean 0 and deviation 1 along each axis, by its own `spread`."""
    mean, deviation = spread(path)
    return (path - mean) / deviation


def spread(path: Floats) -> tuple[Floats, Floats]:
    """Mean and deviation (D,) of a path along each axis, by which it is standardised.

    They are those of the curve, by length, not of its vertices: a pilot who hovers, or a plan with
    fewer waypoints, changes nothing. The deviation of an axis counts as at least a tenth of the
    path's largest, or the centimetres of unsteadiness of a level flight would decide the distance. A path
    that stays in one point has deviation 1.
    """
    mean, deviation = curve_spread(path)
    if not deviation.any():
        return mean, np.ones(len(deviation))
    return mean, np.maximum(deviation, _SMALLEST_SHARE * deviation.max())


def curve_spread(path: Floats) -> tuple[Floats, Floats]:
    """Mean and deviation (D,) of a curve along each axis, by length; 0 where it stays in one point."""
    path = check_finite(path, (None, None), "path")
    legs, middle = np.diff(path, axis=0), (path[1:] + path[:-1]) / 2
    length = np.linalg.norm(legs, axis=1)
    if length.sum() == 0:
        return path.mean(axis=0), np.zeros(path.shape[1])
    weight = length / length.sum()
    mean = weight @ middle
    deviation = np.sqrt(weight @ ((middle - mean) ** 2 + legs**2 / 12))
    return mean, deviation


@njit(cache=True)
def _simplified(curve: Floats, off: float) -> Floats:
    """The curve without vertices that its chords pass within a distance, in their order (greedy)."""
    # The Frechet distance of both is at most that distance: along each chord they advance together.
    chosen, count, dimensions = np.zeros(len(curve), np.bool_), len(curve), curve.shape[1]
    chosen[0] = chosen[count - 1] = True
    start = 0
    while start < count - 1:
        stop = start + 1
        while stop + 1 < count:
            length2 = 0.0
            for axis in range(dimensions):
                length2 += (curve[stop + 1, axis] - curve[start, axis]) ** 2
            before, fits = 0.0, length2 > 0
            for between in range(start + 1, stop + 1):
                along, gap2 = 0.0, 0.0
                for axis in range(dimensions):
                    leg = curve[stop + 1, axis] - curve[start, axis]
                    along += leg * (curve[between, axis] - curve[start, axis])
                along /= max(length2, 1e-300)
                for axis in range(dimensions):
                    leg = curve[stop + 1, axis] - curve[start, axis]
                    gap2 += (curve[between, axis] - curve[start, axis] - along * leg) ** 2
                if not (before <= along <= 1.0 and gap2 <= off * off):
                    fits = False
                    break
                before = along
            if not fits:
                break
            stop += 1
        chosen[stop] = True
        start = stop
    return curve[chosen]


@njit(cache=True)
def _bisect(first: Floats, second: Floats, low: float, high: float, relative: float) -> float:
    low = max(low, distance(first[0], second[0]), distance(first[-1], second[-1]))
    high = max(low, high)
    extent = 0.0
    for axis in range(first.shape[1]):
        lowest = min(first[:, axis].min(), second[:, axis].min())
        highest = max(first[:, axis].max(), second[:, axis].max())
        extent = max(extent, highest - lowest)
    reach_up, reach_right = np.empty((len(second), 2)), np.empty((len(second), 2))
    if suffices(first, second, low, reach_up, reach_right):
        return low
    while high - low > max(relative * high, 1e-3 * relative * extent):
        middle = 0.5 * (low + high)
        if suffices(first, second, middle, reach_up, reach_right):
            high = middle
        else:
            low = middle
    return high


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
        for a in first:
            for b in second:
                if distance(a, b) > leash:
                    return False
        return True
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
